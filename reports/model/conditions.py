"""The cells of a study as a report shows them: grouped by condition, named by the options in which they differ."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any

from glossbench.columns import CONDITIONS
from glossbench.findings.columns import Column
from glossbench.study.labels import distinguish_rows, format_options, identify, name_items


@dataclass(frozen=True)
class Cell:
    """One row of the table, with its names.

    Attributes:
        row: the row of cells.parquet; JSON columns parsed, missing values None.
        options: the options that distinguish it from other cells of its method, without the budget; or "".
        index: index in the study of its line, which is its method with the options in `line`.
        line: the options without those that the budget determines: they distinguish the lines of a plot.
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
        """Whether the cell has an image."""
        return bool(self.row["status"] == "done")


@dataclass(frozen=True)
class Group:
    """The cells of one light, material and view, which share a reference.

    Attributes:
        title: the names, with the options that distinguish them from others.
        options: all options of light, material and view.
        reference: values of the columns of the reference; empty if no cell is done.
        best: keys of the best cells, by metric.
        names: of light, material and view, as in the title.
        columns: of the metrics, by name.
    """

    title: str
    options: Mapping[str, Mapping[str, Any]]
    cells: Sequence[Cell]
    reference: Mapping[str, Any]
    best: Mapping[str, frozenset[str]]
    names: Mapping[str, str] = field(default_factory=dict)
    columns: Mapping[str, Column] = field(default_factory=dict)

    @property
    def done(self) -> list[Cell]:
        """The cells that have an image."""
        return [cell for cell in self.cells if cell.done]


def group_cells(rows: Sequence[dict[str, Any]], metrics: Iterable[Column]) -> list[Group]:
    """Cells by light, material and view, in the order of the study."""
    cells = _make_cells(rows)
    names = {kind: name_items(kind, rows) for kind in CONDITIONS}
    columns = {column.name: column for column in metrics}
    order = {kind: {key: i for i, key in enumerate(own)} for kind, own in names.items()}

    def place(cell: Cell) -> tuple[int, ...]:
        return tuple(order[kind][identify(kind, cell.row)] for kind in CONDITIONS)

    found = []
    for _, members in groupby(sorted(cells, key=place), key=place):
        group = sorted(members, key=lambda cell: (cell.index, cell.row["n_samples"] or 0))
        first = next((cell.row for cell in group if cell.done), {})
        named = {kind: names[kind][identify(kind, group[0].row)] for kind in CONDITIONS}
        options = {kind: group[0].row[f"{kind}_options"] for kind in CONDITIONS}
        best = {
            metric: _find_best(column, [cell.row for cell in group if cell.done]) for metric, column in columns.items()
        }
        found.append(Group(", ".join(named.values()), options, group, first, best, named, columns))
    return found


def list_methods(groups: Sequence[Group]) -> dict[str, int]:
    """The methods of the cells, each with its index, which selects its colour in the whole report."""
    cells = sorted((cell for group in groups for cell in group.cells), key=lambda cell: cell.index)
    return {method: i for i, method in enumerate(dict.fromkeys(str(cell.row["method"]) for cell in cells))}


def find_sole_method(groups: Sequence[Group]) -> str:
    """The method of all cells; "" if there are several methods."""
    methods = {str(cell.row["method"]) for group in groups for cell in group.cells}
    return methods.pop() if len(methods) == 1 else ""


def _make_cells(rows: Sequence[dict[str, Any]]) -> list[Cell]:
    """Rows as cells, each with the options that distinguish it from other cells of its method."""
    order: dict[tuple[str, str], int] = {}
    cells = []
    for row, texts in zip(rows, distinguish_rows(rows), strict=True):
        options, line = map(format_options, texts)
        index = order.setdefault((row["method"], line), len(order))
        cells.append(Cell(row, options, index, line))
    return cells


def _find_best(metric: Column, rows: Sequence[Mapping[str, Any]]) -> frozenset[str]:
    """Keys of the cells with the best value, or with one that the reference cannot distinguish from the best."""
    floor = frozenset(row["key"] for row in rows if row["at_noise_floor"])
    values = {row["key"]: abs(row[metric.name]) for row in rows if row[metric.name] is not None}
    if floor or not values:
        return floor
    ends = min if metric.lower_is_better else max
    return frozenset(key for key, value in values.items() if value == ends(values.values()))
