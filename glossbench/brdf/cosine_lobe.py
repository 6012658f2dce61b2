"""Generalised cosine lobes: a power of the cosine to an axis that a diagonal matrix makes of wo."""

from dataclasses import dataclass
from math import pi, sqrt
from typing import Annotated, NamedTuple

import torch
from jaxtyping import Float
from pydantic import Field

from glossbench.brdf.lobe import Lobe, Sample
from glossbench.channels import channels, scalar
from glossbench.directions import Vec3, dot, half_vector, normalize, reflect
from glossbench.shapes import Directions, PairDirections, PairValues, Scalar, UnitSquare, Values

Exponent = Annotated[float, Field(ge=0, le=1e5)]  # of a cosine
MIRROR = (-1.0, -1.0, 1.0)  # the diagonal that makes the mirror direction of wo


class CosinePoints(NamedTuple):
    """Directions about +z (1, N) with density (s + 1) / (2 pi) cos^s, and that density (1, N)."""

    direction: Directions
    pdf: Values


@dataclass(frozen=True)
class CosineLobe(Lobe):
    """f = ks (s + 2) / (2 pi) max(C_x wo_x wi_x + C_y wo_y wi_y + C_z wo_z wi_z, 0)^s, the largest |C_k| being 1.

    With the axis a = C wo / |C wo| that is ks (s + 2) / (2 pi) |C wo|^s max(wi . a, 0)^s. The albedo is at most ks:
    (wi . a)^s cos_i integrates to at most 2 pi / (s + 2), its value for a = n, and |C wo| <= 1. The density of samples
    is (s + 1) / (2 pi) (wi . a)^s about a; samples below the surface have weight 0.

    Attributes:
        C: diagonal of the matrix.
        s: exponent of the cosine; for 0 the lobe is constant on the hemisphere about a.

    Source: Lafortune et al. 1997 eq. 4 for f; Lafortune and Willems 1994 for the density.
    """

    C: Float[Vec3, ""]
    s: Scalar

    def f_and_pdf(self, wo: Directions, wi: Directions) -> tuple[tuple[PairValues, ...], PairValues]:
        """`f` and `pdf`, which share (wi . a)^s."""
        a = self._axis(wo)
        # 1 - cos is half the squared chord: for a large s, float32 does not resolve cosines near 1.
        chord = Vec3(wi.x - a.x, wi.y - a.y, wi.z - a.z)
        away = dot(chord, chord) / 2
        facing = (wo.z > 0) & (wi.z > 0) & (away < 1)
        power = torch.where(facing, torch.exp(self.s * torch.log1p(-away.clamp(max=1 - 2.0**-24))), 0.0)
        value = (self.s + 2) / (2 * pi) * self._shrinkage(wo) * power
        return tuple(ks * value for ks in self.ks), (self.s + 1) / (2 * pi) * power

    def sample_points(self, u: UnitSquare) -> CosinePoints:
        """cos = u1^(1 / (s + 1)), phi = 2 pi u2."""
        exponent, phi = torch.log(u[:, 0]) / (self.s + 1), 2 * pi * u[:, 1]
        away = -torch.expm1(exponent)  # 1 - cos, with all its digits
        sin = torch.sqrt(away * (2 - away))
        direction = Vec3(*(c[None] for c in (sin * torch.cos(phi), sin * torch.sin(phi), 1 - away)))
        return CosinePoints(direction, ((self.s + 1) / (2 * pi) * torch.exp(self.s * exponent))[None])

    def sample(self, wo: Directions, points: CosinePoints) -> Sample:
        """The points about a. (wi . a)^s cancels: f cos_i / pdf = ks (s + 2) / (s + 1) |C wo|^s cos_i."""
        wi = self.to_surface(wo, points.direction)
        weight = (self.s + 2) / (self.s + 1) * self._shrinkage(wo) * wi.z.clamp(min=0)
        return Sample(wi, points.pdf, tuple(ks * weight for ks in self.ks))

    def viewer(self, wo: PairDirections) -> PairDirections:
        """Along the axis: the lobe has the same shape for every viewer."""
        zero = torch.zeros_like(wo.z)
        return Vec3(zero, zero, zero + 1)

    def to_surface(self, wo: Directions, d: Directions) -> Directions:
        """The frame's z becomes the axis: half a turn about the vector halfway between them."""
        return reflect(d, half_vector(self.viewer(wo), self._axis(wo)))

    def _axis(self, wo: PairDirections) -> PairDirections:
        return normalize(Vec3(self.C.x * wo.x, self.C.y * wo.y, self.C.z * wo.z))

    def _shrinkage(self, wo: PairDirections) -> PairValues:
        """|C wo|^s"""
        # Computed from 1 - |C wo|^2, which is exact for a mirror: a large s would amplify the rounding of |C wo|.
        lost = (1 - self.C.x**2) * wo.x**2 + (1 - self.C.y**2) * wo.y**2 + (1 - self.C.z**2) * wo.z**2
        return torch.exp(self.s / 2 * torch.log1p(-lost.clamp(max=1 - 2.0**-24)))


def cosine_lobe(C: tuple[float, float, float], s: float, ks: tuple[float, ...], device: str) -> CosineLobe:
    """A lobe on a device. The diagonal C is divided by its largest |C_k|.

    The Beckmann slopes are 1 / sqrt(2 s), bounded by 1: half vectors lie at half the angle, and
    cos^s(2 theta_h) ~ exp(-2 s tan^2(theta_h)).
    """
    largest = max(map(abs, C))
    diagonal = Vec3(*(scalar(k / largest, device) for k in C))
    m = scalar(1 / sqrt(max(2 * s, 1.0)), device)
    return CosineLobe((m, m), channels(ks, device), diagonal, scalar(s, device))
