"""Tone curves: from radiance to the range of a display, [0, 1], before the sRGB curve."""

from math import sqrt

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from glossbench.channels import LUMINANCE

Floats = NDArray[np.float64]

# The fit of Narkowicz 2015 without its pre-exposure of 0.6.
A, B, C, D, E = 0.6**2 * 2.51, 0.6 * 0.03, 0.6**2 * 2.43, 0.6 * 0.59, 0.14


def aces(x: Floats) -> Floats:
    """(A x^2 + B x) / (C x^2 + D x + E), clipped to [0, 1]."""
    return np.clip((A * x + B) * x / ((C * x + D) * x + E), 0, 1)


def invert_aces(y: float) -> float:
    """The inverse of `aces`: the x with aces(x) = y, for y below 1."""
    a, b, c = A - y * C, B - y * D, -y * E
    return (-b + sqrt(b * b - 4 * a * c)) / (2 * a)


def reinhard(x: Tensor) -> Tensor:
    """x / (1 + Y), Y the luminance of x (..., 3): colours keep their ratios, and values above 1 are clipped.

    Source: Reinhard et al. 2002, eq. 3.
    """
    return (x / (1 + x @ torch.tensor(LUMINANCE).to(x))[..., None]).clamp(0, 1)
