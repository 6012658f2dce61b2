"""Names in claims and exclusions: find those that a study does not have, and what a short name means."""

from collections.abc import Collection, Mapping
from typing import Any

from glossbench.columns import CONDITIONS
from glossbench.errors import suggest_nearest
from glossbench.study.claims import (
    Claim,
    LowerClaim,
    RatioClaim,
    SlopeClaim,
    ValueClaim,
    get_method,
    get_options,
    get_places,
    list_sides,
)


def find_unknown_name(
    claim: Claim, methods: Mapping[str, Collection[str]], places: Mapping[str, Collection[str]],
    parameters: Mapping[str, Collection[str]], metrics: Collection[str], costs: Collection[str],
) -> tuple[tuple[str | int, ...], str] | None:  # fmt: skip
    """The first name in a claim that its study does not have: the path of its key, and the message.

    Args:
        methods: the study's methods with the names of their options.
        places: by "light", "material" and "view", the names that fit; a key that is missing here is not checked.
        parameters: the options of the study's lights, materials and views, by "light", "material" and "view".
        metrics: the study's metrics.
        costs: the columns of costs of the study's cells.
    """
    sides = list_sides(claim)
    for path, side in sides.items():
        name = get_method(side)
        if name not in methods:
            return path, f"no method {name!r} in this study{suggest_nearest(name, methods)}"
        for option in get_options(side):
            if option not in methods[name]:
                where = (*path, name, option)
                return where, f"no option {option!r} of {name} in this study{suggest_nearest(option, methods[name])}"
        for place, value in get_places(side).items():
            if problem := find_unknown_place(place, value, places):
                return (*path, place), problem
    options = [set(methods[get_method(side)]) for side in sides.values()]
    shared = set.intersection(*options)
    wanted: list[tuple[str, str, str, Collection[str]]] = []  # key, what, name, known
    if isinstance(claim, LowerClaim):
        wanted.append(("metric", "metric", claim.metric, metrics))
    if isinstance(claim, SlopeClaim):
        wanted.append(("metric", "metric or cost", claim.metric, [*metrics, *costs]))
    if isinstance(claim, RatioClaim | ValueClaim):
        wanted.append(("of", "column", claim.of, [*metrics, *costs]))
    if isinstance(claim, SlopeClaim):
        meant = find_meanings(claim.over, {"method": shared, **parameters})
        if len(meant) > 1:
            return ("over",), f"{claim.over!r} may mean {' or '.join(f'{of}.{key}' for of, key in meant)}: say which"
        if not meant:
            every = {*shared, *(key for own in parameters.values() for key in own)}
            wanted.append(("over", f"option of {get_method(claim.slope)}", claim.over, every))
    if isinstance(claim, LowerClaim | RatioClaim):
        wanted += [("paired_by", "option of both methods", name, shared) for name in claim.paired_by]
    wanted += [("by", "option of its methods", name, set.union(*options)) for name in claim.by]
    for key, what, name, known in wanted:
        if same := [each for each in known if each.startswith(f"{name} (") and name not in known]:
            return (key,), f"{name!r} may mean {' or '.join(map(repr, same))}: say which"
        if name not in known:
            return (key,), f"no {what} {name!r} in this study{suggest_nearest(name, known)}"
    restrictable = {*CONDITIONS, *parameters["material"], *set.union(*options)}
    held = {"method": set.union(*options), **parameters}
    for key, value in claim.where.items():
        if key == "method":
            return ("where", key), "a claim's methods are its sides, not a part of where"
        if key not in restrictable and not ("." in key and find_meanings(key, held)):
            text = f"no option {key!r} of its methods or materials{suggest_nearest(key, restrictable)}"
            return ("where", key), text
        if problem := find_unknown_place(key, value, places):
            return ("where", key), problem
    return None


def find_meanings(name: str, options: Mapping[str, Collection[str]]) -> list[tuple[str, str]]:
    """All meanings of an option's name, as (of, option), where `of` is "method", "light", "material" or "view".

    A full name, "material.alpha", has one meaning; a short name, "alpha", has one for each kind with this option.
    """
    of, _, rest = name.partition(".")
    if rest and rest in options.get(of, ()):
        return [(of, rest)]
    return [(each, name) for each, own in options.items() if name in own]


def find_unknown_place(place: str, value: Any, places: Mapping[str, Collection[str]]) -> str | None:
    """The message for the first light, material or view that is unknown or not written as one; None if all are fine."""
    for one in (value if isinstance(value, list) else [value]) if place in places else []:
        name, options = next(iter(one.items())) if isinstance(one, dict) and len(one) == 1 else (one, {})
        if not isinstance(name, str) or not isinstance(options, dict):
            return f"must be a {place}, {{{place}: {{option: value}}}}, or a list of these, got {one!r}"
        if name not in places[place]:
            return f"no {place} {name!r} in this study{suggest_nearest(name, places[place])}"
    return None
