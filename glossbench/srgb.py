"""The sRGB curve, IEC 61966-2-1: from linear light to the encoded value for a display, and back. Values in [0, 1]."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def encode(linear: Floats) -> Floats:
    """12.92 x up to x = 0.0031308, then 1.055 x^(1 / 2.4) - 0.055."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def decode(v: Floats) -> Floats:
    """v / 12.92 up to v = 0.04045, then ((v + 0.055) / 1.055)^2.4."""
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
