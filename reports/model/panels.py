"""A plot as data: panels with axes and lines, which the page and print draw without any computation."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .axes import Label

Floats = NDArray[np.floating]
Mask = NDArray[np.bool_]
Ends = tuple[Floats, Floats]  # lower and upper


@dataclass(frozen=True)
class Axis:
    """The axis of a quantity.

    Attributes:
        label: the label with its unit.
        name: the name in a sentence, such as "rms"; "" for the label.
        floor: the largest value that the reference cannot resolve; 0 if it resolves all values.
        is_log: whether it is logarithmic; otherwise it is linear.
        has_zero: whether zero can be shown; a logarithmic axis shows it at the edge, for costs of zero.
        negligible: lower values count as zero.
        at_values: whether each value has a tick, if there is room.
        names: names of the values 0, 1, 2, ..., shown in place of numbers.
    """

    label: str
    name: str = ""
    floor: float = 0.0
    is_log: bool = True
    has_zero: bool = False
    negligible: float = 0.0
    at_values: bool = False
    names: Sequence[str] = ()

    def shows(self, values: Floats) -> Mask:
        """Which values can be shown on the axis."""
        return np.isfinite(values) & ((values > 0) | (not self.is_log))


class SideNumber(NamedTuple):
    """Another number of each point of a line, with its interval; the page shows it at the pointer."""

    title: str
    values: Floats
    spread: Ends | None = None


@dataclass(frozen=True, eq=False)
class Line:
    """The points of one line.

    Attributes:
        label: name and look, the same in every panel.
        x, y: coordinates of the points, in order.
        keys: keys of the cells that a click on a point opens; none if a point comes from several cells.
        hollow: true if the reference cannot resolve the value.
        band: lower and upper end of a confidence interval over conditions, drawn as an area.
        interval: lower and upper end of the 95 % interval from the noise of the reference, drawn as a thin bar at each
            point, along y, or along x if the y axis has names.
        spread: lower and upper end of x.
        slope: slope of log y over log x; None if it has no meaning.
        beside: other numbers of each point.
    """

    label: Label
    x: Floats
    y: Floats
    keys: Sequence[str] = ()
    hollow: Mask | None = None
    band: Ends | None = None
    interval: Ends | None = None
    spread: Ends | None = None
    slope: float | None = None
    beside: Sequence[SideNumber] = ()

    @property
    def is_hollow(self) -> Mask:
        """For each point, whether the reference cannot resolve it."""
        return np.zeros(len(self.y), bool) if self.hollow is None else self.hollow

    def is_seen(self, x: Axis, y: Axis) -> Mask:
        """For each point, whether both axes can show it."""
        return x.shows(self.x) & y.shows(self.y)


@dataclass(frozen=True, eq=False)
class Panel:
    """One plot.

    Attributes:
        name: the quantity on the x axis: "over" for a sweep, or a cost.
        fronts: for each line, its points on the Pareto front; none if a front has no meaning.
        is_main: whether it is larger than the others.
        is_curve: whether lines have so many points that markers are left out.
        is_last_resort: whether it is drawn only if a condition has no other panel.
        title: the title of a part of the lines.
        part: indices of the lines that are drawn; None for all lines that share the axes.
    """

    name: str
    x: Axis
    y: Axis
    lines: Sequence[Line]
    fronts: Sequence[Mask] = ()
    is_main: bool = False
    is_curve: bool = False
    is_last_resort: bool = False
    title: str = ""
    part: int | None = None

    @property
    def drawn(self) -> list[Line]:
        """The lines that are drawn: those of the part, and those that belong to no part."""
        return [line for line in self.lines if self.part is None or line.label.facet in (None, self.part)]

    @property
    def has_points(self) -> bool:
        """Whether both axes can show at least one point."""
        return any(bool(line.is_seen(self.x, self.y).any()) for line in self.lines)

    @property
    def spans(self) -> bool:
        """Whether a line has points at more than one x."""
        return any(len(set(line.x)) > 1 for line in self.lines)


@dataclass(frozen=True, eq=False)
class Panels:
    """The contents of a figure: panels side by side, whose lines share one legend.

    Attributes:
        title: the contents in words, for captions.
        note: what is not plotted, and why; "" if all is plotted.
    """

    panels: Sequence[Panel] = ()
    title: str = ""
    note: str = ""


def select_shown(panels: Sequence[Panel]) -> list[Panel]:
    """The panels that are drawn: all except last resorts; if there are no others, the first last resort."""
    return [panel for panel in panels if not panel.is_last_resort] or list(panels[:1])
