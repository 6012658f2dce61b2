"""Glossy lobes: microfacet reflection f = ks F(wo.h) D(h) V(wo, wi), and what samples it.

Letters: wo to the viewer, wi to the light, h half vector, all unit and in the local frame, z along the normal;
c = wo . h; u uniform points of the unit square. What depends on the sample only has shape (1, N) and is computed
once (`sample_points`), what depends on the pixel has (P, 1), and the two meet in `sample`.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import torch
from torch import Tensor

from glossbench.directions import Vec3, dot, half_vector

Channels = tuple[Tensor, ...]  # one tensor for a grey quantity, three for red, green and blue


class Sample(NamedTuple):
    """Light directions drawn by a lobe: weight = f cos_i / pdf a channel, zero where wi is not above the surface.

    pdf [1/sr] is positive and finite even where the weight is zero.
    """

    wi: Vec3
    pdf: Tensor
    weight: Channels


@dataclass(frozen=True)
class Lobe:
    """A microfacet lobe with tensors for parameters.

    Attributes:
        widths: of the distribution along t and b: Beckmann slopes m_x, m_y or GGX alpha_x, alpha_y.
        f0: reflectance at normal incidence, a channel.
        ks: factor of the whole lobe, a channel.
    """

    widths: tuple[Tensor, Tensor]
    f0: Channels
    ks: Channels

    def q(self, slope2: Tensor) -> Tensor:
        """Density of the slope, over its peak, where (h_x/(w_x h_z))^2 + (h_y/(w_y h_z))^2 = slope2; 1 at 0."""
        raise NotImplementedError

    def slope_at(self, q: Tensor) -> Tensor:
        """The root of slope2 where the slope density has fallen to q of its peak: the inverse of `q`."""
        raise NotImplementedError

    def V(self, wo: Vec3, wi: Vec3, c: Tensor) -> Tensor:
        """f over D F ks: shadowing and the change of measure."""
        raise NotImplementedError

    def sample_points(self, u: Tensor) -> Any:
        """What of a sample depends on u (N, 2) only."""
        raise NotImplementedError

    def sample(self, wo: Vec3, points: Any) -> Sample:
        """Light directions for these sample points."""
        raise NotImplementedError

    def pdf_over_D(self, wo: Vec3, h: Vec3, c: Tensor) -> Tensor:
        """Density [1/sr] of `sample` at the reflection of wo at h, over D(h)."""
        raise NotImplementedError

    def slope2(self, h: Vec3) -> Tensor:
        """(h_x / (w_x h_z))^2 + (h_y / (w_y h_z))^2"""
        x, y = h.x / (self.widths[0] * h.z), h.y / (self.widths[1] * h.z)
        return x * x + y * y

    def D(self, h: Vec3) -> Tensor:
        """Microfacet density q / (pi w_x w_y cos_h^4) [1/sr], integral of D cos_h = 1 over the hemisphere."""
        cos2 = h.z * h.z
        return self.q(self.slope2(h)) / (torch.pi * self.widths[0] * self.widths[1] * cos2 * cos2)

    def F(self, c: Tensor) -> Channels:
        """ks (f0 + (1 - f0) (1 - c)^5), Schlick 1994, the lobe's factor included."""
        m = 1 - c
        m2 = m * m
        schlick = m2 * m2 * m
        n = max(len(self.f0), len(self.ks))
        pairs = zip(_widen(self.f0, n), _widen(self.ks, n), strict=True)
        return tuple(ks * (f0 + (1 - f0) * schlick) for f0, ks in pairs)

    def f_and_pdf(self, wo: Vec3, wi: Vec3) -> tuple[Channels, Tensor]:
        """`f` and `pdf`, which share the half vector and D."""
        h = half_vector(wo, wi)
        c = dot(wo, h)
        D = self.D(h)
        # Below the surface D and V may overflow: the mask is last, and NaN does not pass a where.
        above = (wo.z > 0) & (wi.z > 0)
        value = torch.where(above, D * self.V(wo, wi, c), 0.0)
        pdf = torch.where(above, D * self.pdf_over_D(wo, h, c), 0.0)
        return tuple(F * value for F in self.F(c)), pdf

    def f(self, wo: Vec3, wi: Vec3) -> Channels:
        """ks F D V [1/sr] a channel, the cosine not included; zero when a direction is below the surface."""
        return self.f_and_pdf(wo, wi)[0]

    def pdf(self, wo: Vec3, wi: Vec3) -> Tensor:
        """Density [1/sr] of `sample` at wi; zero below the surface, although samples fall there too."""
        return self.f_and_pdf(wo, wi)[1]


def _widen(channels: Channels, n: int) -> Channels:
    return channels * n if len(channels) == 1 else channels


def add(a: Channels, b: Channels) -> Channels:
    """Channel by channel; an empty tuple is zero, a grey one counts for all three channels."""
    if not a or not b:
        return a or b
    n = max(len(a), len(b))
    return tuple(x + y for x, y in zip(_widen(a, n), _widen(b, n), strict=True))


def channels(color: tuple[float, ...], device: str) -> Channels:
    """A colour as tensors: one when its components are equal, else three."""
    values = color[:1] if len(set(color)) == 1 else color
    return tuple(torch.tensor(v, dtype=torch.float32, device=device) for v in values)
