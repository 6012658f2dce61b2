"""Glossy lobes: one summand of a BRDF with what evaluates it, what samples it, and what lays a pattern over it.

Letters: wo to the viewer, wi to the light, h half vector, all unit and in the local frame, z along the normal;
c = wo . h; u uniform points of the unit square. What depends on the sample only has shape (1, N) and is computed
once (`sample_points`), what depends on the pixel has (P, 1), and the two meet in `sample`.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import torch

from glossbench.channels import Channels, widen
from glossbench.directions import Vec3, points_2d
from glossbench.shapes import (
    Albedo,
    Directions,
    PairDirections,
    PairValues,
    PointDirections,
    Scalar,
    UnitSquare,
    Values,
)


class Sample(NamedTuple):
    """Light directions drawn by a lobe: weight = f cos_i / pdf a channel, zero where wi is not above the surface.

    pdf [1/sr] is positive and finite even where the weight is zero.
    """

    wi: Directions
    pdf: Values
    weight: Channels


@dataclass(frozen=True)
class Lobe:
    """A lobe with tensors for parameters.

    A lobe that is no function of the half vector still has a density D of half vectors, near to the half vectors of
    its own directions: a fixed pattern of them (regular sampling) is laid out by it. By default D is Beckmann's.

    Attributes:
        widths: of D along t and b: Beckmann slopes m_x, m_y or GGX alpha_x, alpha_y.
        ks: factor of the whole lobe, a channel.
    """

    widths: tuple[Scalar, Scalar]
    ks: tuple[Scalar, ...]

    def f_and_pdf(self, wo: Directions, wi: Directions) -> tuple[tuple[PairValues, ...], PairValues]:
        """`f` and `pdf`, which share much."""
        raise NotImplementedError

    def f(self, wo: Directions, wi: Directions) -> tuple[PairValues, ...]:
        """Value [1/sr] a channel, the cosine not included; zero when a direction is below the surface."""
        return self.f_and_pdf(wo, wi)[0]

    def pdf(self, wo: Directions, wi: Directions) -> PairValues:
        """Density [1/sr] of `sample` at wi; zero below the surface, although samples fall there too."""
        return self.f_and_pdf(wo, wi)[1]

    def sample_points(self, u: UnitSquare) -> Any:
        """What of a sample depends on u only."""
        raise NotImplementedError

    def sample(self, wo: Directions, points: Any) -> Sample:
        """Light directions for these sample points."""
        raise NotImplementedError

    def viewer(self, wo: PairDirections) -> PairDirections:
        """The viewer in the lobe's own frame, where the normal is that of a pattern of half vectors: wo itself."""
        return wo

    def to_surface(self, wo: Directions, d: Directions) -> Directions:
        """A direction of the lobe's own frame in the local frame: itself, but for a lobe about an axis of its own."""
        return d

    def q(self, slope2: PairValues) -> PairValues:
        """Density of the slope, over its peak, where (h_x/(w_x h_z))^2 + (h_y/(w_y h_z))^2 = slope2: exp(-slope2)."""
        return torch.exp(-slope2)

    def slope_at(self, q: PairValues) -> PairValues:
        """The root of slope2 where the slope density has fallen to q of its peak, the inverse of `q`: sqrt(-log q)."""
        return torch.sqrt(-torch.log(q))

    def slope2(self, h: PairDirections) -> PairValues:
        """(h_x / (w_x h_z))^2 + (h_y / (w_y h_z))^2"""
        x, y = h.x / (self.widths[0] * h.z), h.y / (self.widths[1] * h.z)
        return x * x + y * y

    def albedo(self, wo: PointDirections, n_samples: int = 4096) -> Albedo:
        """Directional albedo: integral of f(wo, wi) cos_i dwi, RGB.

        By the lobe's own sampler at Hammersley points.
        """
        column = Vec3(*(c[:, None] for c in wo))
        weight = self.sample(column, self.sample_points(points_2d(n_samples).to(wo.z.device))).weight
        means = [w.expand(len(wo.z), n_samples).double().mean(1) for w in weight]
        return torch.stack(widen(tuple(means), 3), dim=1)

    def D(self, h: PairDirections) -> PairValues:
        """Half vector density q / (pi w_x w_y cos_h^4) [1/sr], integral of D cos_h = 1 over the hemisphere."""
        cos2 = h.z * h.z
        return self.q(self.slope2(h)) / (torch.pi * self.widths[0] * self.widths[1] * cos2 * cos2)

    def f_over_D(self, wo: Directions, wi: Directions, h: Directions, c: Values) -> Channels:
        """f(wo, wi) / D(h) a channel, wi = to_surface(wo, mirror direction of viewer(wo) at h), c = viewer(wo) . h."""
        D = self.D(h)
        return tuple(f / D for f in self.f(wo, wi))
