"""Lines of plots: error and cost of each method with its options over a sweep."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
from scipy.special import stdtrit

from glossbench.findings.costs import COSTS, read_named_cost
from glossbench.findings.estimates import Estimate, estimate_metric

from .axes import Label, Place
from .conditions import Cell, Group
from .panels import Axis, Floats, Mask

Row = Mapping[str, Any]
CONFIDENCE = 0.95


@dataclass(frozen=True)
class MeasuredLine:
    """One method with its options, measured at each value of the swept quantity, in increasing order.

    Attributes:
        label: its name and look, the same in every plot over one quantity.
        x: the values of the swept quantity.
        costs: the costs of each point, by the names in `COSTS`.
        errors: the size of the metric.
        at_floor: true if the reference cannot resolve the RMS error.
        keys: keys of the cells; none if a point is a mean over lights.
        band: lower and upper end of the confidence interval, if a point is a mean over three lights or more.
        interval: lower and upper end of the 95 % interval of each point, from the noise of the reference; None if it is
            not known.
        spread: shading time [ms] of the fastest and of the slowest run of each point; None if the results lack it.
    """

    label: Label
    x: Floats
    costs: Mapping[str, Floats]
    errors: Floats
    at_floor: Mask
    keys: Sequence[str] = ()
    band: tuple[Floats, Floats] | None = None
    interval: tuple[Floats, Floats] | None = None
    spread: tuple[Floats, Floats] | None = None

    @property
    def name(self) -> str:
        """Method and options."""
        return self.label.name

    def slope(self, of: str = "") -> float | None:
        """Fitted slope of log error, or of a cost, over log x.

        None with fewer than three resolved points, or if an x is not positive.
        """
        values = self.costs.get(of, self.errors)
        use = (values > 0) & np.isfinite(values) & (~self.at_floor | (of in self.costs))
        if len(set(self.x[use])) < 3 or (self.x[use] <= 0).any():
            return None
        x, y = np.log(self.x[use]), np.log(values[use])
        return float(np.sum((x - x.mean()) * (y - y.mean())) / np.sum((x - x.mean()) ** 2))


def make_axis(place: Place, metric: str) -> Axis:
    """The axis of a metric; a signed metric is plotted by its absolute value."""
    column = place.groups[0].columns[metric]
    unit = f" [{column.unit}]" if column.unit else ""
    label = f"|{column.title}|{unit}" if column.signed else f"{column.title}{unit}"
    rows = [cell.row for group in place.groups for cell in group.done if cell.row["at_noise_floor"]]
    floor = max((abs(row[metric]) for row in rows if row.get(metric) is not None), default=0.0)
    return Axis(label, metric, floor, is_log=column.lower_is_better)


def measure_lines(
    place: Place, metric: str, estimate: Callable[[Row, str], Estimate] = estimate_metric
) -> list[MeasuredLine]:
    """The lines of a metric, in the order of the study; the cells of the first light determine their points.

    Args:
        estimate: a metric of a row with its uncertainty.
    """
    is_log = make_axis(place, metric).is_log
    alike = [
        {place.sweep.point(cell.row): cell.row for group in groups for cell in _select_plotted(place, group, metric)}
        for groups in place.lights
    ]
    complete = {point: row for point, row in alike[0].items() if all(point in others for others in alike)}
    values = {point: place.sweep.value(row) for point, row in complete.items()}
    lines = []
    for _, members in groupby(
        sorted(complete, key=lambda point: (point[0], values[point])), key=lambda point: point[0]
    ):
        points = [[rows[point] for rows in alike] for point in members]
        errors, band = _average([[row[metric] for row in point] for point in points], is_log)
        lines.append(
            MeasuredLine(
                place.sweep.labels[points[0][0]["key"]],
                np.array([place.sweep.value(point[0]) for point in points], float),
                {
                    cost: np.array([sum(read_named_cost(row, cost) for row in point) / len(point) for point in points])
                    for cost in COSTS
                },
                errors,
                np.array([any(row["at_noise_floor"] for row in point) for point in points]),
                [point[0]["key"] for point in points] if len(alike) == 1 else (),
                band,
                _read_interval([estimate(point[0], metric) for point in points], is_log) if len(alike) == 1 else None,
                _read_spread(points),
            )
        )
    return lines


def name_lines(labels: Sequence[Label]) -> tuple[str, list[str]]:
    """A title, and a name for each line. A method that all lines share is the title; the names are then the options."""
    methods = {label.method for label in labels}
    options = {tuple(label.options) for label in labels}
    if len(methods) > 1 or len(options) > 1 or () in options:
        return "", [label.name for label in labels]
    title = f"{labels[0].name.partition(' (')[0]} ({', '.join(*options)})"
    return title, [", ".join(label.options.values()) for label in labels]


def find_front(lines: Sequence[MeasuredLine], cost: str, axis: Axis) -> list[Mask]:
    """For each line, its points on the Pareto front: no other is better in cost or error and as good in the other.

    Errors that the reference cannot resolve count as equal to the largest of them.
    """
    shown = [axis.shows(line.errors) & np.isfinite(line.costs[cost]) for line in lines]
    worse = [
        np.where(line.at_floor & (axis.floor > 0), axis.floor, line.errors) * (1 if axis.is_log else -1)
        for line in lines
    ]
    if not lines:
        return []
    x = np.concatenate([line.costs[cost][seen] for line, seen in zip(lines, shown, strict=True)])
    y = np.concatenate([value[seen] for value, seen in zip(worse, shown, strict=True)])
    masks = []
    for line, value, seen in zip(lines, worse, shown, strict=True):
        own_x, own_y = line.costs[cost][:, None], value[:, None]
        beaten = ((x <= own_x) & (y <= own_y) & ((x < own_x) | (y < own_y))).any(axis=1)
        masks.append(seen & ~beaten)
    return masks


def _select_plotted(place: Place, group: Group, metric: str) -> list[Cell]:
    return [cell for cell in group.done if place.sweep.value(cell.row) is not None and cell.row.get(metric) is not None]


def _read_spread(points: Sequence[Sequence[Mapping[str, Any]]]) -> tuple[Floats, Floats] | None:
    """Shading time [ms] of the fastest and of the slowest run, each the mean over lights."""
    ends = ("shade_seconds_low", "shade_seconds_high")
    if any(row.get(end) is None for point in points for row in point for end in ends):
        return None
    low, high = (np.array([1e3 * np.mean([float(row[end]) for row in point]) for point in points]) for end in ends)
    return low, high


def _read_interval(found: Sequence[Estimate], is_log: bool) -> tuple[Floats, Floats] | None:
    """The ends of each interval; on a logarithmic axis, those of the logarithm of the absolute value."""
    half = np.array([each.half_width for each in found])
    if not (np.isfinite(half) & (half > 0)).any():
        return None
    value = np.array([each.value for each in found])
    if not is_log:
        return value - half, value + half
    size = np.abs(value)
    ratio = np.divide(half, size, out=np.zeros_like(half), where=size > 0)
    factor = np.exp(np.minimum(ratio, 30.0))  # beyond every axis
    return size / factor, size * factor


def _average(values: Sequence[Sequence[float]], is_log: bool) -> tuple[Floats, tuple[Floats, Floats] | None]:
    """The mean over lights of each point and, with at least three lights, its confidence interval by Student's t.

    On a logarithmic axis the logarithms are averaged; an error of exactly 0 makes their mean 0, without an interval.
    """
    table = np.array(values, float)
    if is_log:
        table = np.abs(table)
    n = table.shape[1]
    if n == 1:
        return table[:, 0], None
    with np.errstate(divide="ignore"):
        table = np.log(table) if is_log else table
    back = np.exp if is_log else np.positive
    mean = table.mean(axis=1)
    if n < 3:
        return back(mean), None
    with np.errstate(invalid="ignore"):
        half = stdtrit(n - 1, 0.5 + CONFIDENCE / 2) * table.std(axis=1, ddof=1) / np.sqrt(n)
    return back(mean), (back(mean - half), back(mean + half))
