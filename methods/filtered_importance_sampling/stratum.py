"""The mean density of a lobe over the cone that holds the share of one sample."""

from math import pi, sqrt

import torch
from torch import Tensor

from glossbench.prefilter import Lobe, Vec3

ROUNDS = 2
RING = sqrt(5 / 8)  # so that the mean of five directions is that of the cone to second order


def mean_pdf(lobe: Lobe, wo: Vec3, wi: Vec3, pdf: Tensor, n: Tensor) -> Tensor:
    """Mean density of a lobe over a cone about wi of solid angle omega = 1 / (n mean density), at most a hemisphere.

    The mean is over wi and four directions about it. Source: the idea, Tokuyoshi 2016; the adaptation is ours.
    """
    sign = torch.where(wi.z < 0, -1.0, 1.0)
    a = -1 / (sign + wi.z)  # a frame about wi, Duff et al. 2017
    t = Vec3(1 + sign * wi.x * wi.x * a, sign * wi.x * wi.y * a, -sign * wi.x)
    b = Vec3(wi.x * wi.y * a, sign + wi.y * wi.y * a, -wi.y)
    mean = pdf
    for _ in range(ROUNDS):
        omega = (1 / (n * mean)).clamp(max=2 * pi)
        angle = RING * 2 * torch.asin(torch.sqrt(omega / (4 * pi)))
        cos, sin = torch.cos(angle), torch.sin(angle)
        total = pdf
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            e = (x * p + y * q for p, q in zip(t, b, strict=True))
            total = total + lobe.pdf(wo, Vec3(*(cos * c + sin * s for c, s in zip(wi, e, strict=True))))
        mean = total / 5
    return mean
