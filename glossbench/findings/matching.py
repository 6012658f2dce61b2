"""Matching: the cells that two results share, found by what the cells are, because their keys also hash the source."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePath
from typing import Any, NamedTuple

from glossbench.columns import CONDITIONS
from glossbench.findings.comparisons import Row
from glossbench.study.claims import SEED
from glossbench.study.labels import read_stated

Held = dict[tuple[str, str], set[str]]  # the options of the items of a kind and name
Group = Sequence[Row]  # one cell, or cells that differ only in their seed


class Match(NamedTuple):
    """The cells of two results.

    Attributes:
        pairs: cells that both have, in the order of the second.
        vanished: cells that only the first has.
        appeared: cells that only the second has.
    """

    pairs: Sequence[tuple[Group, Group]]
    vanished: Sequence[Group]
    appeared: Sequence[Group]


def match_cells(before: Iterable[Row], after: Iterable[Row]) -> Match:
    """Match cells that have the same light, material, view and method with equal options.

    An option that only one of the results knows, because the class of the item had no such option in the other, does
    not distinguish cells, unless this result has several cells that differ in it. A file is known by its name, without
    its folder. A tuned option is known by how it was tuned.

    Args:
        before: parsed rows of the first result.
    """
    tables = [list(before), list(after)]
    first, second = (_collect_options(rows) for rows in tables)
    shared = {item: first[item] & second[item] for item in first.keys() & second.keys()}
    a, b = (_group(rows, shared) for rows in tables)
    return Match(
        [(a[key], group) for key, group in b.items() if key in a],
        [group for key, group in a.items() if key not in b],
        [group for key, group in b.items() if key not in a],
    )


def without_folders(value: Any, key: str = "") -> Any:
    """JSON data in which each option `file` is the file's name without its folder."""
    if isinstance(value, Mapping):
        return {name: without_folders(each, name) for name, each in value.items()}
    if isinstance(value, list):
        return [without_folders(each, key) for each in value]
    return PurePath(value).name if key == "file" and isinstance(value, str) else value


def _list_items(row: Row) -> dict[tuple[str, str], dict[str, Any]]:
    """The options of the light, material, view and method of a cell, by kind and name."""
    options = {kind: row[f"{kind}_options"] for kind in CONDITIONS} | {"method": read_stated(row)}
    options["method"].pop(SEED, None)  # it has no effect, or the cells are one case of several seeds
    return {(kind, row[kind]): own for kind, own in options.items()}


def _collect_options(rows: Iterable[Row]) -> Held:
    held: Held = {}
    for row in rows:
        for item, options in _list_items(row).items():
            held.setdefault(item, set()).update(options)
    return held


def _group(rows: Iterable[Row], shared: Held) -> dict[str, list[Row]]:
    """The rows by the identity of their cells."""
    groups: dict[str, dict[str, list[Row]]] = {}  # by the shared options, then by all options
    for row in rows:
        items = _list_items(row)
        known = [
            [*item, {key: value for key, value in own.items() if key in shared.get(item, own)}]
            for item, own in items.items()
        ]
        whole = [[*item, own] for item, own in items.items()]
        groups.setdefault(_to_text(known), {}).setdefault(_to_text(whole), []).append(row)
    found: dict[str, list[Row]] = {}
    for key, members in groups.items():
        found |= {key: next(iter(members.values()))} if len(members) == 1 else members
    return found


def _to_text(items: Any) -> str:
    return json.dumps(without_folders(items), sort_keys=True)
