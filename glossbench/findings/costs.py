"""Costs: the numbers that a decision weighs against an error, in the units in which people read them."""

from collections.abc import Mapping
from typing import Any

from glossbench.columns import COLUMNS, read_cost
from glossbench.shading.method import CHANGES

_UPDATE = COLUMNS["update_seconds"]
COSTS = {
    "shade": COLUMNS["shade_seconds"].heading,
    **{change: f"update for a new {change} [{_UPDATE.unit}]" for change in CHANGES},
    "memory": COLUMNS["state_bytes"].heading,
}
# Lower costs, in the same units, are calls of empty stages; a plot of such costs alone is not drawn.
NEGLIGIBLE = {cost: 1e-6 if cost == "memory" else 0.01 for cost in COSTS}


def read_named_cost(row: Mapping[str, Any], cost: str) -> float:
    """A cost of a parsed row by its name in `COSTS` [ms or MB]; NaN if it is unknown."""
    if cost in ("shade", "memory"):
        column, part = COLUMNS["shade_seconds" if cost == "shade" else "state_bytes"], ""
    else:
        column, part = _UPDATE, cost
    value = read_cost(row, column.name, part)
    return float("nan") if value is None else column.scale * value
