"""Plots for print: panels side by side with one legend, by matplotlib."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import ceil, floor, log10
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator

from ..model.lines import CONFIDENCE, name_lines
from ..model.panels import Axis, Line, Panel
from ..model.selection import pick_evenly
from ..style import COLOURS, DASHES, INK, MARKERS, PAPER, RC, format_number, format_tick, style
from .legends import LAYOUT, ROW, SIZE, count_columns, count_lines, wrap_names

MOST_FACETS = 4
MOST_LINES = 40  # of a plot; the legend of more lines would fill the page
WIDTH = 6.53  # width of the text on a page [inches]
NARROW = 0.6 * WIDTH
FEW_LINES = 12  # in the legend of a single panel, which then has one column
SMALL = {**RC, "font.size": SIZE, "lines.linewidth": 1.1, "lines.markersize": 4}
FRONT: dict[str, Any] = {"color": INK, "lw": 0.8, "ls": (0, (3, 2))}


def split_facets(panels: Sequence[Panel]) -> list[Panel]:
    """A panel for each part of the lines, if there are so many lines that they are divided."""
    found = []
    for panel in panels:
        parts = sorted({line.label.facet for line in panel.lines if line.label.facet is not None})
        if 1 < len(parts) <= MOST_FACETS:
            found += [replace(panel, part=part, title=_join_shared(replace(panel, part=part))) for part in parts]
        else:
            found.append(panel)
    return found


def select_comparable(panels: Sequence[Panel]) -> list[Panel]:
    """The panels that compare two lines, or show the only line. Print does not show costs of zero."""

    def n_costing(panel: Panel) -> int:
        costing = (line.is_seen(panel.x, panel.y) & (line.x >= panel.x.negligible) for line in panel.lines)
        return sum(bool(each.any()) for each in costing)

    return [p for p in panels if not p.x.has_zero or n_costing(p) > 1 or (n_costing(p) and len(p.lines) == 1)]


@style(SMALL)
def draw(panels: Sequence[Panel]) -> Figure:
    """Panels side by side.

    Shaded: errors that the reference cannot resolve. Dashed: the Pareto front. Band: confidence interval of means over
    lights. Thin bar: 95 % interval from the noise of the reference. The legend has all lines with their slopes; of very
    many lines, some at even distances.
    """
    every = {line.label.index: line for panel in reversed(panels) for line in reversed(panel.lines)}
    kept = {line.label.index for line in pick_evenly([every[index] for index in sorted(every)], MOST_LINES)}
    panels = [_thin(panel, kept) for panel in panels]
    if panels[0].y.names:
        return _draw_rows(panels[0], len(every) - len(kept))
    lines = [every[index] for index in sorted(kept)]
    columns = {1: 1, 2: 2, 4: 2}.get(len(panels), 3)
    rows = ceil(len(panels) / columns)
    is_curve = panels[0].is_curve
    looks = [_choose_look(line, is_curve) for line in lines]
    title, names = name_lines([line.label for line in lines])
    names = [name + _format_slope(line) for name, line in zip(names, lines, strict=True)]
    handles: list[Artist] = [Line2D([], [], label=name, **look) for name, look in zip(names, looks, strict=True)]
    handles += _explain(panels, len(every) - len(kept))
    names = [str(handle.get_label()) for handle in handles]
    is_small = len(panels) == 1 and len(names) <= FEW_LINES
    is_narrow = is_small and not is_curve and bool(count_columns([*names, title], NARROW))
    width = NARROW if is_narrow else WIDTH
    names = wrap_names(names, width)
    in_key = 1 if is_small else count_columns(names, width)
    for handle, name in zip(handles, names, strict=True):
        handle.set_label(name)
    height = (
        (1.4 if rows > 1 and panels[0].part is None else 1.9) * rows
        + ROW * (ceil(count_lines(names) / in_key) + bool(title))
        + 0.1
    )
    is_mixed = any(panel.y != panels[0].y for panel in panels)
    figure = Figure(figsize=(width, height), layout="constrained")
    for i, panel in enumerate(panels):
        ax = figure.add_subplot(rows, columns, i + 1)
        _draw(ax, panel)
        ax.set_title(panel.y.label if is_mixed else panel.title, loc="left", size="medium")
        if i % columns == 0 and not is_mixed:
            ax.set_ylabel(panel.y.label)
    figure.legend(
        handles=handles, title=title, alignment="left", ncols=in_key, loc="outside lower left", frameon=False,
        borderaxespad=0.1, **LAYOUT,
    )  # fmt: skip
    return figure


def _draw_rows(panel: Panel, left_out: int) -> Figure:
    """Dots in rows with names."""
    lines, x = panel.lines, panel.x
    title, names = name_lines([line.label for line in lines])
    names = wrap_names(names, WIDTH / 2)
    height = 0.75 + 0.2 * len(lines) + ROW * (count_lines(names) - len(lines))
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    ax = figure.add_subplot()
    for row, line in enumerate(lines):
        for seen, face in ((~line.is_hollow, None), (line.is_hollow, PAPER)):
            values = line.x[x.shows(line.x) & seen]
            look = _choose_look(line) | {"ls": "", "mfc": face or line.label.colour}
            ax.plot(values, np.full(len(values), row), **look)
        if line.interval is not None:
            ax.hlines(np.full(len(line.x), row), *line.interval, colors=line.label.colour, lw=0.8)
    ax.set_ylim(len(lines) - 0.4, -0.6)
    more = f"{left_out} more lines are not drawn here" if left_out else ""
    ax.set_title("; ".join(text for text in (title, more) if text), loc="left", size="medium")
    ax.set_yticks(range(len(lines)), names)
    ax.tick_params(axis="y", length=0)
    ax.grid(axis="y", color=INK, alpha=0.15, linewidth=0.6)
    _scale(ax, "x", x, [line.x for line in lines])
    ax.set_xlabel(x.label)
    return figure


def _draw(ax: Axes, panel: Panel) -> None:
    ax.set_xscale("log" if panel.x.is_log else "linear")
    for line in panel.drawn:
        x, y, seen = line.x, line.y, line.is_seen(panel.x, panel.y)
        look = _choose_look(line, panel.is_curve)
        if line.band is not None:
            low, high = line.band
            ax.fill_between(x[seen], low[seen], high[seen], color=look["color"], alpha=0.15, lw=0)
        if line.spread is not None:
            low, high = line.spread
            ax.hlines(y[seen], low[seen], high[seen], colors=look["color"], lw=2.5, alpha=0.35)
        if line.interval is not None:
            low, high = line.interval
            ax.vlines(x[seen], low[seen], high[seen], colors=look["color"], lw=0.8)
        ax.plot(x[seen], y[seen], **look | ({} if seen.sum() > 1 else {"ls": ""}))
        floored = seen & line.is_hollow
        ax.plot(x[floored], y[floored], **look | {"ls": "", "mfc": PAPER})
    _draw_front(ax, panel)
    _scale(ax, "y", panel.y, [line.y for line in panel.lines])
    ax.set_xlabel(panel.x.label)
    values = sorted({float(x) for line in panel.lines for x in line.x[panel.x.shows(line.x)]})
    ax.xaxis.set_major_formatter(FuncFormatter(_format_tick))
    if panel.x.is_log:
        ax.xaxis.set_major_locator(FixedLocator(_keep_apart(values) if panel.x.at_values else _choose_ticks(values)))
        ax.xaxis.set_minor_locator(NullLocator())
        if values and values[-1] < 1.05 * values[0]:  # all have the same cost
            ax.set_xlim(values[0] / 2, values[-1] * 2)


def _draw_front(ax: Axes, panel: Panel) -> None:
    """Rings around the points of the Pareto front, and stairs through those that no other is below."""
    points = sorted(
        (x, y)
        for line, mask in zip(panel.lines, panel.fronts, strict=bool(panel.fronts))
        for x, y in zip(line.x[mask], line.y[mask], strict=True)
        if x > 0
    )
    if points:
        ax.plot(*zip(*points, strict=True), ls="", marker="o", mfc="none", mec=INK, mew=0.5, ms=7.5, alpha=0.7)
    is_lower, corners = panel.y.is_log, points[:1]
    for x, y in points[1:]:
        if (y < corners[-1][1]) if is_lower else (y > corners[-1][1]):
            corners.append((x, y))
    if len(corners) > 1:
        ax.step(*zip(*corners, strict=True), where="post", **FRONT, alpha=0.7, zorder=1.5)


def _explain(panels: Sequence[Panel], left_out: int) -> list[Artist]:
    """The entries of the legend besides the lines."""
    found: list[Artist] = []
    first = panels[0]
    if first.y.is_log and first.y.floor > 0:
        found.append(Patch(color=INK, alpha=0.1, lw=0, label=f"noise floor, up to {format_number(first.y.floor, 2)}"))
    if any(line.interval is not None for line in first.lines):
        bar: dict[str, Any] = {"ls": "", "marker": "|", "color": INK, "mew": 0.8, "ms": 8}
        found.append(Line2D([], [], **bar, label=f"{100 * CONFIDENCE:.0f} % by noise"))
    if any(panel.fronts for panel in panels):
        found.append(Line2D([], [], **FRONT, label="Pareto front"))
    if any(line.band is not None for line in first.lines):
        found.append(Patch(color=COLOURS[0], alpha=0.2, lw=0, label=f"{100 * CONFIDENCE:.0f} % over lights"))
    if left_out:
        found.append(Line2D([], [], lw=0, label=f"{left_out} more lines are not drawn here"))
    return found


def _thin(panel: Panel, kept: Iterable[int]) -> Panel:
    """The panel with only these lines; the Pareto front stays that of all lines."""
    here = [i for i, line in enumerate(panel.lines) if line.label.index in kept]
    if len(here) == len(panel.lines):
        return panel
    fronts = [panel.fronts[i] for i in here] if panel.fronts else ()
    return replace(panel, lines=[panel.lines[i] for i in here], fronts=fronts)


def _join_shared(panel: Panel) -> str:
    """The options that the lines of a part share."""
    first, *others = (line.label.options for line in panel.drawn if line.label.facet is not None)
    return ", ".join(f"{key} {v}" for key, v in first.items() if all(other.get(key) == v for other in others))


def _format_slope(line: Line) -> str:
    return "" if line.slope is None else f", slope {format_number(line.slope, 2)}"


def _choose_look(line: Line, is_curve: bool = False) -> dict[str, Any]:
    label = line.label
    if is_curve:
        is_reference = label.colour == INK
        return {"color": label.colour, "ls": DASHES[label.dash % len(DASHES)], "lw": 1.8 if is_reference else 0.9}
    return {
        "color": label.colour,
        "marker": MARKERS[label.index % len(MARKERS)],
        "ls": DASHES[label.dash % len(DASHES)],
    }


def _scale(ax: Axes, side: str, axis: Axis, values: Sequence[np.ndarray]) -> None:
    """Limits and ticks of an axis, and the band that the reference cannot resolve."""
    span, limits, scale = (ax.axhspan, ax.set_ylim, ax.yaxis) if side == "y" else (ax.axvspan, ax.set_xlim, ax.xaxis)
    if not axis.is_log:
        scale.set_major_formatter(FuncFormatter(_format_tick))
        if axis.has_zero:
            limits(0)
        return
    (ax.set_yscale if side == "y" else ax.set_xscale)("log")
    seen = [float(v) for each in values for v in each[axis.shows(each)]] or [1.0]
    floor = axis.floor
    # A floor far below every dot would squeeze the dots; then only the legend states it.
    shown = floor > min(seen) / 30
    low, high = min([*seen, floor] if shown else seen) / 1.6, max([*seen, floor] if shown else seen) * 1.6
    if shown:
        span(low, floor, color=INK, alpha=0.1, linewidth=0)
    limits(low, high)
    scale.set_major_locator(_make_locator([low, high]))
    scale.set_minor_locator(LogLocator(subs=range(2, 10), numticks=99))
    scale.set_minor_formatter(NullFormatter())
    scale.set_major_formatter(FuncFormatter(_format_tick))


def _format_tick(value: float, _: int | None = None) -> str:
    return format_tick(value)


def _choose_ticks(values: Sequence[float]) -> list[float]:
    """Round numbers between the lowest and highest value, if there are at least three; otherwise these two values."""
    if not values:
        return []
    low, high = values[0], values[-1]
    powers = range(floor(log10(low)), ceil(log10(high)) + 1)
    for digits in ((1,), (1, 2, 5), range(1, 10)):
        ticks = [value for p in powers for d in digits if low <= (value := float(f"{d}e{p}")) <= high]
        if len(ticks) > 2:
            return _keep_apart(ticks, 0.22)
    return _keep_apart([low, high], 0.22)


def _make_locator(values: Sequence[float]) -> LogLocator:
    wide = bool(values) and values[-1] > 80 * values[0]
    return LogLocator(subs=(1,) if wide else (1, 2, 5), numticks=6)


def _keep_apart(values: Sequence[float], share: float = 0.12) -> list[float]:
    """The values without those so near to the one before, by a share of the log axis, that labels would touch."""
    gap = (values[-1] / values[0]) ** share if values else 1.0
    kept = list(values[:1])
    for value in values[1:]:
        if value >= kept[-1] * gap:
            kept.append(value)
    return kept
