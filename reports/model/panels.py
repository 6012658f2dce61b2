"""A plot as data: panels with axes and lines, which page and print paint without computing anything."""

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
        label: with its unit.
        name: in a sentence, such as "rms"; "" for the label.
        floor: the largest value that the reference cannot resolve; 0 where it resolves all.
        is_log: else it is linear.
        has_zero: zero has a place on it; on a logarithmic one at the edge, for costs of nothing.
        negligible: what is less counts as nothing.
        at_values: a tick stands at each value, where there is room.
        names: of the values 0, 1, 2, ... instead of numbers.
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
        """Which values have a place on it."""
        return np.isfinite(values) & ((values > 0) | (not self.is_log))


class SideNumber(NamedTuple):
    """Another number of each point of a line, which the page says where the pointer is; with its ends."""

    title: str
    values: Floats
    spread: Ends | None = None


@dataclass(frozen=True, eq=False)
class Line:
    """Points that belong together.

    Attributes:
        label: name and look; a line has the same in every panel.
        x, y: of its points, in their order.
        keys: of the cells that a click on a point opens; none where a point is of several cells.
        hollow: true where the reference cannot resolve the value.
        band: lower and upper end of a confidence interval over conditions, drawn as an area.
        interval: lower and upper end of the 95 % interval that the noise of the reference leaves open; a thin bar at
            each point, along y, or along x where the y axis has names.
        spread: lower and upper end of x.
        slope: of log y over log x; None where it has no such meaning.
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
        """Of each point, whether the reference cannot resolve it."""
        return np.zeros(len(self.y), bool) if self.hollow is None else self.hollow

    def is_seen(self, x: Axis, y: Axis) -> Mask:
        """Of each point, whether it has a place on both axes."""
        return x.shows(self.x) & y.shows(self.y)


@dataclass(frozen=True, eq=False)
class Panel:
    """One plot.

    Attributes:
        name: of the quantity across: "over" for what a study sweeps, or a cost.
        fronts: by line the points on the Pareto front; none where it has no meaning.
        is_main: drawn larger than others.
        is_curve: its points are so many that they have no markers.
        is_last_resort: drawn only where a condition has no other panel.
        title: of a part of the lines.
        part: the lines that are drawn of those that share the axes; None for all.
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
        """Its lines; of a part, those of the part and those of none."""
        return [line for line in self.lines if self.part is None or line.label.facet in (None, self.part)]

    @property
    def has_points(self) -> bool:
        """Whether any point has a place on both axes."""
        return any(bool(line.is_seen(self.x, self.y).any()) for line in self.lines)

    @property
    def spans(self) -> bool:
        """Whether a line has points at more than one place across."""
        return any(len(set(line.x)) > 1 for line in self.lines)


@dataclass(frozen=True, eq=False)
class Panels:
    """What a figure shows: panels side by side, whose lines share one key.

    Attributes:
        title: what is plotted, in words, for captions.
        note: what is not plotted, and why; "" where there is nothing to say.
    """

    panels: Sequence[Panel] = ()
    title: str = ""
    note: str = ""


def select_shown(panels: Sequence[Panel]) -> list[Panel]:
    """Those that are drawn: all but the last resorts; of these the first, where there is nothing else."""
    return [panel for panel in panels if not panel.is_last_resort] or list(panels[:1])
