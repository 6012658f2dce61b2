"""The mean density of a lobe where one sample stands for it: over a cone, or over the sample's own stratum."""

from math import pi, sqrt

import torch
from torch import Tensor

from glossbench.prefilter import Lobe, Vec3

ROUNDS = 2
RING = sqrt(5 / 8)  # so that the mean of five directions is that of the cone to second order
EDGE = 1e-6  # a stratum ends so far from the edge of the unit square, where some lobes have infinite slopes


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


def stratum_ratio(lobe: Lobe, u: Tensor) -> Tensor:
    """Mean density over each point's own stratum, divided by the density at the point, for a view along the normal.

    ratio_i = 1 / (N omega_i p_i), omega_i = dphi (cos_l(u-) - cos_l(u+)), at most a hemisphere. The stratum of a point
    is the square of side 1 / sqrt(N) about it, moved into the unit square along u1; phi, which u2 rules, is periodic.
    cos_l comes from the lobe's own sampler, by u1 alone. Other views are taken to have the same ratio.

    Args:
        u: points (N, 2).

    Returns:
        (1, N)

    Source: the idea, Tokuyoshi 2016; the adaptation is ours.
    """
    side = 1 / sqrt(len(u))
    low = (u[:, 0] - side / 2).clamp(0, 1 - side)
    middle, left, right = low + side / 2, (u[:, 1] - side / 2) % 1, (u[:, 1] + side / 2) % 1
    up = Vec3(*(u.new_tensor([[c]]) for c in (0.0, 0.0, 1.0)))

    def sample(u1: Tensor, u2: Tensor) -> tuple[Vec3, Tensor]:
        points = torch.stack([u1.clamp(EDGE, 1 - EDGE), u2], dim=1)
        drawn = lobe.sample(up, lobe.sample_points(points))
        return drawn.wi, drawn.pdf

    (inner, _), (outer, _) = sample(low, u[:, 1]), sample(low + side, u[:, 1])
    (a, _), (b, _) = sample(middle, left), sample(middle, right)
    phi = torch.atan2(a.x * b.y - a.y * b.x, a.x * b.x + a.y * b.y).abs()
    omega = ((inner.z - outer.z).abs() * phi).clamp(max=2 * pi)
    return 1 / (len(u) * omega * sample(*u.unbind(1))[1])
