"""Rows of the table of results: their values, and names made of the options that distinguish them."""

import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from glossbench.columns import CONDITIONS, parse_row

Texts = dict[str, str]


def read_stated(row: Mapping[str, Any]) -> dict[str, Any]:
    """The options of a cell as its study states them: for a tuned option how it was tuned, not the value found."""
    how = {key: {"tune": ""} for key in row["tuned"]} | dict(row.get("tune") or {})
    return {**row["options"], **how}


def read_number(value: Any) -> float | None:
    """The number that a value states: a number itself, or a list of equal numbers, such as isotropic m; else None."""
    if isinstance(value, list) and value and all(each == value[0] for each in value):
        return read_number(value[0])
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def read_budget(row: Mapping[str, Any]) -> float | None:
    """The stated value of the budget option of a cell's method; None without a budget, or if the budget is tuned."""
    return read_number(read_stated(row).get(row["budget"]))


def distinguish_rows(rows: Sequence[Mapping[str, Any]], over: str | None = None) -> list[tuple[Texts, Texts]]:
    """For each row, two sets of options as text: (distinguishing, independent of `over`).

    The first are the options that distinguish the row from the other rows of its method, without the plotted option
    `over`, and without the number of samples under another name. The second leaves out, too, the options whose value
    `over` alone determines, as when a study pairs two options. A tuned option states how it was tuned, not its value.
    An option that is null is left out: it was not chosen.

    Args:
        over: the option on the horizontal axis of a plot, or a parameter such as "material.s"; None is the budget of
            each method.
    """
    found: list[tuple[Texts, Texts]] = [({}, {})] * len(rows)
    methods: dict[str, list[int]] = {}
    for i, row in enumerate(rows):
        methods.setdefault(row["method"], []).append(i)
    for places in methods.values():
        own = _distinguish_rows([rows[i] for i in places], over)
        for i, texts in zip(places, own, strict=True):
            found[i] = texts
    return found


def _distinguish_rows(rows: Sequence[Mapping[str, Any]], over: str | None) -> list[tuple[Texts, Texts]]:
    """As `distinguish_rows`, for the rows of one method."""
    every = [read_stated(row) for row in rows]
    keys = {row["budget"] for row in rows} if over is None else {over}
    asked = [each.get(row["budget"] if over is None else over) for row, each in zip(rows, every, strict=True)]
    if over is None:
        done = [(row["options"], row["n_samples"]) for row in rows if row["status"] == "done"]
        keys |= {key for key in find_differing(every) if done and all(options.get(key) == n for options, n in done)}
    shown = [{key: v for key, v in each.items() if key not in keys or _is_tuned(v)} for each in every]
    texts = {key: format_values(each[key] for each in shown if key in each) for key in find_differing(shown)}
    free = {key for key in texts if key in keys or not _follows([each.get(key) for each in shown], asked, over is None)}
    told = [{key: text[_make_key(each[key])] for key, text in texts.items() if each.get(key) is not None}
            for each in shown]  # fmt: skip
    return [(own, {key: text for key, text in own.items() if key in free}) for own in told]


def identify(kind: str, row: Mapping[str, Any], without: str = "") -> str:
    """The name and options of a light, material or view as text, without one of its parameters."""
    options = {key: value for key, value in row[f"{kind}_options"].items() if key != without}
    return json.dumps([row[kind], options], sort_keys=True)


def name_items(kind: str, rows: Iterable[Mapping[str, Any]], without: str = "") -> Texts:
    """By identity, a unique name for each light, material or view.

    A file has as its name the shortest end of its path that no other file has. The options in which items of one name
    differ follow in brackets.
    """
    known = {identify(kind, row, without): row for row in rows}
    alike: dict[str, list[dict[str, Any]]] = {}
    options = {key: {k: v for k, v in row[f"{kind}_options"].items() if k != without} for key, row in known.items()}
    for key, row in known.items():
        alike.setdefault(row[kind], []).append(options[key])
    files = _shorten_paths([v for each in options.values() for key, v in each.items() if _is_path(key, v)])
    telling = {
        name: {key: format_values(each.get(key) for each in every) for key in find_differing(every) if key != "file"}
        for name, every in alike.items()
    }
    named = {}
    for key, row in known.items():
        own = options[key]
        file = files.get(own["file"], "") if _is_path("file", own.get("file")) else ""
        called = " ".join(part for part in ("" if file and row[kind] == "file" else str(row[kind]), file) if part)
        told = {name: files.get(text[_make_key(own.get(name))], text[_make_key(own.get(name))])
                for name, text in telling[row[kind]].items()}  # fmt: skip
        named[key] = with_options(called, told)
    return _make_unique(named)


