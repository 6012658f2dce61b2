"""Tables for print: what each cell reached and cost, the references, and the numbers behind verdicts, as text."""

from collections.abc import Callable, Mapping, Sequence
from math import inf
from typing import Any

from glossbench.metrics import METRICS
from glossbench.study.labels import listed

from ..model.conditions import Cell, Group, sole_method
from ..model.equal import Table
from ..model.lines import named
from ..model.times import shade_spread, spread_of, time_notes
from ..style import number, tick, whole

Texts = list[dict[str, Any]]
MOST_ROWS, FEWEST_ROWS = 600, 5  # of a table, in all and of one part
MOST_LINES = 40  # of a table of equal times or errors
MOST_METRICS = 6  # of one table, so that it fits a page
CHANGES = ("light", "material", "geometry", "view")


def error_tables(groups: Sequence[Group], metrics: Sequence[str]) -> list[dict[str, Any]]:
    """Errors of all cells with what each took of time and memory, so many metrics a table."""
    parts = [metrics[i : i + MOST_METRICS] for i in range(0, len(metrics), MOST_METRICS)] or [[]]
    return [_errors(groups, part) for part in parts]


def _errors(groups: Sequence[Group], metrics: Sequence[str]) -> dict[str, Any]:
    columns = [_column("method"), _column("samples"), *(_column(name, _unit(name)) for name in metrics)]
    columns += [_column("shade", "ms"), _column("state", "MB")]

    def texts(cell: Cell, group: Group) -> Texts:
        row = cell.row
        if row["at_noise_floor"] and metrics:
            floor = f"at the noise floor, RMS ≤ {number(2 * row['reference_noise'], 2)}"
            errors = [_text(floor, True, len(metrics))]
        else:
            errors = [_text(number(row.get(name)), row["key"] in group.best[name]) for name in metrics]
        costs = number(1e3 * row["shade_seconds"]), number(row["state_bytes"] / 1e6)
        return [_text(whole(row["n_samples"])), *errors, *map(_text, costs)]

    caption = (
        "Errors and costs of all cells. Bold: the best of its light, material and view. At the noise floor: the RMS "
        "error is within twice the reference's own noise, so the reference cannot tell how large it is; such cells "
        "share the best place. Shading time of warm runs; state is what the stages leave in memory."
    )
    return _table(caption, columns, groups, texts)


def cost_table(groups: Sequence[Group]) -> dict[str, Any]:
    """Precomputation of all cells, and what of it each change asks for again, where it asks for anything."""
    done = [cell.row for group in groups for cell in group.done]
    asked = [change for change in CHANGES if any(row["update_seconds"].get(change, 0) > 0 for row in done)]
    columns = [_column("method"), _column("samples"), _column("shade", "ms"), _column("stages", "ms")]
    columns += [_column(f"new\n{change}", "ms") for change in asked] + [_column("state", "MB")]

    def texts(cell: Cell, group: Group) -> Texts:
        row = cell.row
        seconds = [row["shade_seconds"], sum(row["stage_seconds"].values())]
        seconds += [row["update_seconds"].get(change, 0) for change in asked]
        state = _text(number(row["state_bytes"] / 1e6))
        times = [number(1e3 * s) for s in seconds]
        times[0] = _with_spread(times[0], shade_spread(row))
        return [_text(whole(row["n_samples"])), *map(_text, times), state]

    caption = (
        "Costs of all cells. Stages: all precomputation; new: the part of it that must be redone when that changes."
    )
    caption = " ".join([caption, *time_notes(done)])
    if unasked := [change for change in CHANGES if change not in asked]:
        caption += f" Nothing must be redone for a new {' or '.join(unasked)}."
    return _table(caption, columns, groups, texts, only_done=True)


def reference_table(groups: Sequence[Group]) -> dict[str, Any] | None:
    """The references; None where there is none."""
    rows = []
    for group in groups:
        if r := group.reference:
            mean, noise, target = (r.get(f"reference_{what}") for what in ("mean", "noise", "target"))
            relative = number(noise / mean, 2) if mean and noise is not None else "–"
            if target and noise and mean and noise > target:
                relative += f" (target {number(target / mean, 2)} not met)"
            texts = [number(mean), number(noise, 2), relative, whole(r["reference_samples"])]
            texts.append(number(r["reference_seconds"]))
            rows.append({"name": group.title, "options": "", "cells": [_text(text) for text in texts]})
    if not rows:
        return None
    columns = [_column("light, material, view"), _column("mean", "radiance"), _column("noise", "radiance")]
    columns += [_column("noise / mean"), _column("samples", "a pixel, all techniques"), _column("time", "s")]
    caption = "The references. Noise: RMS, over masked pixels and channels, of the standard error."
    return {"caption": caption, "columns": columns, "groups": [{"title": "", "rows": rows}]}


