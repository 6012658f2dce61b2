"""Errors of single pixels, each with its formula. The viewer computes the same errors, and tests compare them."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
EPSILON = 0.01  # [radiance], of the relative error
ERRORS = {
    "signed": ("signed", "mean(x − y) [radiance]"),
    "absolute": ("absolute", "mean |x − y| [radiance]"),
    "squared": ("squared", "mean (x − y)² [radiance²]"),
    "relative": ("relative", f"mean |x − y| / (|y| + {EPSILON})"),
    "smape": ("SMAPE", "mean 2 |x − y| / (|x| + |y|)"),
    "flip": ("FLIP", "HDR-FLIP(x, y)"),
}


def compute_error(mode: str, x: Floats, y: Floats) -> Floats:
    """The error of each pixel of radiance (..., 3), by the formula in ERRORS; not for FLIP."""
    d = x - y
    match mode:
        case "signed":
            return d.mean(axis=-1)
        case "absolute":
            return np.abs(d).mean(axis=-1)
        case "squared":
            return (d * d).mean(axis=-1)
        case "relative":
            return (np.abs(d) / (np.abs(y) + EPSILON)).mean(axis=-1)
        case "smape":
            size = np.abs(x) + np.abs(y)
            return (2 * np.abs(d) / np.where(size > 0, size, 1)).mean(axis=-1)
    raise ValueError(mode)
