"""Tables for print: those of the model, laid out for a page, with captions."""

from collections.abc import Mapping, Sequence
from math import inf
from typing import Any

from glossbench.shading.method import CHANGES

from ..model.cell_table import list_costs, list_counts, list_errors, make_cell_table, without_notes
from ..model.decision import RANKS, decide
from ..model.equal import EqualTables
from ..model.report import Report
from ..model.table import Row, Table
from ..model.tables import make_claim_table, make_equal_table, make_reference_table

MOST_ROWS, FEWEST_ROWS = 600, 5  # of a table, in total and of one part
MOST_LINES = 40  # of a table of equal times or errors
MOST_METRICS = 6  # of one table, so that it fits a page
BESIDE_ERRORS = ("shade_seconds", "state_bytes")  # costs that are shown with errors, too
ERRORS = (
    "Errors and costs of all cells. Bold: the best of its light, material and view. At the noise floor: the RMS "
    "error is below twice the noise of the reference, which is not accurate enough to measure it; all such cells "
    "are equally good. After ±: half of the 95 % interval from the noise of the reference. Shading times are of "
    "warm runs; state is the memory that the stages keep."
)
COSTS = "Costs of all cells. Stages: all precomputation; new X: the part that must be redone if X changes."
CELLS = "cells: all are in cells.parquet"


def make_error_tables(report: Report) -> list[dict[str, Any]]:
    """Errors of all cells with their time and memory, at most `MOST_METRICS` metrics per table."""
    parts = [report.metrics[i : i + MOST_METRICS] for i in range(0, len(report.metrics), MOST_METRICS)] or [[]]
    counts, costs = list_counts(report), [without_notes(each) for each in list_costs(report, BESIDE_ERRORS)]
    tables = [
        make_cell_table(report, [*counts, *list_errors(report, part), *costs], _limit_rows(report)) for part in parts
    ]
    return [_print_table(table, ERRORS, CELLS, report.sole_method) for table in tables]


def make_cost_table(report: Report) -> dict[str, Any]:
    """Precomputation of all cells, and the part of it that each change requires again, if it requires any."""
    done = [cell.row for group in report.done for cell in group.done]
    unasked = [change for change in CHANGES if not any(row["update_seconds"].get(change, 0) > 0 for row in done)]
    costs = [each for each in list_costs(report) if not (each.head.group and each.head.title in unasked)]
    table = make_cell_table(report, [*list_counts(report), *costs], _limit_rows(report), only_done=True)
    caption = " ".join([COSTS, *report.time_notes])
    if unasked:
        caption += f" Nothing must be redone for a new {' or '.join(unasked)}."
    return _print_table(table, caption, CELLS, report.sole_method)


def print_references(report: Report) -> dict[str, Any] | None:
    """The references; None if there are none."""
    table = make_reference_table(report)
    caption = "The references. Noise: RMS, over masked pixels and channels, of the standard error."
    return _print_table(table, caption, "") if table.parts[0].rows else None


def print_equal(equal: EqualTables) -> list[dict[str, Any]]:
    """Interpolated values of each line at equal times and at equal errors."""
    found = []
    at, label = equal.place.title, equal.axis.label
    for table, what, unit in (
        (equal.by_time, f"{label} at equal shading time", "ms"),
        (equal.by_error, f"shading time [ms] at equal {label}", ""),
    ):
        if table is None:
            continue
        caption = f"{at}: {what}, by interpolation"
        if table.has_points:
            caption += "; a line with one point has its error at any time that is long enough"
        if any(value and value.has_spread for values in table.rows for value in values):
            caption += "; below, by the fastest and the slowest run: if these intervals overlap, no line is the best"
        if any(value and value.high == inf for values in table.rows for value in values):
            caption += "; ∞: the slowest run needs more than that time"
        more = "lines, which are also compared"
        found.append(_print_table(make_equal_table(table, "", unit, MOST_LINES), f"{caption}.", more))
    return found


def print_claim(claim: Mapping[str, Any]) -> dict[str, Any]:
    """The cases of a claim."""
    table = make_claim_table(claim, MOST_ROWS)
    return _print_table(table, f"{claim['text']}: {claim['verdict']}.", "cases: all are in claims.json")


def print_decision(report: Report) -> list[dict[str, Any]]:
    """Which method to take, and ranks with fronts; nothing if no two methods can be compared."""
    if (found := decide(report)) is None:
        return []
    return [_print_table(found.table, found.explained, "choices"), _print_table(found.ranks, RANKS, "configurations")]


def _limit_rows(report: Report) -> int:
    return max(FEWEST_ROWS, MOST_ROWS // max(1, len(report.groups)))


def _print_table(table: Table, caption: str, more: str, sole_method: str = "") -> dict[str, Any]:
    """The data for the template; if there is only one method, it is the head of the column of options."""
    heads = [
        {
            "title": f"{head.group.split(', ')[-1]}\n{head.title}" if head.group else head.title,
            "unit": head.unit,
            "is_number": head.is_number,
        }
        for head in table.heads
    ]
    groups = []
    for part in table.parts:
        rows = [_print_row(row, sole_method) for row in part.rows]
        if part.left_out:
            rows.append({"name": "…", "options": "", "outcome": f"and {part.left_out} more {more}"})
        groups.append({"title": part.title, "rows": rows})
    first = {"title": sole_method or table.names[0].title, "unit": "", "is_number": False}
    return {"caption": caption, "columns": [first, *heads], "groups": groups}


def _print_row(row: Row, sole_method: str) -> dict[str, Any]:
    name = row.names[0]
    options = row.cell.options if row.cell and name == row.cell.row["method"] else ""
    if sole_method and options:
        name, options = options, ""
    if row.outcome:
        return {"name": name, "options": options, "outcome": row.outcome}
    cells: Sequence[dict[str, Any]] = [
        {"text": f"{each.text}\n{each.note}" if each.note else each.text, "best": each.is_best, "span": each.span}
        for each in row.entries
    ]
    return {"name": name, "options": options, "cells": cells}
