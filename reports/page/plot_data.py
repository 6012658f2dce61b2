"""The plots of a page as data: its script draws them, and draws them anew for another sweep, place or metric."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..model.axes import Place, Sweep, places_of, with_costs
from ..model.conditions import Group
from ..model.lines import COSTS, NEGLIGIBLE, Axis, Floats, Line, axis_of, costing, front, lines_at


def plot_data(groups: Sequence[Group], sweeps: Mapping[str, Sweep], metrics: Sequence[str]) -> dict[str, Any]:
    """All places of all sweeps under all metrics; a number that is missing or not finite is None."""
    return {
        "costs": COSTS,
        "negligible": NEGLIGIBLE,
        "metrics": list(metrics),
        "sweeps": [
            {
                "name": sweep.name,
                "title": sweep.title,
                "kind": sweep.kind,
                "hasCosts": sweep in with_costs(sweeps),
                "isSwept": sweep.n_values > 1,
                "labels": {label.index: vars(label) for label in sweep.labels.values()},
                "places": [
                    {"title": place.title, "of": {metric: _plotted(place, metric) for metric in metrics}}
                    for place in places_of(groups, sweep)
                ],
            }
            for sweep in sweeps.values()
        ],
    }


def _plotted(place: Place, metric: str) -> dict[str, Any]:
    lines, axis = lines_at(place, metric), axis_of(place, metric)
    # What is cheap under one condition and exact under another is on no front.
    fronts = {} if place.sweep.kind else {cost: front(lines, cost, axis) for cost in COSTS}
    return {
        "label": axis.label,
        "noise": axis.noise,
        "isLog": axis.is_log,
        "lines": [_line(line, axis) for line in lines],
        "fronts": {
            cost: [[i, int(j)] for i, mask in enumerate(masks) for j in np.flatnonzero(mask)]
            for cost, masks in fronts.items()
        },
    }


def _line(line: Line, axis: Axis) -> dict[str, Any]:
    low, high = line.band or (None, None)
    return {
        "index": line.label.index,
        "slopes": {"": line.slope() if axis.is_log else None, **{cost: costing(line, cost).slope() for cost in COSTS}},
        "keys": list(line.keys),
        "x": {"over": _short(line.x), **{cost: _short(line.costs[cost]) for cost in COSTS}},
        "y": _short(line.errors),
        "floor": [bool(at) for at in line.at_floor],
        "low": _short(low),
        "high": _short(high),
        "spread": line.spread and [_short(end) for end in line.spread],
    }


def _short(values: Floats | None) -> list[float | None] | None:
    """Six digits are more than a plot or its tip shows."""
    if values is None:
        return None
    return [float(f"{value:.6g}") if np.isfinite(value) else None for value in values]
