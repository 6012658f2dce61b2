"""Tables for print: those of the model, laid out for a page, with captions."""

from collections.abc import Mapping, Sequence
from math import inf
from typing import Any

from ..model.cell_table import CHANGES, list_costs, list_counts, list_errors, make_cell_table, without_notes
from ..model.equal import EqualTables
from ..model.report import Report
from ..model.table import Row, Table
from ..model.tables import make_claim_table, make_equal_table, make_reference_table

MOST_ROWS, FEWEST_ROWS = 600, 5  # of a table, in all and of one part
MOST_LINES = 40  # of a table of equal times or errors
MOST_METRICS = 6  # of one table, so that it fits a page
BESIDE_ERRORS = ("shade_seconds", "state_bytes")  # costs that stand beside errors, too
ERRORS = (
    "Errors and costs of all cells. Bold: the best of its light, material and view. At the noise floor: the RMS "
    "error is within twice the reference's own noise, so the reference cannot tell how large it is; such cells "
    "share the best place. After ±, half the 95 % interval that the noise of the reference leaves. Shading time of "
    "warm runs; state is what the stages leave in memory."
)
COSTS = "Costs of all cells. Stages: all precomputation; new: the part of it that must be redone when that changes."
CELLS = "cells: all are in cells.parquet"


def make_error_tables(report: Report) -> list[dict[str, Any]]:
    """Errors of all cells with what each took of time and memory, so many metrics a table."""
    parts = [report.metrics[i : i + MOST_METRICS] for i in range(0, len(report.metrics), MOST_METRICS)] or [[]]
    counts, costs = list_counts(report), [without_notes(each) for each in list_costs(report, BESIDE_ERRORS)]
    tables = [
        make_cell_table(report, [*counts, *list_errors(report, part), *costs], _limit_rows(report)) for part in parts
    ]
    return [_print_table(table, ERRORS, CELLS, report.sole_method) for table in tables]


def make_cost_table(report: Report) -> dict[str, Any]:
    """Precomputation of all cells, and what of it each change asks for again, where it asks for anything."""
    done = [cell.row for group in report.done for cell in group.done]
    unasked = [change for change in CHANGES if not any(row["update_seconds"].get(change, 0) > 0 for row in done)]
    costs = [each for each in list_costs(report) if not (each.head.group and each.head.title in unasked)]
    table = make_cell_table(report, [*list_counts(report), *costs], _limit_rows(report), only_done=True)
    caption = " ".join([COSTS, *report.time_notes])
    if unasked:
        caption += f" Nothing must be redone for a new {' or '.join(unasked)}."
    return _print_table(table, caption, CELLS, report.sole_method)


def print_references(report: Report) -> dict[str, Any] | None:
    """The references; None where there is none."""
    table = make_reference_table(report)
    caption = "The references. Noise: RMS, over masked pixels and channels, of the standard error."
    return _print_table(table, caption, "") if table.parts[0].rows else None


def print_equal(equal: EqualTables) -> list[dict[str, Any]]:
    """What each line would reach at equal times and at equal errors, between the points it has."""
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
            caption += "; a line of one budget, or of none, has its own error at any time that suffices for it"
        if any(value and value.has_spread for values in table.rows for value in values):
            caption += "; below, by the fastest and the slowest runs: where these overlap no line is the best"
        if any(value and value.high == inf for values in table.rows for value in values):
            caption += "; ∞: the slowest run does not end in that time"
        more = "lines, which count for what is best"
        found.append(_print_table(make_equal_table(table, "", unit, MOST_LINES), f"{caption}.", more))
    return found


def print_claim(claim: Mapping[str, Any]) -> dict[str, Any]:
    """The cases of a claim."""
    table = make_claim_table(claim, MOST_ROWS)
    return _print_table(table, f"{claim['text']}: {claim['verdict']}.", "cases: all are in claims.json")


def _limit_rows(report: Report) -> int:
    return max(FEWEST_ROWS, MOST_ROWS // max(1, len(report.groups)))


def _print_table(table: Table, caption: str, more: str, sole_method: str = "") -> dict[str, Any]:
    """What the template reads; a sole method heads the column of its options."""
    heads = [{"title": f"new\n{head.title}" if head.group else head.title, "unit": head.unit} for head in table.heads]
    groups = []
    for part in table.parts:
        rows = [_print_row(row, sole_method) for row in part.rows]
        if part.left_out:
            rows.append({"name": "…", "options": "", "outcome": f"and {part.left_out} more {more}"})
        groups.append({"title": part.title, "rows": rows})
    first = {"title": sole_method or table.names[0].title, "unit": ""}
    return {"caption": caption, "columns": [first, *heads], "groups": groups}


def _print_row(row: Row, sole_method: str) -> dict[str, Any]:
    name, options = row.names[0], row.cell.options if row.cell else ""
    if sole_method and options:
        name, options = options, ""
    if row.outcome:
        return {"name": name, "options": options, "outcome": row.outcome}
    cells: Sequence[dict[str, Any]] = [
        {"text": f"{each.text}\n{each.note}" if each.note else each.text, "best": each.is_best, "span": each.span}
        for each in row.entries
    ]
    return {"name": name, "options": options, "cells": cells}
