"""Figures of a report: error against cost, sample patterns, colour bars.

They are matplotlib figures without global state; `svg` gives the same bytes for the same data.
"""

import re
from collections.abc import Sequence
from io import StringIO
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from .lines import COSTS, Axis, Line
from .pictures import SIGNED, UNSIGNED, Floats

INK, PAPER = "#1a1a1a", "#fefefe"
# Okabe and Ito 2008 without yellow and black: told apart by colour-blind readers, on white and on near-black.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
MARKERS = "osD^vPX"  # seven against six colours: 42 lines before a pair repeats
RC: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "ytick.minor.width": 0.4,
    "xtick.minor.width": 0.4,
    "lines.linewidth": 1.3,
    "lines.markersize": 5,
    "text.parse_math": False,  # a name may hold a dollar sign
    "svg.fonttype": "none",
} | dict.fromkeys(("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color"), INK)


def number(value: float | None, digits: int = 3) -> str:
    """A number with so many significant digits, as print sets it: 0.0123, 1240, 1.20×10⁻⁶; – for none."""
    if value is None or np.isnan(value):
        return "–"
    if value == 0 or np.isinf(value):
        return "0" if value == 0 else "∞"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    if -4 <= int(exponent) < 6:
        return f"{value:.{max(0, digits - 1 - int(exponent))}f}".replace("-", "−")
    raised = str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{mantissa}×10{raised}".replace("-", "−")


def _tick(value: float, _: int | None = None) -> str:
    mantissa = f"{value:.2e}".split("e")[0].rstrip("0").rstrip(".")
    text = number(value, len(mantissa.replace(".", "").replace("-", "")))
    return text.removeprefix("1×")


@rc_context(RC)
def error_over(quantity: str, lines: Sequence[Line], axis: Axis) -> Figure:
    """Plot of a metric over `samples` or a cost of `COSTS`; shaded up to twice the reference's noise."""
    handles = len(lines) + 1
    figure = Figure(figsize=(4.7, 2.9 + 0.19 * handles), layout="constrained")
    ax = figure.add_subplot()
    ax.set_xscale("log")
    for line in lines:
        x = _over(line, quantity)
        style = _style(line)
        slope = line.slope() if quantity == "samples" and axis.is_log else None
        label = line.name + ("" if slope is None else f", slope {number(slope)}")
        seen = axis.shows(line.errors) & (x > 0)
        ax.plot(x[seen], line.errors[seen], label=label, ls="-" if seen.sum() > 1 else "", **style)
        ax.plot(x[seen & line.at_floor], line.errors[seen & line.at_floor], ls="", mfc=PAPER, **style)
    band = _scaled(ax, "y", axis, lines)
    values = sorted({float(x) for line in lines for x in _over(line, quantity) if x > 0})
    if quantity == "samples" and values:
        ax.xaxis.set_major_locator(FixedLocator(_apart(values)))
    else:
        ax.xaxis.set_major_locator(_locator(values))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.xaxis.set_major_formatter(FuncFormatter(_tick))
    ax.set_xlabel(COSTS.get(quantity, "light samples a pixel"))
    _legend(figure, ax, band)
    return figure


def _over(line: Line, quantity: str) -> Floats:
    return line.samples if quantity == "samples" else line.costs[quantity]


@rc_context(RC)
def error_by_method(lines: Sequence[Line], axis: Axis) -> Figure:
    """Dots: the metric of each method, for a study with one budget."""
    figure = Figure(figsize=(4.7, 1.3 + 0.26 * len(lines)), layout="constrained")
    ax = figure.add_subplot()
    for row, line in enumerate(lines):
        y = np.full(len(line.errors), row)
        seen, floor = axis.shows(line.errors), line.at_floor
        ax.plot(line.errors[seen & ~floor], y[seen & ~floor], ls="", **_style(line))
        ax.plot(line.errors[seen & floor], y[seen & floor], ls="", mfc=PAPER, **_style(line))
    ax.set_ylim(len(lines) - 0.4, -0.6)
    ax.set_yticks(range(len(lines)), [line.name for line in lines])
    ax.tick_params(axis="y", length=0)
    ax.grid(axis="y", color=INK, alpha=0.15, linewidth=0.6)
    band = _scaled(ax, "x", axis, lines)
    _legend(figure, ax, band)
    return figure


