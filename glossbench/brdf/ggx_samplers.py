"""Ways to draw half vectors of GGX: by its normals, by its visible normals, and by caps of a sphere.

Letters as in the module lobe; a_x, a_y are the widths; v' = (a_x wo_x, a_y wo_y, wo_z), its length |v'|; all samplers
use u1 for the angle from the middle of the lobe, and u2 for the azimuth. The density of wi, the reflection of wo at h,
is D(h) masking / (4 cos_o) [1/sr], where `masking` is G1(wo) for samples of visible normals.
"""

from dataclasses import dataclass
from math import pi
from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from glossbench.directions import Vec3, normalize
from glossbench.shapes import Directions, PairDirections, PairValues, Scalar, UnitSquare, Values

Widths = tuple[Scalar, Scalar]
GRAZING = 1e-6  # the smallest cosine: with it densities are positive and finite


class AzimuthPoints(NamedTuple):
    """Points (1, N): the cosine and sine of the azimuth, and a number from which the sampler computes the angle."""

    cos: Tensor
    sin: Tensor
    u: Tensor


def _azimuth_points(u: UnitSquare) -> AzimuthPoints:
    psi = 2 * pi * u[:, 1]
    return AzimuthPoints(torch.cos(psi)[None], torch.sin(psi)[None], u[:, 0][None])


class GGXSampler(Protocol):
    """Draws half vectors of GGX."""

    def points(self, u: UnitSquare) -> AzimuthPoints:
        """The part of a sample that depends only on u."""
        ...

    def half_vectors(self, widths: Widths, wo: Directions, points: AzimuthPoints) -> Directions:
        """Half vectors for these points."""
        ...

    def masking(self, widths: Widths, wo: Directions, h: Directions, c: Values) -> Values:
        """4 cos_o pdf / D(h)"""
        ...


@dataclass(frozen=True)
class Normals:
    """Half vectors with density D cos_h, whatever the view; some of them are not visible.

    With r^2 = u1 / (1 - u1) the slopes are a_x r cos(2 pi u2) and a_y r sin(2 pi u2).

    Source: Walter et al. 2007 eq. 35; with two widths, Burley 2012.
    """

    def points(self, u: UnitSquare) -> AzimuthPoints:
        """The angle's number is r."""
        points = _azimuth_points(u)
        return points._replace(u=torch.sqrt(points.u / (1 - points.u)))

    def half_vectors(self, widths: Widths, wo: Directions, points: AzimuthPoints) -> Directions:
        """normalize(slope_x, slope_y, 1)"""
        x, y = widths[0] * points.u * points.cos, widths[1] * points.u * points.sin
        return normalize(Vec3(x, y, torch.ones_like(x)))

    def masking(self, widths: Widths, wo: Directions, h: Directions, c: Values) -> Values:
        """cos_h cos_o / c: the density is D cos_h / (4 c)."""
        return h.z * wo.z.clamp(min=GRAZING) / c.clamp(min=1e-4)


@dataclass(frozen=True)
class VisibleNormals:
    """Half vectors with density D G1(wo) c / cos_o, from a disk whose lower half is compressed to what wo sees.

    Source: Heitz 2018 (JCGT 7(4)) listing 1.
    """

    def points(self, u: UnitSquare) -> AzimuthPoints:
        """The angle's number is the radius on the disk."""
        points = _azimuth_points(u)
        return points._replace(u=torch.sqrt(points.u))

    def half_vectors(self, widths: Widths, wo: Directions, points: AzimuthPoints) -> Directions:
        """A point of the hemisphere about v', which projects to the disk, stretched back."""
        v = _stretch(widths, wo)
        # A frame about v; at v = z every tangent is valid.
        length2 = v.x * v.x + v.y * v.y
        inverse = torch.rsqrt(length2.clamp(min=1e-20))
        at_pole = length2 < 1e-14
        t1x = torch.where(at_pole, 1.0, -v.y * inverse)
        t1y = torch.where(at_pole, 0.0, v.x * inverse)
        t2 = Vec3(-v.z * t1y, v.z * t1x, v.x * t1y - v.y * t1x)
        s = (1 + v.z) / 2
        x = points.u * points.cos
        y = (1 - s) * torch.sqrt((1 - x * x).clamp(min=0)) + s * (points.u * points.sin)
        z = torch.sqrt((1 - x * x - y * y).clamp(min=0))
        n = Vec3(x * t1x + y * t2.x + z * v.x, x * t1y + y * t2.y + z * v.y, y * t2.z + z * v.z)
        return _unstretch(widths, n)

    def masking(self, widths: Widths, wo: Directions, h: Directions, c: Values) -> Values:
        """G1(wo) = 2 cos_o / (cos_o + |v'|)"""
        return _cap_masking(widths, wo, torch.ones_like(wo.z))


