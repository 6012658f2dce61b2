"""Directional albedo of a lobe as a table over views, for methods whose filtered light is a mean over the lobe."""

from math import pi

import torch
from jaxtyping import Float32

from glossbench.brdf.lobe import Lobe
from glossbench.directions import Vec3, spherical
from glossbench.shapes import PointDirections, Radiance

COSINES, AZIMUTHS = 64, 9

AlbedoTable = Float32[torch.Tensor, "cosines azimuths 3"]


def tabulate_albedo(lobe: Lobe) -> AlbedoTable:
    """A(wo) = integral of f(wo, wi) cos_i dwi over cos_o in (0, 1) and an azimuth in [0, pi / 2], RGB.

    A quarter of all azimuths is enough: the lobes here are symmetric about t and b.
    """
    cos = (torch.arange(COSINES, dtype=torch.float64) + 0.5) / COSINES
    azimuth = torch.linspace(0, pi / 2, AZIMUTHS, dtype=torch.float64)
    theta, phi = torch.meshgrid(cos.acos(), azimuth, indexing="ij")
    views = Vec3(*(c.float().flatten().to(lobe.widths[0].device) for c in spherical(theta, phi)))
    return lobe.albedo(views).float().view(COSINES, AZIMUTHS, 3)


def read_albedo(table: AlbedoTable, wo: PointDirections) -> Radiance:
    """The albedo at views in the local frame, bilinear between the entries."""
    x = (wo.z * COSINES - 0.5).clamp(0, COSINES - 1)
    y = torch.atan2(wo.y.abs(), wo.x.abs()) * ((AZIMUTHS - 1) / (pi / 2))
    i, j = x.long().clamp(max=COSINES - 2), y.long().clamp(max=AZIMUTHS - 2)
    x, y = (x - i)[:, None], (y - j)[:, None]
    low, high = (torch.lerp(table[i + k, j], table[i + k, j + 1], y) for k in (0, 1))
    return torch.lerp(low, high, x)