def _legend(figure: Figure, ax: Axes, band: Patch | None) -> None:
    handles, labels = ax.get_legend_handles_labels()
    if band is not None:
        handles, labels = [*handles, band], [*labels, str(band.get_label())]
    if handles:
        figure.legend(
            handles=handles,
            labels=labels,
            loc="outside lower left",
            frameon=False,
            borderaxespad=0.2,
            handlelength=1.8,
        )


def _scaled(ax: Axes, side: str, axis: Axis, lines: Sequence[Line]) -> Patch | None:
    """Label, limits and ticks of the metric's axis; for the key, the band that the reference cannot resolve."""
    span, limits, scale = (ax.axhspan, ax.set_ylim, ax.yaxis) if side == "y" else (ax.axvspan, ax.set_xlim, ax.xaxis)
    scale.set_label_text(axis.label)
    if not axis.is_log:
        scale.set_major_formatter(FuncFormatter(_tick))
        return None
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
    label = f"twice the reference's noise, {number(floor, 2)}" + ("" if shown else " (off the axis)")
    return Patch(color=INK, alpha=0.1, linewidth=0, label=label) if floor > 0 else None


def _locator(values: Sequence[float]) -> LogLocator:
    wide = bool(values) and values[-1] > 80 * values[0]
    return LogLocator(subs=(1,) if wide else (1, 2, 5), numticks=9)


def _apart(values: Sequence[float]) -> list[float]:
    """Values, but none so near to the one before it on a log axis that their labels would touch."""
    gap = (values[-1] / values[0]) ** 0.07
    kept = [values[0]]
    for value in values[1:]:
        if value >= kept[-1] * gap:
            kept.append(value)
    return kept


def _style(line: Line) -> dict[str, Any]:
    return {"color": COLOURS[line.index % len(COLOURS)], "marker": MARKERS[line.index % len(MARKERS)]}


@rc_context(RC)
def pattern(half_vectors: Floats, largest: float) -> Figure:
    """Half vectors (N, 2), theta and phi, as dots: radius theta up to `largest` [degrees], angle phi."""
    figure = Figure(figsize=(2.3, 2.3), layout="constrained")
    ax = figure.add_subplot(projection="polar")
    theta, phi = half_vectors.T
    ax.scatter(phi, np.degrees(theta), s=7, color=COLOURS[0], linewidths=0, clip_on=False, zorder=3)
    ax.set_ylim(0, largest)
    rings = [r for r in MaxNLocator(3).tick_values(0, largest) if 0 < r <= largest]
    ax.set_yticks(rings, [f"{r:g}°" for r in rings])
    ax.set_xticks(np.radians([0, 90, 180, 270]), ["0°", "90°", "180°", "270°"])
    ax.tick_params(labelsize=8, pad=1)
    ax.grid(color=INK, alpha=0.2, linewidth=0.5)
    ax.spines["polar"].set_linewidth(0.5)
    return figure


@rc_context(RC)
def colour_bar(limit: float, label: str, signed: bool = True) -> Figure:
    """The scale of error maps, from -limit or from 0 to +limit."""
    figure = Figure(figsize=(4.2, 0.62))
    ax = figure.add_axes((0.05, 0.72, 0.9, 0.26))
    low, colours = (-limit, SIGNED) if signed else (0.0, UNSIGNED)
    ax.imshow(np.linspace(0, 1, 255)[None], cmap=colours, aspect="auto", extent=(low, limit, 0, 1))
    ticks = np.linspace(low, limit, 5)
    ax.set_xticks(ticks, [number(t, 2) for t in ticks])
    ax.set_yticks([])
    ax.spines[:].set_visible(False)
    ax.set_xlabel(label)
    return figure


@rc_context(RC)
def svg(figure: Figure, name: str) -> str:
    """A figure as <svg>: text stays text, in the ink and on the paper of the page; `name` is unique there."""
    out = StringIO()
    with rc_context({"svg.hashsalt": name}):
        nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        figure.savefig(out, format="svg", transparent=True, metadata=nothing)
    text = out.getvalue()
    text = re.sub(r'<g id="[^"]*"', "<g", text[text.index("<svg") :])  # matplotlib numbers them anew in each figure
    text = text.replace(INK, "currentColor").replace(PAPER, "var(--paper, white)")
    return text.replace("<svg ", '<svg role="img" ', 1)