@dataclass(frozen=True)
class SphericalCaps:
    """Half vectors of the density of VisibleNormals: h' = v' / |v'| + a point of the cap z >= -v'_z / |v'|.

    The cap is sampled evenly, and the map from the square is another, so that it keeps strata in another way.

    Source: Dupuy and Benyoub 2023, listing 3. Differs: u1 and u2 are exchanged.
    """

    def points(self, u: UnitSquare) -> AzimuthPoints:
        """The angle's number is u1."""
        return _azimuth_points(u)

    def half_vectors(self, widths: Widths, wo: Directions, points: AzimuthPoints) -> Directions:
        """From the whole cap."""
        return _cap_half_vectors(widths, wo, points, torch.ones_like(wo.z))

    def masking(self, widths: Widths, wo: Directions, h: Directions, c: Values) -> Values:
        """G1(wo) = 2 cos_o / (cos_o + |v'|)"""
        return _cap_masking(widths, wo, torch.ones_like(wo.z))


@dataclass(frozen=True)
class BoundedCaps:
    """SphericalCaps on a smaller cap, z >= -k v'_z / |v'|, without most half vectors that reflect below the surface.

    k = (1 - a^2) s^2 / (s^2 + a^2 wo_z^2), a = min(1, a_x, a_y), s = 1 + |wo_xy|; pdf = D / (2 (k cos_o + |v'|)).

    Source: Eto and Tokuyoshi 2023, listing 1. Differs: u1 and u2 are exchanged.
    """

    def points(self, u: UnitSquare) -> AzimuthPoints:
        """The angle's number is u1."""
        return _azimuth_points(u)

    def half_vectors(self, widths: Widths, wo: Directions, points: AzimuthPoints) -> Directions:
        """From the smaller cap."""
        return _cap_half_vectors(widths, wo, points, self._bound(widths, wo))

    def masking(self, widths: Widths, wo: Directions, h: Directions, c: Values) -> Values:
        """2 cos_o / (k cos_o + |v'|)"""
        return _cap_masking(widths, wo, self._bound(widths, wo))

    def _bound(self, widths: Widths, wo: PairDirections) -> PairValues:
        """k"""
        a2 = torch.minimum(*widths).clamp(max=1) ** 2
        s2 = (1 + torch.sqrt(wo.x * wo.x + wo.y * wo.y)) ** 2
        return (1 - a2) * s2 / (s2 + a2 * wo.z * wo.z)


def _stretch(widths: Widths, wo: PairDirections) -> PairDirections:
    return normalize(Vec3(widths[0] * wo.x, widths[1] * wo.y, wo.z))


def _unstretch(widths: Widths, n: Directions) -> Directions:
    return normalize(Vec3(widths[0] * n.x, widths[1] * n.y, n.z.clamp(min=GRAZING)))


def _cap_half_vectors(widths: Widths, wo: Directions, points: AzimuthPoints, k: Values) -> Directions:
    v = _stretch(widths, wo)
    z = 1 - points.u * (1 + k * v.z)
    sin = torch.sqrt((1 - z * z).clamp(min=0))
    return _unstretch(widths, Vec3(sin * points.cos + v.x, sin * points.sin + v.y, z + v.z))


def _cap_masking(widths: Widths, wo: PairDirections, k: PairValues) -> PairValues:
    x, y, z = widths[0] * wo.x, widths[1] * wo.y, wo.z.clamp(min=GRAZING)
    return 2 * z / (k * z + torch.sqrt(x * x + y * y + z * z))
