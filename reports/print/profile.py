"""Cross sections for print: radiance along one row of pixels, of the reference and of each method."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ..raster import Floats, Mask
from ..style import INK, style
from .plots import DASHES, SMALL, WIDTH


def brightest_row(reference: Floats, mask: Mask) -> int:
    """The row of the pixel of a reference (H, W, 3) that is brightest on the surface."""
    return int(np.where(mask, reference.sum(axis=2), -np.inf).argmax() // mask.shape[1])


@style(SMALL)
def cross_section(
    reference: Floats, images: Sequence[tuple[str, Floats, tuple[str, int]]], mask: Mask, row: int
) -> Figure:
    """Radiance, the mean of the channels, of a row of images (H, W, 3) over its columns.

    Args:
        images: of each the name, the pixels, and the look of its line: colour and place among those of its method.
    """
    figure = Figure(figsize=(WIDTH, 2.34 + 0.14 * len(images)), layout="constrained")
    ax = figure.add_subplot()
    x = np.flatnonzero(mask[row])
    ax.plot(x, reference[row, x].mean(axis=1), label="reference", color=INK, lw=1.8)
    for name, image, (colour, dash) in images:
        dashes = DASHES[dash % len(DASHES)]
        ax.plot(x, image[row, x].mean(axis=1), label=name, color=colour, ls=dashes, lw=0.9)
    ax.set_xlabel(f"column [pixels], in row {row}")
    ax.set_ylabel("radiance")
    ax.set_ylim(bottom=0)
    figure.legend(loc="outside lower left", frameon=False, borderaxespad=0.1, labelspacing=0.3)
    return figure