def with_names(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The rows of a whole table, with the names of reports as `light_name`, `material_name` and `view_name`."""
    read = [parse_row(row) for row in rows]
    names = {kind: name_items(kind, read) for kind in CONDITIONS}
    return [
        {**row, **{f"{kind}_name": names[kind][identify(kind, each)] for kind in CONDITIONS}}
        for row, each in zip(rows, read, strict=True)
    ]


def with_options(name: str, options: Mapping[str, Any]) -> str:
    """A name with options in brackets: "ggx (alpha 0.1)"."""
    return f"{name} ({format_options(options)})" if options else name


def format_options(options: Mapping[str, Any]) -> str:
    """Options as text, as in names.

    >>> format_options({"samples": 14, "m": [0.1, 0.04], "filter": "gauss"})
    'samples 14, m [0.1, 0.04], filter gauss'
    """
    return ", ".join(f"{key} {as_text(value)}" for key, value in options.items())


def as_text(value: Any, digits: int = 4) -> str:
    """The value of an option as text, as in names; with more than 4 digits, a tuned option also has its range."""
    if isinstance(value, float):
        return f"{value:.{digits}g}".replace("-", "−")
    if isinstance(value, list):
        return f"[{', '.join(as_text(each, digits) for each in value)}]"
    if _is_tuned(value):
        span = f"in {as_text(value['range'])}" if digits > 4 and "range" in value else ""
        return " ".join(part for part in ("tuned", value["tune"] and f"by {value['tune']}", span) if part)
    return value if isinstance(value, str) else json.dumps(value)


def format_values(values: Iterable[Any]) -> Texts:
    """The text of each value, by its JSON, with enough digits that different values have different texts.

    >>> format_values([0.12345678, 0.5])
    {'0.12345678': '0.1235', '0.5': '0.5'}
    >>> format_values([0.12345678, 0.12345])
    {'0.12345678': '0.1234568', '0.12345': '0.12345'}
    """
    known = {_make_key(value): value for value in values}
    texts: Texts = {}
    for digits in (4, 7, 17):
        texts = {key: as_text(value, digits) for key, value in known.items()}
        if len(set(texts.values())) == len(known):
            return texts
    return {key: text if Counter(texts.values())[text] == 1 else key for key, text in texts.items()}


def _make_key(value: Any) -> str:
    return json.dumps(value, sort_keys=True)


def _is_tuned(value: Any) -> bool:
    return isinstance(value, dict) and "tune" in value


def _is_path(key: str, value: Any) -> bool:
    """Whether an option names a file: a guess from the name and the value of the option."""
    return isinstance(value, str) and (key == "file" or "/" in value or "\\" in value)


def _shorten_paths(paths: Iterable[str]) -> Texts:
    """For each path, its fewest last parts that no other path ends with."""
    parts = {path: [part for part in re.split(r"[/\\]+", path) if part not in ("", ".")] for path in paths}
    short: Texts = {}
    for n in range(1, 1 + max(map(len, parts.values()), default=0)):
        ends = {path: "/".join(own[-n:]) for path, own in parts.items() if path not in short}
        count = Counter(ends.values())
        short |= {path: end for path, end in ends.items() if count[end] == 1}
    return {path: short.get(path, path) for path in parts}


def _make_unique(names: Texts) -> Texts:
    """Unique names: a name that an earlier one has already gets a number."""
    count: Counter[str] = Counter()
    found = {}
    for key, name in names.items():
        count[name] += 1
        found[key] = name if count[name] == 1 else f"{name} #{count[name]}"
    return found


def _follows(values: Sequence[Any], asked: Sequence[Any], is_budget: bool) -> bool:
    """Whether one option alone determines another, as when a study pairs them; the other then distinguishes no lines.

    For a sample budget the mapping may be many-to-one; for any other option it must be one-to-one.
    """
    found: dict[str, set[str]] = {}
    for value, decides in zip(values, asked, strict=True):
        found.setdefault(_make_key(decides), set()).add(_make_key(value))
    n_found = len(set[str]().union(*found.values()))
    is_single = len(found) > 1 and all(len(own) == 1 for own in found.values())
    return is_single and (is_budget or n_found == len(found))


def find_differing(options: Sequence[Mapping[str, Any]]) -> list[str]:
    """Keys, in order, whose values are not all equal.

    >>> find_differing([{"m": 0.1, "f0": 1.0}, {"m": 0.2, "f0": 1.0}, {"m": 0.2, "f0": 1.0, "kd": 0.5}])
    ['m', 'kd']
    """
    keys = dict.fromkeys(key for each in options for key in each)
    return [key for key in keys if len({_make_key(each.get(key)) for each in options}) > 1]
