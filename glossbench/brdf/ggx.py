"""GGX with height-correlated shadowing, sampled by its visible normals: the lobe of today's engines."""

from dataclasses import dataclass
from math import pi
from typing import NamedTuple

import torch
from torch import Tensor

from glossbench.brdf.lobe import Sample
from glossbench.brdf.material import MATERIALS, Material, Reflectance
from glossbench.brdf.microfacet import Microfacet
from glossbench.channels import channels, channels_unless_black, scalar
from glossbench.directions import Vec3, dot, normalize, reflect
from glossbench.options import Color, Widths
from glossbench.shapes import Directions, PairDirections, PairValues, UnitSquare, Values


class DiskPoints(NamedTuple):
    """Points (1, N) of the unit disk: x, and y before it is compressed to the visible half."""

    x: Tensor
    y: Tensor


@dataclass(frozen=True)
class TrowbridgeReitz(Microfacet):
    """f = ks F(c) D(h) G2(wo, wi) / (4 cos_i cos_o).

    D(h) = 1 / (pi a_x a_y cos_h^4 (1 + slope2)^2); G2 = 1 / (1 + L(wo) + L(wi));
    L(v) = (sqrt(1 + (a_x^2 v_x^2 + a_y^2 v_y^2) / v_z^2) - 1) / 2.

    Source: D, Walter et al. 2007 eq. 33; G2, Heitz 2014 eq. 99; sampling, Heitz 2018 (JCGT 7(4)) listing 1.
    """

    def q(self, slope2: PairValues) -> PairValues:
        """1 / (1 + slope2)^2"""
        return (1 + slope2) ** -2

    def slope_at(self, q: PairValues) -> PairValues:
        """sqrt(1 / sqrt(q) - 1)"""
        return torch.sqrt(torch.rsqrt(q) - 1)

    def V(self, wo: Directions, wi: Directions, h: Directions, c: Values) -> Values:
        """G2 / (4 cos_i cos_o)"""
        return 1 / ((1 + self._lambda(wo) + self._lambda(wi)) * 4 * wo.z * wi.z)

    def sample_points(self, u: UnitSquare) -> DiskPoints:
        """Uniform points of the disk."""
        r, psi = torch.sqrt(u[:, 0]), 2 * pi * u[:, 1]
        return DiskPoints((r * torch.cos(psi))[None], (r * torch.sin(psi))[None])

    def sample(self, wo: Directions, points: DiskPoints) -> Sample:
        """Mirror directions at visible normals; f cos_i / pdf = F G2 / G1(wo)."""
        a_x, a_y = self.widths
        v = normalize(Vec3(a_x * wo.x, a_y * wo.y, wo.z))
        # A frame about v; at v = z every tangent is valid.
        length2 = v.x * v.x + v.y * v.y
        inverse = torch.rsqrt(length2.clamp(min=1e-20))
        at_pole = length2 < 1e-14
        t1x = torch.where(at_pole, 1.0, -v.y * inverse)
        t1y = torch.where(at_pole, 0.0, v.x * inverse)
        t2 = Vec3(-v.z * t1y, v.z * t1x, v.x * t1y - v.y * t1x)
        s = (1 + v.z) / 2
        y = (1 - s) * torch.sqrt((1 - points.x * points.x).clamp(min=0)) + s * points.y
        z = torch.sqrt((1 - points.x * points.x - y * y).clamp(min=0))
        n = Vec3(points.x * t1x + y * t2.x + z * v.x, points.x * t1y + y * t2.y + z * v.y, y * t2.z + z * v.z)
        h = normalize(Vec3(a_x * n.x, a_y * n.y, n.z.clamp(min=1e-6)))
        c = dot(wo, h)
        wi = reflect(wo, h)
        visible = (wi.z > 0) & (c > 0)
        g1 = 1 + self._lambda(wo)
        weight = torch.where(visible, g1 / (g1 + self._lambda(wi)), 0.0)
        return Sample(wi, self.D(h) * self.pdf_over_D(wo, h, c), tuple(F * weight for F in self.F(c)))

    def pdf_over_D(self, wo: Directions, h: Directions, c: Values) -> Values:
        """G1(wo) / (4 cos_o): the density of visible normals, D G1 c / cos_o, over 4 c."""
        return 1 / ((1 + self._lambda(wo)) * 4 * wo.z.clamp(min=1e-6))

    def _lambda(self, v: PairDirections) -> PairValues:
        x, y = self.widths[0] * v.x, self.widths[1] * v.y
        return (torch.sqrt(1 + (x * x + y * y) / (v.z * v.z).clamp(min=1e-12)) - 1) / 2


@MATERIALS.register("ggx")
class GGX(Material):
    """f(wo, wi) = kd / pi + ks F(c) D(h) G2(wo, wi) / (4 cos_i cos_o).

    Attributes:
        alpha: widths of D along t and b, in (0, 1]; it is the square of `roughness` in material files; a scalar is
            isotropic.
        f0: reflectance at normal incidence, a scalar or RGB in [0, 1].
        ks: factor of the lobe, a scalar or RGB in [0, 1].
        kd: diffuse albedo, a scalar or RGB in [0, 1].

    Source: Walter et al. 2007; Heitz 2014; Schlick 1994.
    """

    alpha: Widths = (0.1, 0.1)
    f0: Color = (1.0, 1.0, 1.0)
    ks: Color = (1.0, 1.0, 1.0)
    kd: Color = (0.0, 0.0, 0.0)

    def reflectance(self, device: str = "cpu") -> Reflectance:
        """The model as tensors on a device."""
        a_x, a_y = (scalar(a, device) for a in self.alpha)
        lobe = TrowbridgeReitz((a_x, a_y), channels(self.ks, device), channels(self.f0, device))
        return Reflectance(channels_unless_black(self.kd, device), (lobe,))
