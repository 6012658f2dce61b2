"""Tables of cells, with columns from the table of columns of the results.

A new column of the results becomes a column of the table, next to the other counts, errors or costs, with its unit.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from glossbench.columns import read_cost
from glossbench.findings.columns import Column
from glossbench.findings.estimates import Estimate
from glossbench.shading.method import CHANGES
from glossbench.study.labels import format_options, read_budget

from ..style import format_number, format_whole
from .conditions import Cell, Group
from .report import Report
from .table import Entry, Head, Part, Row, Table
from .times import format_spread

# The columns that most readers look for, in this order and with these short names; the other counts and costs follow.
LAYOUT = {
    "n_samples": "samples", "shade_seconds": "shade", "stage_seconds": "stages", "update_seconds": "update",
    "state_bytes": "state",
}  # fmt: skip


class Quantity(NamedTuple):
    """The head of a column, and the function that computes its entries."""

    head: Head
    entry: Callable[[Cell, Group], Entry]


def list_counts(report: Report) -> list[Quantity]:
    """Numbers of samples and the like."""
    return [_make_count(column) for column in _order_columns(report.columns.values(), "count")]


def list_errors(report: Report, metrics: Sequence[str]) -> list[Quantity]:
    """Metrics."""
    return [_make_error(report.columns[metric], report.estimate) for metric in metrics]


def list_costs(report: Report, only: Sequence[str] = ()) -> list[Quantity]:
    """Times and memory: one column for the update cost of each change; other costs with parts are shown as a sum.

    Args:
        only: names of columns; empty for all.
    """
    found: list[Quantity] = []
    for column in _order_columns(report.columns.values(), "cost"):
        if only and column.name not in only:
            continue
        if column.name == "update_seconds":
            found += [_make_cost(column, change) for change in CHANGES]
        else:
            found.append(_make_cost(column))
    return found


def without_notes(quantity: Quantity) -> Quantity:
    """The same quantity without the notes below its numbers."""
    return Quantity(quantity.head, lambda cell, group: quantity.entry(cell, group)._replace(note=""))


def make_cell_table(report: Report, quantities: Sequence[Quantity], most: int, only_done: bool = False) -> Table:
    """One row per cell, in one part per light, material and view.

    Args:
        most: largest number of rows of a part.
        only_done: leave out cells without an image.
    """
    cells = [cell for group in report.groups for cell in group.cells]
    has_options, has_tuned = any(c.options for c in cells), any(c.row["tuned"] for c in cells)
    titles = ["method", *(["options"] if has_options else []), *(["tuned"] if has_tuned else [])]
    parts = []
    for group in report.groups:
        members = group.done if only_done else group.cells
        rows = [_make_row(cell, group, quantities, has_options, has_tuned) for cell in members[:most]]
        if rows:
            parts.append(Part(group.title, rows, max(0, len(members) - most)))
    return Table([Head(title, is_number=False) for title in titles], [each.head for each in quantities], parts)


def make_stage_table(report: Report, most: int) -> Table:
    """The stages of each cell one by one."""
    rows, left_out = [], 0
    for group in report.done:
        for cell in group.done[:most]:
            seconds = cell.row["stage_seconds"].items()
            stages = " + ".join(f"{name} {format_number(1e3 * each)}" for name, each in seconds) or "none"
            rows.append(Row([group.title, cell.name], [Entry(format_whole(cell.row["n_samples"])), Entry(stages)]))
        left_out += max(0, len(group.done) - most)
    names = [Head("light, material, view", is_number=False), Head("method", is_number=False)]
    heads = [Head(LAYOUT["n_samples"]), Head("stages", "ms", is_number=False)]
    return Table(names, heads, [Part("", rows, left_out)])


def explain_outcome(cell: Cell) -> str:
    """Why a cell has no image, in one line."""
    lines = (cell.row["reason"] or "no reason is known").strip().splitlines()
    return f"{cell.row['status']}: {lines[-1] if cell.row['status'] == 'failed' else ' '.join(lines)}"


def _make_row(cell: Cell, group: Group, quantities: Sequence[Quantity], has_options: bool, has_tuned: bool) -> Row:
    tuned = [format_options(cell.row["tuned"])] if has_tuned else []
    names = [str(cell.row["method"]), *([cell.options] if has_options else []), *tuned]
    if not cell.done:
        budget = read_budget(cell.row)
        asked = Entry("" if budget is None else format_whole(budget), sort=budget)
        return Row(names, [asked], explain_outcome(cell), cell, [*names, budget])
    entries = [each.entry(cell, group) for each in quantities]
    sort = [*names, *(entry.sort for entry in entries)]
    return Row(names, _merge(entries, quantities, cell), cell=cell, sort=sort)


def _merge(entries: Sequence[Entry], quantities: Sequence[Quantity], cell: Cell) -> list[Entry]:
    """The entries, with one entry in place of all metrics if the reference cannot resolve them."""
    is_error = [each.head.role == "error" for each in quantities]
    if not cell.row["at_noise_floor"] or not any(is_error):
        return list(entries)
    noise = 2 * cell.row["reference_noise"]
    floor = Entry(
        f"at the noise floor (RMS ≤ {format_number(noise, 2)})", "", True, span=sum(is_error),
        hint=f"RMS at most {format_number(noise)}, twice the reference's noise",
    )  # fmt: skip
    first = is_error.index(True)
    return [*entries[:first], floor, *entries[first + sum(is_error) :]]


def _order_columns(columns: Iterable[Column], role: str) -> list[Column]:
    """The columns of a role; those with a fixed place come first."""
    order = list(LAYOUT)
    own = [column for column in columns if column.role == role]
    return sorted(own, key=lambda column: order.index(column.name) if column.name in order else len(order))


def _make_title(column: Column) -> str:
    return LAYOUT.get(column.name) or column.title or column.name


def _make_count(column: Column) -> Quantity:
    def entry(cell: Cell, group: Group) -> Entry:
        value = cell.row.get(column.name)
        return Entry(format_whole(value), sort=value)

    return Quantity(Head(_make_title(column), column.unit, column.name, role="count"), entry)


def _make_error(column: Column, estimate: Callable[[Mapping[str, Any], str], Estimate]) -> Quantity:
    def entry(cell: Cell, group: Group) -> Entry:
        value = cell.row.get(column.name)
        sort = 0.0 if cell.row["at_noise_floor"] else value
        is_best = cell.row["key"] in group.best.get(column.name, ())
        note = "" if value is None else _format_uncertainty(estimate(cell.row, column.name))
        return Entry(format_number(value), note, is_best, sort)

    return Quantity(Head(_make_title(column), column.unit, column.name, role="error"), entry)


def _format_uncertainty(found: Estimate) -> str:
    """Half of the 95 % interval from the noise of the reference; "" if it is not known."""
    return f"± {format_number(found.half_width, 2)}" if found.half_width > 0 else ""


def _make_cost(column: Column, part: str = "") -> Quantity:
    """A cost; of a cost with parts, one part or the sum."""

    def read_value(row: Mapping[str, Any], name: str) -> float | None:
        value = read_cost(row, name, part)
        return None if value is None else column.scale * value

    def entry(cell: Cell, group: Group) -> Entry:
        value, low, high = (read_value(cell.row, f"{column.name}{end}") for end in ("", "_low", "_high"))
        return Entry(format_number(value), format_spread(value, low, high), sort=value)

    if part:
        return Quantity(Head(part, column.unit, column.name, f"{_make_title(column)}, new", "cost"), entry)
    return Quantity(Head(_make_title(column), column.unit, column.name, role="cost"), entry)
