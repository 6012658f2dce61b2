"""The cells of a study as a report shows them: grouped by what they share, named by what tells them apart."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any

import numpy as np

from glossbench.metrics import METRICS

KINDS = ("light", "material", "view")
JSON = (*(f"{kind}_options" for kind in KINDS), "options", "tuned", "stage_seconds", "update_seconds", "notes")


@dataclass(frozen=True)
class Cell:
    """One row of the table, with its names.

    Attributes:
        row: the row of cells.parquet; JSON columns parsed, missing values None.
        options: those that tell it from the other cells of its method, budget and tuned ones aside; or "".
        index: the place in the study of this method with the options of its line.
        line: the options without those that the budget decides: what tells the lines of a plot apart.
    """

    row: Mapping[str, Any]
    options: str
    index: int
    line: str = ""

    @property
    def name(self) -> str:
        """Method and options: one line of a plot."""
        return f"{self.row['method']} ({self.line})" if self.line else str(self.row["method"])

    @property
    def done(self) -> bool:
        """True where there is an image."""
        return bool(self.row["status"] == "done")


@dataclass(frozen=True)
class Group:
    """The cells of one light, material and view, which share a reference.

    Attributes:
        title: the names, with the options that tell them from others.
        options: all options of light, material and view.
        reference: values of the reference's columns; empty where no cell was done.
        best: keys of the best cells by metric.
        names: of light, material and view, as in the title.
    """

    title: str
    options: Mapping[str, Mapping[str, Any]]
    cells: Sequence[Cell]
    reference: Mapping[str, Any]
    best: Mapping[str, frozenset[str]]
    names: Mapping[str, str] = field(default_factory=dict)

    @property
    def done(self) -> list[Cell]:
        """The cells that have an image."""
        return [cell for cell in self.cells if cell.done]


def parsed(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row with None for what is missing and values for what is JSON."""
    parsed = {key: None if isinstance(v, float) and np.isnan(v) else v for key, v in row.items()}
    for key in JSON:
        parsed[key] = json.loads(parsed.get(key) or "{}")
    return parsed


def grouped(rows: Sequence[dict[str, Any]], metrics: Sequence[str]) -> list[Group]:
    """Cells by light, material and view, in the order of the study."""
    cells = _cells(rows)
    names = {kind: names_of(kind, rows) for kind in KINDS}

    def place(cell: Cell) -> tuple[int, ...]:
        return tuple(list(names[kind]).index(identity(kind, cell.row)) for kind in KINDS)

    found = []
    for _, members in groupby(sorted(cells, key=place), key=place):
        group = sorted(members, key=lambda cell: (cell.index, cell.row["n_samples"] or 0))
        first = next((cell.row for cell in group if cell.done), {})
        named = {kind: names[kind][identity(kind, group[0].row)] for kind in KINDS}
        options = {kind: group[0].row[f"{kind}_options"] for kind in KINDS}
        best = {metric: _best(metric, [cell.row for cell in group if cell.done]) for metric in metrics}
        found.append(Group(", ".join(named.values()), options, group, first, best, named))
    return found


def told_apart(rows: Sequence[Mapping[str, Any]], over: str = "samples") -> tuple[list[str], list[str]]:
    """Options that tell the cells of one method apart, beside that which a plot is over; and without what it decides.

    Tuned options tell nothing, nor do those that are the number of samples by another name, where that is plotted over.
    """
    options = [row["options"] for row in rows]
    aside = {over} | {key for row in rows for key in row["tuned"]}
    if over == "samples":
        done = [(row["options"], row["n_samples"]) for row in rows if row["status"] == "done"]
        aside |= {key for key in _differing(options) if done and all(each.get(key) == n for each, n in done)}
    told = [key for key in _differing(options) if key not in aside]
    return told, [key for key in told if not _follows(key, over, options)]


def identity(kind: str, row: Mapping[str, Any], without: str = "") -> str:
    """What a light, material or view is, one of its parameters aside."""
    options = {key: value for key, value in row[f"{kind}_options"].items() if key != without}
    return json.dumps([row[kind], options], sort_keys=True)


def names_of(kind: str, rows: Sequence[Mapping[str, Any]], without: str = "") -> dict[str, str]:
    """By identity the name of each light, material or view, with the options in which those of one name differ."""
    known = {identity(kind, row, without): row for row in rows}
    named = {}
    for key, row in known.items():
        alike = [other[f"{kind}_options"] for other in known.values() if other[kind] == row[kind]]
        text = listed({key: row[f"{kind}_options"].get(key) for key in _differing(alike) if key != without})
        named[key] = f"{row[kind]} ({text})" if text else str(row[kind])
    return named


def _cells(rows: Sequence[dict[str, Any]]) -> list[Cell]:
    """Rows as cells, each with the options that tell it from others of its method."""
    methods = dict.fromkeys(row["method"] for row in rows)
    told = {method: told_apart([row for row in rows if row["method"] == method]) for method in methods}
    order: dict[tuple[str, str], int] = {}
    cells = []
    for row in rows:
        options, line = (listed({key: row["options"].get(key) for key in keys}) for keys in told[row["method"]])
        index = order.setdefault((row["method"], line), len(order))
        cells.append(Cell(row, options, index, line))
    return cells


def _follows(key: str, over: str, options: Sequence[Mapping[str, Any]]) -> bool:
    """Whether one option alone decides another, as where a study pairs them: then that tells no two lines apart.

    Two values of a budget may go with one of the other; of what is no budget each must have its own.
    """
    values: dict[str, set[str]] = {}
    for each in options:
        values.setdefault(json.dumps(each.get(over)), set()).add(json.dumps(each.get(key)))
    n_found = len(set[str]().union(*values.values()))
    is_single = len(values) > 1 and all(len(found) == 1 for found in values.values())
    return is_single and (over == "samples" or n_found == len(values))


def _differing(options: Sequence[Mapping[str, Any]]) -> list[str]:
    """Keys, in order, whose value is not the same in all."""
    keys = dict.fromkeys(key for each in options for key in each)
    return [key for key in keys if len({json.dumps(each.get(key)) for each in options}) > 1]


def listed(options: Mapping[str, Any]) -> str:
    return ", ".join(f"{key} {as_text(value)}" for key, value in options.items())


def as_text(value: Any) -> str:
    """The value of an option, as names have it."""
    if isinstance(value, float):
        return f"{value:.4g}".replace("-", "−")
    if isinstance(value, list):
        return f"[{', '.join(as_text(each) for each in value)}]"
    return value if isinstance(value, str) else json.dumps(value)


def _best(metric: str, rows: Sequence[Mapping[str, Any]]) -> frozenset[str]:
    """Keys of the cells with the best value; all that the reference cannot tell apart share the place."""
    floor = frozenset(row["key"] for row in rows if row["at_noise_floor"])
    values = {row["key"]: abs(row[metric]) for row in rows if row[metric] is not None}
    if floor or not values:
        return floor
    registered = METRICS.get(metric) if metric in METRICS.names() else None
    ends = min if registered is None or registered.lower_is_better else max
    return frozenset(key for key, value in values.items() if value == ends(values.values()))
