"""Check exclusions and claims: each must be about at least one cell of the study."""

import json
from collections.abc import Collection
from typing import Any, Protocol

import numpy as np

from glossbench.brdf.material import Material
from glossbench.columns import CONDITIONS, list_costs
from glossbench.envmap.lights.light import Light
from glossbench.errors import suggest_nearest
from glossbench.scene.points import View
from glossbench.shading.method import CHANGES, METHODS, find_stages
from glossbench.study.cell_index import CellIndex, Mask
from glossbench.study.cells import Candidate
from glossbench.study.claim_names import find_unknown_name, find_unknown_place
from glossbench.study.claims import (
    KINDS,
    Claim,
    get_method,
    get_options,
    get_places,
    list_methods,
    list_names,
    list_sides,
)
from glossbench.study.document import Document, KeyPath, format_path

MAX_VALUES = 8  # a message lists at most so many
LARGER = ("higher", "greater", "larger", "more", "above", "worse")
OTHER_KEYS = ("text", "where", "than", "metric", "of", "over", "between", "equals", "paired_by", "margin", "by")


class Combinations(Protocol):
    """The part of a study that exclusions and claims are checked against: its items and all their combinations."""

    @property
    def lights(self) -> tuple[Light, ...]: ...
    @property
    def materials(self) -> tuple[Material, ...]: ...
    @property
    def views(self) -> tuple[View, ...]: ...
    @property
    def methods(self) -> tuple[Candidate, ...]: ...
    @property
    def metric_columns(self) -> list[str]: ...
    @property
    def exclude(self) -> tuple[dict[str, Any], ...]: ...
    @property
    def index(self) -> CellIndex: ...
    @property
    def kept(self) -> Mask: ...


def check_exclude(document: Document, study: Combinations, any_light: bool) -> tuple[dict[str, Any], ...]:
    """The exclusions that leave out a cell; InputError for one that does not, or that has an unknown key.

    Args:
        any_light: the lights are not those of the study's file, so that an exclusion of those may fit no cell.
    """
    index = study.index
    excluded = np.zeros(len(index.codes["method"]), bool)
    options = {key for kind in (study.methods, study.materials, study.views, study.lights) for item in kind
               for key in item.as_dict()}  # fmt: skip
    known = [*CONDITIONS, "method", *options]
    names = _collect_names(study, any_light) | {"method": {item.name for item in study.methods}}
    kept = []
    for i, entry in enumerate(study.exclude):
        path: KeyPath = ("exclude", i)
        unknown = [] if any_light else [key for key in entry if key not in known]
        if unknown and unknown[0] in names["method"]:
            hint = f"write method: {unknown[0]}, with its options as further keys"
            text = f"{format_path(path)}: unknown key {unknown[0]!r}; {hint}"
            raise document.make_error((*path, unknown[0]), text, at_key=True)
        if unknown:
            raise document.make_unknown_error(path, "key", unknown, known)
        for key, value in entry.items():
            if key in names and (problem := find_unknown_place(key, value, names)):
                raise document.make_error((*path, key), f"{format_path((*path, key))}: {problem}")
        fits = index.find_excluded(entry)
        if entry and fits.any():
            kept.append(entry)
            excluded |= fits
        elif not any_light:
            raise document.make_error(
                path, f"{format_path(path)} fits no cell{_describe_held(index, np.ones_like(fits), entry)}"
            )
    if excluded.all():
        raise document.make_error(("exclude",), "exclude leaves no cell")
    return tuple(kept)


