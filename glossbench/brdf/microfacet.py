"""Microfacet lobes: f = ks F(wo.h) D(h) V(wo, wi), and the Beckmann distribution with its sampler."""

from dataclasses import dataclass
from math import pi
from typing import ClassVar, NamedTuple

import torch

from glossbench.brdf.lobe import Lobe, Sample, Sampler
from glossbench.channels import Channels, widen
from glossbench.directions import Vec3, dot, half_vector, normalize, reflect
from glossbench.shapes import Directions, PairValues, Scalar, UnitSquare, Values


@dataclass(frozen=True)
class Microfacet(Lobe):
    """f = ks F(c) D(h) V(wo, wi), F by Schlick 1994.

    Attributes:
        f0: reflectance at normal incidence per channel.
    """

    f0: tuple[Scalar, ...]

    def V(self, wo: Directions, wi: Directions, h: Directions, c: Values) -> Values:
        """f / (ks F D): shadowing and the change of measure."""
        raise NotImplementedError

    def pdf_over_D(self, wo: Directions, h: Directions, c: Values) -> Values:
        """Density [1/sr] of `sample` at the reflection of wo at h, divided by D(h)."""
        raise NotImplementedError

    def F(self, c: PairValues) -> tuple[PairValues, ...]:
        """ks (f0 + (1 - f0) (1 - c)^5), the lobe's factor included."""
        m = 1 - c
        m2 = m * m
        schlick = m2 * m2 * m
        n = max(len(self.f0), len(self.ks))
        pairs = zip(widen(self.f0, n), widen(self.ks, n), strict=True)
        return tuple(ks * (f0 + (1 - f0) * schlick) for f0, ks in pairs)

    def f_and_pdf(self, wo: Directions, wi: Directions) -> tuple[tuple[PairValues, ...], PairValues]:
        """`f` and `pdf`, which share the half vector and D."""
        h = half_vector(wo, wi)
        c = dot(wo, h)
        D = self.D(h)
        # Below the surface D and V may overflow: the mask comes last, because `where` also removes NaN.
        above = (wo.z > 0) & (wi.z > 0)
        value = torch.where(above, D * self.V(wo, wi, h, c), 0.0)
        pdf = torch.where(above, D * self.pdf_over_D(wo, h, c), 0.0)
        return tuple(F * value for F in self.F(c)), pdf

    def f_over_D(self, wo: Directions, wi: Directions, h: Directions, c: Values) -> Channels:
        """ks F V"""
        value = self.V(wo, wi, h, c)
        return tuple(F * value for F in self.F(c))


class HalfVectors(NamedTuple):
    """Half vectors (1, N) and a quarter of their density, D(h) cos_h / 4 (1, N)."""

    h: Directions
    quarter_pdf: Values


@dataclass(frozen=True)
class Beckmann(Microfacet):
    """D(h) = q / (pi m_x m_y cos_h^4), q = exp(-tan^2(theta_h) (cos^2(phi_h) / m_x^2 + sin^2(phi_h) / m_y^2)).

    Half vectors are sampled with density D cos_h, so the density of wi is D cos_h / (4 c).

    Source: Beckmann and Spizzichino 1963; anisotropic as in Kurt et al. 2010; Luksch et al. 2014 eq. 4 to 7 and 10.
    """

    samplers: ClassVar[tuple[Sampler, ...]] = ("own", "normals")

    def sample_points(self, u: UnitSquare) -> HalfVectors:
        """Half vectors with density D cos_h.

        With r = sqrt(-log u1) the slopes are h_x / h_z = m_x r cos(2 pi u2) and h_y / h_z = m_y r sin(2 pi u2):
        eq. 6 and 7 without their arctangents, in all four quadrants.
        """
        r, psi = torch.sqrt(-torch.log(u[:, 0])), 2 * pi * u[:, 1]
        x, y = self.widths[0] * r * torch.cos(psi), self.widths[1] * r * torch.sin(psi)
        h = normalize(Vec3(x[None], y[None], torch.ones_like(x)[None]))
        return HalfVectors(h, self.D(h) * h.z / 4)

    def sample(self, wo: Directions, points: HalfVectors) -> Sample:
        """Mirror directions at the half vectors. D cancels: f cos_i / pdf = ks F V 4 c cos_i / cos_h."""
        h = points.h
        c = dot(wo, h)
        wi = reflect(wo, h)
        visible = (wi.z > 0) & (c > 0)
        c = c.clamp(min=1e-4)
        weight = torch.where(visible, self.V(wo, wi, h, c) * 4 * c * wi.z / h.z, 0.0)
        return Sample(wi, points.quarter_pdf / c, tuple(F * weight for F in self.F(c)))

    def pdf_over_D(self, wo: Directions, h: Directions, c: Values) -> Values:
        """cos_h / (4 c): eq. 10 divided by eq. 4."""
        return h.z / (4 * c)
