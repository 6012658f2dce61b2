"""Plots for print: errors and costs of each method over what a study sweeps, and errors against costs, with one key."""

from collections.abc import Sequence
from math import ceil, floor, log10
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator

from ..model.axes import SAMPLES, Place
from ..model.lines import CONFIDENCE, COSTS, NEGLIGIBLE, Axis, Floats, Line, axis_of, costing, front, lines_at, named
from ..model.selection import evenly
from ..style import COLOURS, INK, MARKERS, PAPER, RC, number, style

MOST_FACETS = 4
MOST_LINES = 40  # of a plot: more, and the key takes the page
WIDTH = 6.53  # inches of text across a page
SMALL = {**RC, "font.size": 7.5, "lines.linewidth": 1.1, "lines.markersize": 4}
DASHES: Sequence[Any] = ("-", (0, (5, 1.5)), (0, (1.5, 1.5)), (0, (6, 1.5, 1.5, 1.5)))


class Panel(NamedTuple):
    """One plot of a metric or cost: over the swept quantity, or against a cost.

    Attributes:
        facet: of the lines that are drawn; None for all. Panels of the same lines have the same scales.
        left_out: how many lines more there are than a key has room for.
    """

    place: Place
    lines: Sequence[Line]
    axis: Axis
    cost: str = ""
    facet: int | None = None
    left_out: int = 0

    @property
    def drawn(self) -> list[Line]:
        """Its lines; one of no facet is in all of them."""
        return [line for line in self.lines if self.facet is None or line.label.facet in (None, self.facet)]

    @property
    def title(self) -> str:
        """The options that its lines share, where it has but a part of all lines."""
        if self.facet is None:
            return ""
        first, *others = (line.label.options for line in self.drawn if line.label.facet is not None)
        return ", ".join(f"{key} {v}" for key, v in first.items() if all(other.get(key) == v for other in others))

    def x(self, line: Line) -> Floats:
        """Of its points."""
        return line.costs[self.cost] if self.cost else line.x

    @property
    def is_log(self) -> bool:
        """Over samples and costs, as over all that is greater than zero."""
        positive = all((self.x(line) > 0).all() for line in self.lines)
        return bool(self.cost) or self.place.sweep.name == SAMPLES or positive


def over_sweep(place: Place, metric: str) -> list[Panel]:
    """A metric over what is swept, where a line has more than one value of it."""
    lines = lines_at(place, metric)
    shown = evenly(lines, MOST_LINES)
    panel = Panel(place, shown, axis_of(place, metric), left_out=len(lines) - len(shown))
    return [panel] if any(len(set(line.x)) > 1 for line in lines) else []


def facets(panels: Sequence[Panel]) -> list[Panel]:
    """A panel for each facet, where there are as many lines that there is more than one."""
    found = []
    for panel in panels:
        kinds = sorted({line.label.facet for line in panel.lines if line.label.facet is not None})
        found += [panel._replace(facet=kind) for kind in kinds] if 1 < len(kinds) <= MOST_FACETS else [panel]
    return found


def cost_over_sweep(place: Place, metric: str, cost: str) -> list[Panel]:
    """A cost of the cells that have a metric, over what is swept."""
    every = lines_at(place, metric)
    lines = [costing(line, cost) for line in evenly(every, MOST_LINES)]
    panel = Panel(place, lines, Axis(COSTS[cost]), left_out=len(every) - len(lines))
    return [panel] if any((line.errors > 0).any() for line in lines) else []


def against_costs(place: Place, metric: str) -> list[Panel]:
    """A metric against each cost that two lines have."""
    every, axis = lines_at(place, metric), axis_of(place, metric)
    lines, found = evenly(every, MOST_LINES), []
    for cost in COSTS:
        with_cost = [line for line in lines if (axis.shows(line.errors) & (line.costs[cost] >= NEGLIGIBLE[cost])).any()]
        if len(with_cost) > 1 or (with_cost and len(lines) == 1):
            found.append(Panel(place, lines, axis, cost, left_out=len(every) - len(lines)))
    return found


