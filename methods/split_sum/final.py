"""The second factor of a split sum: the directional albedo f0 (y - x) + x of a lobe, y that of f0 = 1, x of f0 = 0."""

from dataclasses import replace

import torch
from torch import Tensor

from glossbench.prefilter import Microfacet, Vec3, ViewTable, tabulate


def build_table(lobe: Microfacet) -> ViewTable:
    """x and y over cos_o, by the lobe's own sampler."""
    one = torch.ones_like(lobe.ks[0])
    ends = [replace(lobe, ks=(one,), f0=(f0,)) for f0 in (0 * one, one)]

    def both(wo: Vec3) -> Tensor:
        return torch.stack([end.albedo(wo)[:, 0] for end in ends], dim=1)

    return tabulate(lobe, both)


def fit_terms(roughness: float, cos_o: Tensor) -> Tensor:
    """x and y of GGX (P, 2), by four lines and a power. Source: Karis 2014, "Physically Based Shading on Mobile"."""
    first, second, third, fourth = (
        roughness * a + b for a, b in ((-1, 1), (-0.0275, 0.0425), (-0.572, 1.04), (0.022, -0.04))
    )
    a004 = torch.clamp(torch.exp2(-9.28 * cos_o), max=first * first) * first + second
    scale, bias = -1.04 * a004 + third, 1.04 * a004 + fourth
    return torch.stack([bias, scale + bias], dim=1)
