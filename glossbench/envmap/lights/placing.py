"""The position of a lamp by azimuth and elevation."""

from math import cos, radians, sin

import torch
from torch import Tensor


def build_frame(azimuth: float, elevation: float) -> Tensor:
    """Rows (3, 3), float64: the direction to a lamp, and right and up for a viewer who looks at it.

    toward = (sin a cos e, sin e, -cos a cos e), right = (cos a, 0, sin a), up = right x toward.

    Args:
        azimuth: a, from forward (-z) to the right (+x) [degrees].
        elevation: e, above the horizon [degrees].
    """
    a, e = radians(azimuth), radians(elevation)
    toward = (sin(a) * cos(e), sin(e), -cos(a) * cos(e))
    up = (-sin(a) * sin(e), cos(e), cos(a) * sin(e))
    return torch.tensor([toward, (cos(a), 0.0, sin(a)), up], dtype=torch.float64)