@style(SMALL)
def plot(panels: Sequence[Panel]) -> Figure:
    """Panels side by side: shaded up to twice the reference's noise, dashed the Pareto front, and where points are
    means over lights a band of confidence. The key has the lines of the first, with their slopes where it is over a
    sweep."""
    first = panels[0]
    columns = {1: 1, 2: 2, 4: 2}.get(len(panels), 3)
    rows = ceil(len(panels) / columns)
    title, names = named(first.lines)
    if not first.cost:
        names = [name + _slope(line, first.axis) for name, line in zip(names, first.lines, strict=True)]
    longest = max(map(len, names))
    in_key = 1 if len(panels) == 1 or longest > 58 else 2 if longest > 32 else 3
    height = (
        (1.4 if rows > 1 and first.facet is None else 1.9) * rows
        + 0.15 * (ceil((len(names) + 3) / in_key) + bool(title))
        + 0.1
    )
    has_costs = any(panel.axis != first.axis for panel in panels)
    figure = Figure(figsize=(WIDTH if len(panels) > 1 else 0.6 * WIDTH, height), layout="constrained")
    for i, panel in enumerate(panels):
        ax = figure.add_subplot(rows, columns, i + 1)
        _draw(ax, panel)
        ax.set_title(panel.axis.label if has_costs else panel.title, loc="left", size="medium")
        if i % columns == 0 and not has_costs:
            ax.set_ylabel(panel.axis.label)
    handles: list[Artist] = [_handle(line, name) for line, name in zip(first.lines, names, strict=True)]
    if first.axis.is_log and first.axis.noise > 0:
        at_most = "at most " if first.place.sweep.kind else ""
        handles.append(
            Patch(color=INK, alpha=0.1, lw=0, label=f"twice the noise, {at_most}{number(2 * first.axis.noise, 2)}")
        )
    if any(panel.cost for panel in panels):
        handles.append(Line2D([], [], color=INK, lw=0.8, ls=(0, (3, 2)), label="Pareto front"))
    if any(line.band is not None for line in first.lines):
        handles.append(Patch(color=COLOURS[0], alpha=0.2, lw=0, label=f"{100 * CONFIDENCE:.0f} % over lights"))
    if first.left_out:
        handles.append(Line2D([], [], lw=0, label=f"{first.left_out} more lines are not drawn here"))
    _key(figure, handles, in_key, title)
    return figure


@style(SMALL)
def error_by_method(lines: Sequence[Line], axis: Axis) -> Figure:
    """Dots: the metric of each method, for a study with one budget."""
    left_out, lines = max(0, len(lines) - MOST_LINES), evenly(lines, MOST_LINES)
    figure = Figure(figsize=(WIDTH, 0.75 + 0.2 * len(lines)), layout="constrained")
    ax = figure.add_subplot()
    for row, line in enumerate(lines):
        for seen, face in ((~line.at_floor, None), (line.at_floor, PAPER)):
            errors = line.errors[axis.shows(line.errors) & seen]
            style = _style(line) | {"ls": "", "mfc": face or _style(line)["color"]}
            ax.plot(errors, np.full(len(errors), row), **style)
    ax.set_ylim(len(lines) - 0.4, -0.6)
    title, names = named(lines)
    more = f"{left_out} more lines are not drawn here" if left_out else ""
    ax.set_title("; ".join(text for text in (title, more) if text), loc="left", size="medium")
    ax.set_yticks(range(len(lines)), names)
    ax.tick_params(axis="y", length=0)
    ax.grid(axis="y", color=INK, alpha=0.15, linewidth=0.6)
    _scale(ax, "x", axis, lines)
    ax.set_xlabel(axis.label)
    return figure


def _draw(ax: Axes, panel: Panel) -> None:
    lines, axis = panel.lines, panel.axis
    ax.set_xscale("log" if panel.is_log else "linear")
    for line in panel.drawn:
        x = panel.x(line)
        seen = axis.shows(line.errors) & ((x > 0) | (not panel.is_log))
        if line.band is not None:
            low, high = line.band
            ax.fill_between(x[seen], low[seen], high[seen], color=_style(line)["color"], alpha=0.15, lw=0)
        if panel.cost == "shade" and line.spread is not None:
            low, high = line.spread
            ax.hlines(line.errors[seen], low[seen], high[seen], colors=line.label.colour, lw=2.5, alpha=0.35)
        ax.plot(x[seen], line.errors[seen], **_style(line) | ({} if seen.sum() > 1 else {"ls": ""}))
        floored = seen & line.at_floor
        ax.plot(x[floored], line.errors[floored], **_style(line) | {"ls": "", "mfc": PAPER})
    if panel.cost:
        _draw_front(ax, panel.cost, lines, axis)
    _scale(ax, "y", axis, lines)
    ax.set_xlabel(COSTS[panel.cost] if panel.cost else panel.place.sweep.title)
    values = sorted({float(x) for line in lines for x in panel.x(line) if x > 0 or not panel.is_log})
    ax.xaxis.set_major_formatter(FuncFormatter(_tick))
    if panel.is_log:
        ax.xaxis.set_major_locator(FixedLocator(_ticks(values) if panel.cost else _apart(values)))
        ax.xaxis.set_minor_locator(NullLocator())
        if values and values[-1] < 1.05 * values[0]:  # one cost for all
            ax.set_xlim(values[0] / 2, values[-1] * 2)


