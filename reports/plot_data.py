"""The plots of a page as data: its script draws them, and draws them anew for another place or metric."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from .figures import COLOURS
from .lines import COSTS, Axis, Floats, Line, Place, axis_of, front, lines_at


def plot_data(places: Sequence[Place], metrics: Sequence[str]) -> dict[str, Any]:
    """All places under all metrics; a number that is missing or not finite is None."""
    return {
        "quantities": {"samples": "light samples a pixel", **COSTS},
        "colours": COLOURS,
        "metrics": list(metrics),
        "places": [
            {"title": place.title, "of": {metric: _plotted(place, metric) for metric in metrics}} for place in places
        ],
    }


def _plotted(place: Place, metric: str) -> dict[str, Any]:
    lines, axis = lines_at(place, metric), axis_of(place, metric)
    return {
        "label": axis.label,
        "noise": axis.noise,
        "isLog": axis.is_log,
        "lines": [_line(line, axis) for line in lines],
        "fronts": {
            cost: [[i, int(j)] for i, mask in enumerate(front(lines, cost, axis)) for j in np.flatnonzero(mask)]
            for cost in COSTS
        },
    }


def _line(line: Line, axis: Axis) -> dict[str, Any]:
    low, high = line.band or (None, None)
    return {
        "name": line.name,
        "index": line.index,
        "slope": line.slope() if axis.is_log else None,
        "keys": list(line.keys),
        "x": {"samples": _short(line.samples), **{cost: _short(line.costs[cost]) for cost in COSTS}},
        "y": _short(line.errors),
        "floor": [bool(at) for at in line.at_floor],
        "low": _short(low),
        "high": _short(high),
    }


def _short(values: Floats | None) -> list[float | None] | None:
    """Six digits are more than a plot or its tip shows."""
    if values is None:
        return None
    return [float(f"{value:.6g}") if np.isfinite(value) else None for value in values]
