"""The style of a report: numbers, colours and markers of plots, sample patterns, colour bars.

Figures use no global state of matplotlib; `to_svg` returns the same bytes for the same data, in any style of the user.
"""

import re
import threading
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import StringIO
from typing import Any

import numpy as np
from matplotlib import rc_context, rcParamsDefault
from matplotlib.figure import Figure

from .raster import SIGNED, UNSIGNED, Floats

INK, PAPER = "#1a1a1a", "#fefefe"
# One colour per method. First Okabe and Ito 2008 without yellow and black: colour-blind readers can distinguish them on
# white and on near-black. Then, for more methods, some of Tol's muted scheme (2021).
COLOURS = (
    *("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"),
    *("#882255", "#999933", "#44aa99", "#7b6fd0", "#117733"),
)
SHADES = 0.4  # largest share of white or black that is mixed in: the lightest and the darkest line of a method
MARKERS = "osD^vPX"  # one per line; 7 and the 11 colours share no divisor
DASHES: Sequence[Any] = ("-", (0, (5, 1.5)), (0, (1.5, 1.5)), (0, (6, 1.5, 1.5, 1.5)))
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
    "text.parse_math": False,  # a name may contain a dollar sign
    "svg.fonttype": "none",
} | dict.fromkeys(("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color"), INK)

# The defaults of all parameters of matplotlib, except the back end.
_PLAIN: dict[Any, Any] = {key: value for key, value in rcParamsDefault.items() if not key.startswith("backend")}
_drawing = threading.RLock()  # the parameters are one set for all threads


@contextmanager
def style(parameters: Mapping[Any, Any]) -> Iterator[None]:
    """Draw with these parameters inside the block or the decorated function; then restore the user's parameters."""
    with _drawing, rc_context({**_PLAIN, **parameters}):
        yield


def format_number(value: float | None, digits: int = 3) -> str:
    """A number with this many significant digits, as in print: 0.0123, 1240, 1.20×10⁻⁶; – for None."""
    if value is None or np.isnan(value):
        return "–"
    if value == 0 or np.isinf(value):
        return "0" if value == 0 else "∞"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    if -4 <= int(exponent) < 6:
        return f"{value:.{max(0, digits - 1 - int(exponent))}f}".replace("-", "−")
    raised = str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{mantissa}×10{raised}".replace("-", "−")


def format_tick(value: float) -> str:
    """A round number without trailing digits: 0.05, 1.5, 200, 10⁻⁷."""
    mantissa = f"{value:.2e}".split("e")[0].rstrip("0").rstrip(".")
    return format_number(value, len(mantissa.replace(".", "").replace("-", ""))).removeprefix("1×")


def format_whole(value: float | None) -> str:
    """A whole number with narrow spaces between thousands."""
    if value is None:
        return "–"
    return f"{round(value):,}".replace(",", "\u202f") if value >= 1e4 else str(round(value))


def format_stops(exposure: float) -> str:
    """A factor of exposure in stops, as photographers write it: +1.5."""
    return f"{round(float(np.log2(exposure)), 1) + 0.0:+.1f}".replace("-", "−")


def assign_looks(methods: Sequence[str], hues: Mapping[str, int]) -> list[tuple[str, int]]:
    """For each line: its colour, and its index among the lines of its method, which selects the dashes.

    Args:
        methods: the method of each line.
        hues: the index of each method, which selects its colour.
    """
    count, place = Counter(methods), Counter[str]()
    found = []
    for method in methods:
        found.append((shade(hues[method], place[method], count[method]), place[method]))
        place[method] += 1
    return found


def shade(method: int, i: int = 0, n: int = 1) -> str:
    """The colour of line i of n of a method: a single line has the base colour; of several the first is the darkest."""
    base = COLOURS[method % len(COLOURS)]
    share = SHADES * (2 * i / (n - 1) - 1) if n > 1 else 0.0
    target = 255 if share > 0 else 0
    parts = (int(base[at : at + 2], 16) for at in (1, 3, 5))
    return "#" + "".join(f"{round(part + abs(share) * (target - part)):02x}" for part in parts)


def polar(half_vectors: Floats, largest: float) -> list[tuple[float, float]]:
    """Half vectors (N, 2), theta and phi, as positions on a disc of radius 100: there theta is `largest` [degrees]."""
    theta, phi = half_vectors.T
    radius = 100 * np.degrees(theta) / largest
    # y goes down on a page.
    return [
        (round(float(x), 2), round(float(y), 2))
        for x, y in zip(radius * np.cos(phi), -radius * np.sin(phi), strict=True)
    ]


@style(RC)
def draw_colour_bar(limit: float, label: str, signed: bool = True) -> Figure:
    """The scale of error maps, from -limit or from 0 to +limit."""
    figure = Figure(figsize=(4.2, 0.62))
    ax = figure.add_axes((0.05, 0.72, 0.9, 0.26))
    low, colours = (-limit, SIGNED) if signed else (0.0, UNSIGNED)
    ax.imshow(np.linspace(0, 1, 255)[None], cmap=colours, aspect="auto", extent=(low, limit, 0, 1))
    ticks = np.linspace(low, limit, 5)
    ax.set_xticks(ticks, [format_number(t, 2) for t in ticks])
    ax.set_yticks([])
    ax.spines[:].set_visible(False)
    ax.set_xlabel(label)
    return figure


def to_svg(figure: Figure, name: str) -> str:
    """A figure as <svg>: text stays text, in the colours of the page; `name` is unique on the page."""
    out = StringIO()
    with style({**RC, "svg.hashsalt": name}):
        nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        figure.savefig(out, format="svg", transparent=True, metadata=nothing)
    text = out.getvalue()
    text = re.sub(r'<g id="[^"]*"', "<g", text[text.index("<svg") :])  # matplotlib numbers them again in each figure
    text = text.replace(INK, "currentColor").replace(PAPER, "var(--paper, white)")
    return text.replace("<svg ", '<svg role="img" ', 1)