def _draw_front(ax: Axes, cost: str, lines: Sequence[Line], axis: Axis) -> None:
    """Stairs through the points that no other beats in both cost and error."""
    masks = front(lines, cost, axis)
    points = sorted(
        (x, y)
        for line, mask in zip(lines, masks, strict=True)
        for x, y in zip(line.costs[cost][mask], line.errors[mask], strict=True)
        if x > 0
    )
    if len(points) > 1:
        x, y = zip(*points, strict=True)
        ax.step(x, y, where="post", color=INK, lw=0.8, ls=(0, (3, 2)), alpha=0.7, zorder=1.5)


def _slope(line: Line, axis: Axis) -> str:
    slope = line.slope() if axis.is_log else None
    return "" if slope is None else f", slope {number(slope, 2)}"


def _style(line: Line) -> dict[str, Any]:
    label = line.label
    return {
        "color": label.colour,
        "marker": MARKERS[label.index % len(MARKERS)],
        "ls": DASHES[label.dash % len(DASHES)],
    }


def _handle(line: Line, name: str) -> Line2D:
    return Line2D([], [], label=name, **_style(line))


def _key(figure: Figure, handles: Sequence[Artist], columns: int, title: str) -> None:
    figure.legend(
        handles=handles, title=title, alignment="left", ncols=columns, loc="outside lower left", frameon=False,
        borderaxespad=0.1, handlelength=3.2, columnspacing=1.4, labelspacing=0.3,
    )  # fmt: skip


def _scale(ax: Axes, side: str, axis: Axis, lines: Sequence[Line]) -> None:
    """Limits and ticks of the metric's axis, and the band that the reference cannot resolve."""
    span, limits, scale = (ax.axhspan, ax.set_ylim, ax.yaxis) if side == "y" else (ax.axvspan, ax.set_xlim, ax.xaxis)
    if not axis.is_log:
        scale.set_major_formatter(FuncFormatter(_tick))
        return
    (ax.set_yscale if side == "y" else ax.set_xscale)("log")
    seen = [float(v) for line in lines for v in line.errors[axis.shows(line.errors)]] or [1.0]
    floor = 2 * axis.noise
    # A floor far below every dot would squeeze the dots: then the key alone tells where it is.
    shown = floor > min(seen) / 30
    low, high = min([*seen, floor] if shown else seen) / 1.6, max([*seen, floor] if shown else seen) * 1.6
    if shown:
        span(low, floor, color=INK, alpha=0.1, linewidth=0)
    limits(low, high)
    scale.set_major_locator(_locator([low, high]))
    scale.set_minor_locator(LogLocator(subs=range(2, 10), numticks=99))
    scale.set_minor_formatter(NullFormatter())
    scale.set_major_formatter(FuncFormatter(_tick))


def _tick(value: float, _: int | None = None) -> str:
    mantissa = f"{value:.2e}".split("e")[0].rstrip("0").rstrip(".")
    text = number(value, len(mantissa.replace(".", "").replace("-", "")))
    return text.removeprefix("1×")


def _ticks(values: Sequence[float]) -> list[float]:
    """Round numbers between the ends of values, at least three of them; else the ends."""
    if not values:
        return []
    low, high = values[0], values[-1]
    powers = range(floor(log10(low)), ceil(log10(high)) + 1)
    for digits in ((1,), (1, 2, 5), range(1, 10)):
        ticks = [value for p in powers for d in digits if low <= (value := float(f"{d}e{p}")) <= high]
        if len(ticks) > 2:
            return _apart(ticks, 0.22)
    return _apart([low, high], 0.22)


def _locator(values: Sequence[float]) -> LogLocator:
    wide = bool(values) and values[-1] > 80 * values[0]
    return LogLocator(subs=(1,) if wide else (1, 2, 5), numticks=6)


def _apart(values: Sequence[float], share: float = 0.12) -> list[float]:
    """Values, but none nearer to the one before it than a share of the log axis, as their labels would touch."""
    gap = (values[-1] / values[0]) ** share if values else 1.0
    kept = list(values[:1])
    for value in values[1:]:
        if value >= kept[-1] * gap:
            kept.append(value)
    return kept
