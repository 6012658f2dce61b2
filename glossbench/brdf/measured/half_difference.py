"""Half vector and difference: the coordinates in which BRDFs are tabulated."""

from math import pi

import torch

from glossbench.directions import Vec3, dot, half_vector
from glossbench.shapes import Directions, Values


def half_difference(wo: Directions, wi: Directions) -> tuple[Values, Values, Values]:
    """theta_h, theta_d in [0, pi/2] and phi_d in [0, pi) of two directions above the surface.

    h is in the frame of the normal, wi in the frame of h: x towards larger theta_h, y towards larger phi_h. phi_d is
    modulo pi, because swapping wo and wi turns the difference by pi.

    Source: Rusinkiewicz 1998.
    """
    h = half_vector(wo, wi)
    theta_h = torch.atan2(torch.sqrt(h.x * h.x + h.y * h.y), h.z)
    # The lengths of half the difference and half the sum are sine and cosine of theta_d, without loss of digits.
    parts = [Vec3(wi.x + s * wo.x, wi.y + s * wo.y, wi.z + s * wo.z) for s in (-1, 1)]
    theta_d = torch.atan2(*(torch.sqrt(dot(p, p)) for p in parts))
    e_x, e_y = azimuth(h)
    along = wi.x * e_x + wi.y * e_y
    phi_d = torch.atan2(wi.y * e_x - wi.x * e_y, along * h.z - wi.z * torch.sin(theta_h))
    return theta_h, theta_d, torch.remainder(phi_d, pi)


def azimuth(v: Directions) -> tuple[Values, Values]:
    """Cosine and sine of the azimuth of a direction; 1 and 0 for the normal."""
    length2 = v.x * v.x + v.y * v.y
    inverse, at_pole = torch.rsqrt(length2.clamp(min=1e-20)), length2 < 1e-14
    return torch.where(at_pole, 1.0, v.x * inverse), torch.where(at_pole, 0.0, v.y * inverse)