def check_claims(document: Document, study: Combinations, any_light: bool) -> tuple[Claim, ...]:
    """The claims; InputError for one that is wrong, or for which one side has no cell."""
    methods: dict[str, set[str]] = {}
    for item in study.methods:
        methods.setdefault(item.name, set()).update(item.as_dict())
    names = _collect_names(study, any_light)
    parameters = {
        place: {key for item in items for key in item.as_dict()} for place, items in collect_places(study).items()
    }
    stages = [name for method in methods for name in find_stages(METHODS.get(method))]
    parts = {"stage_seconds": stages, "update_seconds": CHANGES}
    found: list[Claim] = []
    for i, entry in enumerate(document.data.get("claims", [])):
        path: KeyPath = ("claims", i)
        kinds = [kind for kind in KINDS if isinstance(entry, dict) and kind in entry]
        if len(kinds) != 1:
            got = " and ".join(kinds) or "none"
            text = f"{format_path(path)} needs one of the keys {', '.join(KINDS)}, got {got}"
            raise document.make_error(path, text + _suggest_kind(entry))
        claim = document.validate(KINDS[kinds[0]], path)
        problem = find_unknown_name(claim, methods, names, parameters, study.metric_columns, list_costs(parts))
        if problem:
            at = (*path, *problem[0])
            raise document.make_error(at, f"{format_path(at)}: {problem[1]}")
        found.append(claim)
    if found:
        _check_where(document, study, found, any_light)
    return tuple(found)


def _suggest_kind(entry: Any) -> str:
    """What to write instead of an unknown kind of claim."""
    keys = list(entry) if isinstance(entry, dict) else []
    if larger := next((key for key in keys if key in LARGER), None):
        return f"; instead of {larger!r} write lower, with the two sides exchanged"
    hints = (suggest_nearest(key, KINDS) for key in keys if key not in OTHER_KEYS)
    if close := next((hint for hint in hints if "did you mean" in hint), ""):
        return close
    if "than" in keys:
        return "; to state that one side has the lower error, write lower: METHOD, than: METHOD, metric: ERROR"
    is_value = {"equals", "equal", "between"} & set(keys)
    return "; to state the value of a column of one method, write value: METHOD, of: COLUMN" if is_value else ""


def _check_where(document: Document, study: Combinations, claims: list[Claim], any_light: bool) -> None:
    """InputError for a claim for which one side has no cell."""
    index, kept = study.index, study.kept
    options: dict[str, set[str]] = {}
    for item in study.methods:
        options.setdefault(item.name, set()).update(item.as_dict())
    for i, claim in enumerate(claims):
        where = {key: value for key, value in claim.where.items() if not (any_light and key == "light")}
        of_methods = set().union(*(options[name] for name in list_methods(claim)))
        for at, side in list_sides(claim).items():
            name = get_method(side)
            own = kept & index.is_called("method", name)
            wanted = {("claims", i, "where") if where else ("claims", i): where,
                      ("claims", i, *at, name): get_options(side)}  # fmt: skip
            wanted |= {("claims", i, *at, place): {place: value} for place, value in get_places(side).items()
                       if not (any_light and place == "light")}  # fmt: skip
            fits = {path: own & index.find_within(each, of_methods) for path, each in wanted.items()}
            if np.logical_and.reduce(list(fits.values())).any():
                continue
            path: KeyPath = next((path for path, each in fits.items() if not each.any()), ("claims", i))
            keys = wanted.get(path, {**where, **get_options(side), **get_places(side)})
            raise document.make_error(
                path, f"{format_path(path)} fits no cell of {name}{_describe_held(index, own, keys)}"
            )


def collect_places(study: Combinations) -> dict[str, Any]:
    """The study's lights, materials and views."""
    return {"light": study.lights, "material": study.materials, "view": study.views}


def _collect_names(study: Combinations, any_light: bool) -> dict[str, set[str]]:
    """All names that fit the study's lights, materials and views; without those of lights if any light is allowed."""
    return {
        place: {name for item in items for name in list_names(item.name, item.as_dict())}
        for place, items in collect_places(study).items()
        if not (any_light and place == "light")
    }


def _describe_held(index: CellIndex, cells: Mask, keys: Collection[str]) -> str:
    """The values of some options, or of light, material or view, in the given cells: "; they have samples 4, 8"."""
    told = []
    for key in keys:
        values = [json.dumps(value) for value in index.list_values(key, cells)]
        more = f" and {len(values) - MAX_VALUES} more" if len(values) > MAX_VALUES else ""
        told.append(f"{key} {', '.join(values[:MAX_VALUES])}{more}")
    return f"; they have {' and '.join(told)}" if told and cells.any() else ""
