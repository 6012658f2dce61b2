"""Plots for print: the error of each method over samples and over each cost, side by side, with one key for all."""

from collections.abc import Sequence
from math import ceil, floor, log10
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator

from .figures import COLOURS, INK, MARKERS, PAPER, RC, number
from .lines import CONFIDENCE, COSTS, Axis, Floats, Line, front

WIDTH = 6.53  # inches of text across a page
SMALL = {**RC, "font.size": 7.5, "lines.linewidth": 1.1, "lines.markersize": 4}
SAMPLES = "samples"


def quantities(lines: Sequence[Line], axis: Axis) -> list[str]:
    """What errors are plotted over: samples, where a line has more than one budget; costs that two lines have."""
    found = [SAMPLES] if any(len(set(line.samples)) > 1 for line in lines) else []
    for cost in COSTS:
        with_cost = [line for line in lines if (axis.shows(line.errors) & (line.costs[cost] > 0)).any()]
        if len(with_cost) > 1 or (with_cost and len(lines) == 1):
            found.append(cost)
    return found


@rc_context(SMALL)
def error_over(over: Sequence[str], lines: Sequence[Line], axis: Axis) -> Figure:
    """Plots of a metric over `samples` or costs of `COSTS`: shaded up to twice the reference's noise, dashed the
    Pareto front, and where points are means over lights a band of confidence."""
    columns = {1: 1, 2: 2, 4: 2}.get(len(over), 3)
    rows = ceil(len(over) / columns)
    names = [_named(line, axis, SAMPLES in over) for line in lines]
    longest = max(map(len, names))
    in_key = 1 if len(over) == 1 or longest > 58 else 2 if longest > 32 else 3
    height = (1.4 if rows > 1 else 1.9) * rows + 0.15 * ceil((len(lines) + 3) / in_key) + 0.1
    figure = Figure(figsize=(WIDTH if len(over) > 1 else 0.6 * WIDTH, height), layout="constrained")
    for i, quantity in enumerate(over):
        ax = figure.add_subplot(rows, columns, i + 1)
        _draw(ax, quantity, lines, axis)
        if i % columns == 0:
            ax.set_ylabel(axis.label)
    handles: list[Artist] = [_handle(line, name) for line, name in zip(lines, names, strict=True)]
    if axis.is_log and axis.noise > 0:
        handles.append(Patch(color=INK, alpha=0.1, lw=0, label=f"twice the noise, {number(2 * axis.noise, 2)}"))
    if any(quantity != SAMPLES for quantity in over):
        handles.append(Line2D([], [], color=INK, lw=0.8, ls=(0, (3, 2)), label="Pareto front"))
    if any(line.band is not None for line in lines):
        handles.append(Patch(color=COLOURS[0], alpha=0.2, lw=0, label=f"{100 * CONFIDENCE:.0f} % over lights"))
    _key(figure, handles, in_key)
    return figure


@rc_context(SMALL)
def error_by_method(lines: Sequence[Line], axis: Axis) -> Figure:
    """Dots: the metric of each method, for a study with one budget."""
    figure = Figure(figsize=(WIDTH, 0.75 + 0.2 * len(lines)), layout="constrained")
    ax = figure.add_subplot()
    for row, line in enumerate(lines):
        for seen, face in ((~line.at_floor, None), (line.at_floor, PAPER)):
            errors = line.errors[axis.shows(line.errors) & seen]
            ax.plot(errors, np.full(len(errors), row), ls="", **_style(line), mfc=face or _style(line)["color"])
    ax.set_ylim(len(lines) - 0.4, -0.6)
    ax.set_yticks(range(len(lines)), [line.name for line in lines])
    ax.tick_params(axis="y", length=0)
    ax.grid(axis="y", color=INK, alpha=0.15, linewidth=0.6)
    _scale(ax, "x", axis, lines)
    ax.set_xlabel(axis.label)
    return figure


def _draw(ax: Axes, quantity: str, lines: Sequence[Line], axis: Axis) -> None:
    ax.set_xscale("log")
    for line in lines:
        x = _over(line, quantity)
        seen = axis.shows(line.errors) & (x > 0)
        if line.band is not None:
            low, high = line.band
            ax.fill_between(x[seen], low[seen], high[seen], color=_style(line)["color"], alpha=0.15, lw=0)
        ax.plot(x[seen], line.errors[seen], ls="-" if seen.sum() > 1 else "", **_style(line))
        ax.plot(x[seen & line.at_floor], line.errors[seen & line.at_floor], ls="", **_style(line), mfc=PAPER)
    if quantity != SAMPLES:
        _draw_front(ax, quantity, lines, axis)
    _scale(ax, "y", axis, lines)
    values = sorted({float(x) for line in lines for x in _over(line, quantity) if x > 0})
    ax.xaxis.set_major_locator(FixedLocator(_apart(values) if quantity == SAMPLES else _ticks(values)))
    if values and values[-1] < 1.05 * values[0]:  # one cost for all
        ax.set_xlim(values[0] / 2, values[-1] * 2)
    ax.xaxis.set_minor_locator(NullLocator())
    ax.xaxis.set_major_formatter(FuncFormatter(_tick))
    ax.set_xlabel(COSTS.get(quantity, "light samples a pixel"))


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


def _over(line: Line, quantity: str) -> Floats:
    return line.samples if quantity == SAMPLES else line.costs[quantity]


def _named(line: Line, axis: Axis, over_samples: bool) -> str:
    slope = line.slope() if over_samples and axis.is_log else None
    return line.name + ("" if slope is None else f", slope {number(slope, 2)}")


def _style(line: Line) -> dict[str, Any]:
    return {"color": COLOURS[line.index % len(COLOURS)], "marker": MARKERS[line.index % len(MARKERS)]}


def _handle(line: Line, name: str) -> Line2D:
    return Line2D([], [], label=name, **_style(line))


def _key(figure: Figure, handles: Sequence[Artist], columns: int) -> None:
    figure.legend(
        handles=handles, ncols=columns, loc="outside lower left", frameon=False, borderaxespad=0.1,
        handlelength=1.8, columnspacing=1.4, labelspacing=0.3,
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