def equal_table(table: Table, caption: str, unit: str) -> dict[str, Any]:
    """What each line would reach at equal times or errors, between the points it has."""
    title, names = named([line.label for line in table.lines])
    columns = [_column(title or "method"), *(_column(tick(at), unit) for at in table.at)]
    rows = [
        {"name": name, "options": "", "cells": [
            _text(_with_spread(number(value.middle), spread_of(*value)) if value else "–", best == i)
            for value, best in zip(values, table.best, strict=True)
        ]}
        for i, (name, values) in enumerate(zip(names, table.rows, strict=True))
    ]  # fmt: skip
    rows = rows[:MOST_LINES] + _left_out(len(rows) - MOST_LINES, "lines, which count for what is best")
    caption += ", by interpolation"
    if table.has_points:
        caption += "; a line of one budget, or of none, has its own error at any time that suffices for it"
    if any(value and value.has_spread for values in table.rows for value in values):
        caption += "; below, by the fastest and the slowest runs: where these overlap no line is the best"
    if any(value and value.high == inf for values in table.rows for value in values):
        caption += "; ∞: the slowest run does not end in that time"
    return {"caption": f"{caption}.", "columns": columns, "groups": [{"title": "", "rows": rows}]}


def _with_spread(middle: str, spread: str) -> str:
    return f"{middle}\n{spread}" if spread else middle


def claim_table(claim: Mapping[str, Any]) -> dict[str, Any]:
    """The cases of a claim."""
    columns = [_column("where"), *(_column(name) for name in ("a", "b", "bound", "noise", "verdict"))]
    rows = []
    for case in claim["numbers"][:MOST_ROWS]:
        where = case["where"] if isinstance(case["where"], str) else listed(case["where"])
        texts = [_value(case.get(key)) for key in ("a", "b", "bound", "noise")] + [str(case.get("verdict", ""))]
        rows.append({"name": where, "options": "", "cells": [_text(text) for text in texts]})
    rows += _left_out(len(claim["numbers"]) - MOST_ROWS, "cases: all are in claims.json")
    groups = [{"title": "", "rows": rows}]
    return {"caption": f"{claim['text']}: {claim['verdict']}.", "columns": columns, "groups": groups}


def _table(
    caption: str,
    columns: list[dict[str, str]],
    groups: Sequence[Group],
    texts: Callable[[Cell, Group], Texts],
    only_done: bool = False,
) -> dict[str, Any]:
    """A table with a part for each group: of each cell its texts, or why it has no image."""
    parts = []
    if only := sole_method(groups):
        columns = [_column(only), *columns[1:]]
    most = max(FEWEST_ROWS, MOST_ROWS // max(1, len(groups)))
    for group in groups:
        rows = []
        members = group.done if only_done else group.cells
        for cell in members[:most]:
            row: dict[str, Any] = {"name": cell.row["method"], "options": cell.options}
            if only and cell.options:
                row = {"name": cell.options, "options": ""}
            rows.append(row | ({"cells": texts(cell, group)} if cell.done else {"outcome": outcome(cell)}))
        rows += _left_out(len(members) - most, "cells: all are in cells.parquet")
        if rows:
            parts.append({"title": group.title, "rows": rows})
    return {"caption": caption, "columns": columns, "groups": parts}


def _left_out(n: int, what: str) -> list[dict[str, Any]]:
    """A row that says how many are not here, where any are not."""
    return [{"name": "…", "options": "", "outcome": f"and {n} more {what}"}] if n > 0 else []


def outcome(cell: Cell) -> str:
    """Why a cell has no image, in one line."""
    lines = (cell.row["reason"] or "no reason is known").strip().splitlines()
    return f"{cell.row['status']}: {lines[-1] if cell.row['status'] == 'failed' else ' '.join(lines)}"


def _column(title: str, unit: str = "") -> dict[str, str]:
    return {"title": title, "unit": unit}


def _unit(metric: str) -> str:
    return METRICS.get(metric).unit.replace("1", "") if metric in METRICS.names() else ""


def _text(text: str, best: bool = False, span: int = 1) -> dict[str, Any]:
    return {"text": text, "best": best, "span": span}


def _value(value: Any) -> str:
    if value is None or (isinstance(value, int | float) and not isinstance(value, bool)):
        return number(value)
    if isinstance(value, list):
        return " to ".join(number(each) for each in value)
    return listed(value) if isinstance(value, Mapping) else str(value)
