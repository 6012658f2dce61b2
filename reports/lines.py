"""The lines of plots: what each method with its options reached with each budget, and at what cost."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from glossbench.comparisons import noise_of
from glossbench.metrics import METRICS

from .cells import Cell, Group, listed

Floats = NDArray[np.floating]
Mask = NDArray[np.bool_]

COSTS = {
    "shade": "shading time [ms]",
    "light": "update for a new light [ms]",
    "material": "update for a new material [ms]",
    "geometry": "update for a new geometry [ms]",
    "view": "update for a new view [ms]",
    "memory": "state in memory [MB]",
}
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Line:
    """One method with its options: what it reached with each budget, in order of samples.

    Attributes:
        index: its place in the study, which gives colour and marker: the same in every plot.
        samples: light samples a pixel.
        costs: of each point, by the names in `COSTS`.
        errors: the size of the metric.
        at_floor: true where the reference cannot resolve the RMS error.
        keys: of the cells; none where a point is a mean over lights.
        band: lower and upper end of the confidence interval, where a point is a mean over three lights or more.
    """

    name: str
    index: int
    samples: Floats
    costs: Mapping[str, Floats]
    errors: Floats
    at_floor: Mask
    keys: Sequence[str] = ()
    band: tuple[Floats, Floats] | None = None

    def slope(self) -> float | None:
        """Fitted slope of log error over log samples; None below three resolved points."""
        use = ~self.at_floor & (self.errors > 0) & np.isfinite(self.errors)
        if len(set(self.samples[use])) < 3:
            return None
        return float(np.polyfit(np.log(self.samples[use]), np.log(self.errors[use]), 1)[0])


@dataclass(frozen=True)
class Axis:
    """The axis of a metric.

    Attributes:
        label: of the axis.
        noise: of the reference, in the metric's unit; 0 where it has no such meaning.
        is_log: for errors; a metric that is higher for better images has a linear axis.
    """

    label: str
    noise: float = 0.0
    is_log: bool = True

    def shows(self, values: Floats) -> Mask:
        """Which values have a place on it."""
        return np.isfinite(values) & ((values > 0) | (not self.is_log))


class Place(NamedTuple):
    """Where lines are compared: one light, material and view, or the mean over several lights."""

    title: str
    groups: Sequence[Group]


def places_of(groups: Sequence[Group]) -> list[Place]:
    """Each group, and the mean over the lights of each material and view that more than one light shines on."""
    shared: dict[str, list[Group]] = {}
    for group in groups:
        shared.setdefault(listed({kind: group.names[kind] for kind in ("material", "view")}), []).append(group)
    means = [
        Place(f"mean over {len(alike)} lights, {alike[0].names['material']}, {alike[0].names['view']}", alike)
        for alike in shared.values()
        if len(alike) > 1
    ]
    return [*(Place(group.title, [group]) for group in groups), *means]


def axis_of(place: Place, metric: str) -> Axis:
    """How a metric is plotted: signed ones by their size; one of a plug-in that is not installed as an error."""
    if metric not in METRICS.names():
        return Axis(metric)
    cls = METRICS.get(metric)
    unit = "" if cls.unit == "1" else f" [{cls.unit}]"
    label = f"|{metric}|{unit}" if cls.signed else f"{metric}{unit}"
    references = [group.reference for group in place.groups]
    noise = max(noise_of(reference, reference, metric) for reference in references)
    return Axis(label, noise, cls.lower_is_better)


def lines_at(place: Place, metric: str) -> list[Line]:
    """The lines of a metric, in the order of the study; those of the first light say which points there are."""
    is_log = axis_of(place, metric).is_log
    alike = [{_place_of(cell): cell for cell in _measured(group, metric)} for group in place.groups]
    complete = [cell for key, cell in alike[0].items() if all(key in others for others in alike)]
    lines = []
    for index, members in groupby(complete, key=lambda cell: cell.index):
        points = [[cells[_place_of(cell)].row for cells in alike] for cell in members]
        name = next(cell.name for cell in complete if cell.index == index)
        errors, band = _mean([[row[metric] for row in point] for point in points], is_log)
        lines.append(
            Line(
                name,
                index,
                np.array([point[0]["n_samples"] for point in points], float),
                {cost: np.array([np.mean([_cost(row, cost) for row in point]) for point in points]) for cost in COSTS},
                errors,
                np.array([any(row["at_noise_floor"] for row in point) for point in points]),
                [point[0]["key"] for point in points] if len(alike) == 1 else (),
                band,
            )
        )
    return lines


def front(lines: Sequence[Line], cost: str, axis: Axis) -> list[Mask]:
    """For each line, its points on the Pareto front: no other has a lower cost and error, or one and the other equal.

    Errors that the reference cannot resolve count as equal: twice its noise, where the metric knows that.
    """
    shown = [axis.shows(line.errors) & np.isfinite(line.costs[cost]) for line in lines]
    worse = [
        np.where(line.at_floor & (axis.noise > 0), 2 * axis.noise, line.errors) * (1 if axis.is_log else -1)
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


def _measured(group: Group, metric: str) -> list[Cell]:
    return [cell for cell in group.done if cell.row.get(metric) is not None]


def _place_of(cell: Cell) -> tuple[int, Any]:
    """What the same cell under another light has in common with it: its line and its budget."""
    return cell.index, cell.row["options"].get("samples", cell.row["n_samples"])


def _cost(row: Mapping[str, Any], cost: str) -> float:
    if cost == "memory":
        return float(row["state_bytes"]) / 1e6
    return 1e3 * float(row["shade_seconds"] if cost == "shade" else row["update_seconds"].get(cost, 0))


def _mean(values: Sequence[Sequence[float]], is_log: bool) -> tuple[Floats, tuple[Floats, Floats] | None]:
    """Of each point the mean over lights and, from three lights on, its confidence interval by Student's t.

    Errors are averaged by their logarithm, as they are plotted.
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
    half = stdtrit(n - 1, 0.5 + CONFIDENCE / 2) * table.std(axis=1, ddof=1) / np.sqrt(n)
    return back(mean), (back(mean - half), back(mean + half))
