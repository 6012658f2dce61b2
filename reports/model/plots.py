"""The built-in plots as data: a metric or a cost over a sweep, against each cost, or by method."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from glossbench.findings.costs import COSTS, NEGLIGIBLE

from .axes import SAMPLES, Place
from .lines import MeasuredLine, find_front, make_axis
from .panels import Axis, Floats, Line, Panel, SideNumber


def plot_over_axis(place: Place, metric: str, lines: Sequence[MeasuredLine]) -> Panel:
    """A metric, or a cost of the same cells, over a sweep; with slopes if a lower metric is better.

    An axis is linear where a value is zero or less.
    """
    y = make_y_axis(place, metric)
    slopes = [line.slope(metric) if y.is_log else None for line in lines]
    drawn = [
        replace(_make_line(line, line.x, metric), slope=slope, beside=_make_range(line))
        for line, slope in zip(lines, slopes, strict=True)
    ]
    return Panel("over", make_x_axis(place, lines), y, drawn, is_main=True)


def plot_against_cost(place: Place, metric: str, lines: Sequence[MeasuredLine], cost: str) -> Panel:
    """A metric against a cost, with the Pareto front; for shading time also the fastest and the slowest run."""
    across, y = make_x_axis(place, lines), make_axis(place, metric)
    drawn = [
        replace(
            _make_line(line, line.costs[cost], metric),
            spread=line.spread if cost == "shade" else None,
            beside=[SideNumber(across.label, line.x), *(_make_range(line) if cost != "shade" else ())],
        )
        for line in lines
    ]
    return Panel(cost, make_cost_axis(cost), y, drawn, find_front(lines, cost, y), is_main=cost == "shade")


def plot_by_method(place: Place, metric: str, lines: Sequence[MeasuredLine]) -> Panel:
    """A row of dots for each method, for a study with one budget."""
    names = Axis("", is_log=False, names=[line.name for line in lines])
    drawn = []
    for row, line in enumerate(lines):
        dots, rows = _make_line(line, line.x, metric), np.full(len(line.x), float(row))
        drawn.append(replace(dots, x=dots.y, y=rows, band=None, beside=_make_range(line)))
    return Panel("method", make_y_axis(place, metric), names, drawn, is_main=True, is_last_resort=True)


def has_cost(lines: Sequence[MeasuredLine], cost: str) -> bool:
    """Whether a cost of a line is more than the calls of empty stages."""
    return any((line.costs[cost] >= NEGLIGIBLE[cost]).any() for line in lines)


def make_x_axis(place: Place, lines: Sequence[MeasuredLine]) -> Axis:
    """The axis of a sweep."""
    is_log = place.sweep.name == SAMPLES or all((line.x > 0).all() for line in lines)
    return Axis(place.sweep.title, place.sweep.name, is_log=is_log, at_values=True)


def make_y_axis(place: Place, metric: str) -> Axis:
    """The axis of a metric or of a cost."""
    return make_cost_axis(metric) if metric in COSTS else make_axis(place, metric)


def make_cost_axis(cost: str) -> Axis:
    """The axis of a cost, which can show a cost of zero."""
    return Axis(COSTS[cost], has_zero=True, negligible=NEGLIGIBLE[cost])


def _make_line(line: MeasuredLine, x: Floats, metric: str) -> Line:
    if metric in COSTS:
        return Line(line.label, x, line.costs[metric], line.keys)
    return Line(line.label, x, line.errors, line.keys, line.at_floor, line.band, line.interval)


def _make_range(line: MeasuredLine) -> list[SideNumber]:
    return [SideNumber(COSTS["shade"], line.costs["shade"], line.spread)]
