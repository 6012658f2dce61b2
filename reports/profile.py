"""Cross sections for print: radiance along one row of pixels, of the reference and of each method."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from .figures import COLOURS, INK, style
from .pictures import Floats, Mask
from .print_plots import SMALL, WIDTH

STYLES = ("-", "--", ":", "-.")  # one for each turn through the colours


def brightest_row(reference: Floats, mask: Mask) -> int:
    """The row of the pixel of a reference (H, W, 3) that is brightest on the surface."""
    return int(np.where(mask, reference.sum(axis=2), -np.inf).argmax() // mask.shape[1])


@style(SMALL)
def cross_section(images: Sequence[tuple[str, Floats]], mask: Mask, row: int) -> Figure:
    """Radiance, the mean of the channels, of a row of images (H, W, 3) over its columns; the first is the reference."""
    figure = Figure(figsize=(WIDTH, 2.2 + 0.14 * len(images)), layout="constrained")
    ax = figure.add_subplot()
    x = np.flatnonzero(mask[row])
    for i, (name, image) in enumerate(images):
        turn, number = divmod(i - 1, len(COLOURS))
        style = STYLES[turn % len(STYLES)] if i else "-"
        colour = COLOURS[number] if i else INK
        ax.plot(x, image[row, x].mean(axis=1), label=name, color=colour, ls=style, lw=0.9 if i else 1.8)
    ax.set_xlabel(f"column [pixels], in row {row}")
    ax.set_ylabel("radiance")
    ax.set_ylim(bottom=0)
    figure.legend(loc="outside lower left", frameon=False, borderaxespad=0.1, labelspacing=0.3)
    return figure
