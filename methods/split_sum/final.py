"""The second factor of a split sum: the directional albedo of a lobe, linear in its f0."""

from dataclasses import dataclass, replace
from math import pi

import torch
from torch import Tensor

from glossbench.prefilter import Microfacet, spherical

VIEWS = 64
AZIMUTHS = 4  # over a quarter of the circle; for an anisotropic lobe the table holds their mean


@dataclass(frozen=True)
class ViewTable:
    """Albedo f0 (y - x) + x, at cos_o = ((i + 1/2) / 64)^2: denser where the view is grazing and the albedo changes.

    Attributes:
        x: integral of f cos_i / F times (1 - c)^5, (64,).
        y: integral of f cos_i / F, (64,).
    """

    x: Tensor
    y: Tensor

    def at(self, cos_o: Tensor) -> tuple[Tensor, Tensor]:
        """x and y, linear in sqrt(cos_o) between the entries."""
        place = (torch.sqrt(cos_o.clamp(0, 1)) * VIEWS - 0.5).clamp(0, VIEWS - 1)
        lower = place.long().clamp(max=VIEWS - 2)
        share = place - lower
        x, y = (torch.lerp(table[lower], table[lower + 1], share) for table in (self.x, self.y))
        return x, y


def build_table(lobe: Microfacet) -> ViewTable:
    """The table of a lobe: its albedo for f0 = 0 and for f0 = 1, by its own sampler."""
    isotropic = bool(lobe.widths[0] == lobe.widths[1])
    n = 1 if isotropic else AZIMUTHS
    cos_o = ((torch.arange(VIEWS) + 0.5) / VIEWS) ** 2
    phi = (torch.arange(n) + 0.5) / n * (pi / 2)
    angles = (cos_o.acos().repeat_interleave(n), phi.repeat(VIEWS))
    wo = spherical(*(angle.to(lobe.ks[0].device) for angle in angles))
    one = torch.ones_like(lobe.ks[0])
    x, y = (replace(lobe, ks=(one,), f0=(f0,)).albedo(wo)[:, 0].view(VIEWS, n).mean(1).float() for f0 in (0 * one, one))
    return ViewTable(x, y)


def fit_terms(roughness: float, cos_o: Tensor) -> tuple[Tensor, Tensor]:
    """x and y of GGX by four lines and a power. Source: Karis 2014, "Physically Based Shading on Mobile"."""
    first, second, third, fourth = (
        roughness * a + b for a, b in ((-1, 1), (-0.0275, 0.0425), (-0.572, 1.04), (0.022, -0.04))
    )
    a004 = torch.clamp(torch.exp2(-9.28 * cos_o), max=first * first) * first + second
    scale, bias = -1.04 * a004 + third, 1.04 * a004 + fourth
    return bias, scale + bias
