"""Crops: the windows of an image where methods err most, without overlap."""

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np
import scipy

from ..raster import Floats, Mask

Pixels = TypeVar("Pixels", Floats, Mask)
SHARE = 6  # the side of a crop is the shorter side of the image divided by this
SMALLEST = 12  # pixels on the side of a crop


class Crop(NamedTuple):
    """A window [pixels]: its upper left corner, from the upper left corner of the image, and its size."""

    x: int
    y: int
    width: int
    height: int

    def cut(self, image: Pixels) -> Pixels:
        """The part of an image (H, W, ...) in the window."""
        return image[self.y : self.y + self.height, self.x : self.x + self.width]


def choose_crops(errors: Sequence[Floats], mask: Mask, limit: float, n: int = 2) -> list[Crop]:
    """At most n square windows that do not overlap, each with the largest mean |error| outside the earlier ones.

    Errors (H, W) are those of all compared images. They are clipped at `limit`, so that no single pixel decides,
    and are zero off the mask, so that windows lie on the surface.
    """
    side = min(max(SMALLEST, round(min(mask.shape) / SHARE)), *mask.shape)
    clipped = [np.where(mask & np.isfinite(error), np.minimum(np.abs(error), limit), 0) for error in errors]
    if not clipped:
        return []
    score = scipy.ndimage.uniform_filter(np.mean(clipped, axis=0), side, mode="constant")
    # uniform_filter centres its windows: score[i + side // 2] is that of the window that begins at i.
    height, width = (size - side + 1 for size in mask.shape)
    left = np.array(score[side // 2 : side // 2 + height, side // 2 : side // 2 + width])
    found: list[Crop] = []
    while len(found) < n and left.size and left.max() > 0:
        y, x = (int(i) for i in np.unravel_index(np.argmax(left), left.shape))
        found.append(Crop(x, y, side, side))
        left[max(0, y - side + 1) : y + side, max(0, x - side + 1) : x + side] = 0
    return found
