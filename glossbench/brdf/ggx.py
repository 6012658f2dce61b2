"""GGX with height-correlated shadowing, sampled by its visible normals: the lobe of today's engines."""

from dataclasses import dataclass, replace
from typing import ClassVar

import torch

from glossbench.brdf.ggx_samplers import (
    GRAZING,
    AzimuthPoints,
    BoundedCaps,
    GGXSampler,
    Normals,
    SphericalCaps,
    VisibleNormals,
)
from glossbench.brdf.lobe import Sample, Sampler
from glossbench.brdf.material import MATERIALS, Material, Reflectance
from glossbench.brdf.microfacet import Microfacet
from glossbench.channels import channels, channels_unless_black, scalar
from glossbench.directions import dot, reflect
from glossbench.options import Color, Widths
from glossbench.shapes import Directions, PairDirections, PairValues, UnitSquare, Values

SAMPLERS: dict[Sampler, GGXSampler] = {
    "normals": Normals(),
    "visible_normals": VisibleNormals(),
    "spherical_caps": SphericalCaps(),
    "bounded_caps": BoundedCaps(),
}


@dataclass(frozen=True)
class TrowbridgeReitz(Microfacet):
    """f = ks F(c) D(h) G2(wo, wi) / (4 cos_i cos_o).

    D(h) = 1 / (pi a_x a_y cos_h^4 (1 + slope2)^2); G2 = 1 / (1 + L(wo) + L(wi));
    L(v) = (sqrt(1 + (a_x^2 v_x^2 + a_y^2 v_y^2) / v_z^2) - 1) / 2.

    Attributes:
        sampler: how half vectors are drawn.

    Source: D, Walter et al. 2007 eq. 33; G2, Heitz 2014 eq. 99.
    """

    sampler: GGXSampler = SAMPLERS["visible_normals"]
    samplers: ClassVar[tuple[Sampler, ...]] = ("own", *SAMPLERS)

    def q(self, slope2: PairValues) -> PairValues:
        """1 / (1 + slope2)^2"""
        return (1 + slope2) ** -2

    def slope_at(self, q: PairValues) -> PairValues:
        """sqrt(1 / sqrt(q) - 1)"""
        return torch.sqrt(torch.rsqrt(q) - 1)

    def V(self, wo: Directions, wi: Directions, h: Directions, c: Values) -> Values:
        """G2 / (4 cos_i cos_o)"""
        return 1 / ((1 + self._lambda(wo) + self._lambda(wi)) * 4 * wo.z * wi.z)

    def sample_points(self, u: UnitSquare) -> AzimuthPoints:
        """The part of the half vectors that depends only on u."""
        return self.sampler.points(u)

    def sample(self, wo: Directions, points: AzimuthPoints) -> Sample:
        """Mirror directions at the half vectors; f cos_i / pdf = F G2 / masking."""
        h = self.sampler.half_vectors(self.widths, wo, points)
        c = dot(wo, h)
        wi = reflect(wo, h)
        visible = (wi.z > 0) & (c > 0)
        masking = self.sampler.masking(self.widths, wo, h, c)
        g2 = 1 / (1 + self._lambda(wo) + self._lambda(wi))
        weight = torch.where(visible, g2 / masking, 0.0)
        return Sample(wi, self.D(h) * self.pdf_over_D(wo, h, c), tuple(F * weight for F in self.F(c)))

    def pdf_over_D(self, wo: Directions, h: Directions, c: Values) -> Values:
        """masking / (4 cos_o)"""
        return self.sampler.masking(self.widths, wo, h, c) / (4 * wo.z.clamp(min=GRAZING))

    def sampled_by(self, sampler: Sampler) -> "TrowbridgeReitz":
        """This lobe with another sampler."""
        return self if sampler == "own" else replace(self, sampler=SAMPLERS[sampler])

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
