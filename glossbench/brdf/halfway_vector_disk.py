"""The model of Edwards et al. 2006: half vectors as points of a disk; a density with integral 1 conserves energy."""

from dataclasses import dataclass
from math import pi
from typing import Annotated, NamedTuple

import torch
from pydantic import Field
from torch import Tensor

from glossbench.brdf.lobe import Lobe, Sample
from glossbench.brdf.material import MATERIALS, Material, Reflectance
from glossbench.channels import channels, channels_unless_black, scalar
from glossbench.directions import Vec3, dot, half_vector, normalize, reflect
from glossbench.options import Color, Widths
from glossbench.shapes import Directions, PairValues, Scalar, UnitSquare, Values


class LumpPoints(NamedTuple):
    """Points (1, N) of the unit disk and their density there, (exponent + 1) / pi (1 - x^2 - y^2)^exponent."""

    x: Tensor
    y: Tensor
    density: Tensor


@dataclass(frozen=True)
class Lump(Lobe):
    """f = ks lump(d) cos_o^2 / (4 c cos_i cos_h^3), d = cos_o (h_x, h_y) / h_z, lump as defined in `HalfwayVectorDisk`.

    For a view wo, light is above the surface if d is in the unit disk about (wo_x, wo_y); d = 0 is the mirror
    direction, and the centre of the disk reflects light back to the viewer. The area of d is cos_o^2 / cos_h^3 times
    the solid angle of h, which is 1 / (4 c) times the solid angle of wi. If d has the density lump, then wi has the
    density f cos_i / ks.

    Attributes:
        radii: r_x, r_y.
        exponent: exponent of the lump.
        reciprocal: whether f is the smaller of f(wo, wi) and f(wi, wo).
    """

    radii: tuple[Scalar, Scalar]
    exponent: Scalar
    reciprocal: bool

    def f_and_pdf(self, wo: Directions, wi: Directions) -> tuple[tuple[PairValues, ...], PairValues]:
        """`f` and `pdf`; unless the lobe is reciprocal, f = ks pdf / cos_i."""
        h = half_vector(wo, wi)
        c = dot(wo, h)
        above = (wo.z > 0) & (wi.z > 0)
        pdf = torch.where(above, self._density(wo, h, c), 0.0)
        value = pdf / wi.z.clamp(min=1e-6)
        if self.reciprocal:
            back = self._density(wi, h, c) / wo.z.clamp(min=1e-6)
            value = torch.where(above, torch.minimum(value, back), 0.0)
        return tuple(ks * value for ks in self.ks), pdf

    def sample_points(self, u: UnitSquare) -> LumpPoints:
        """1 - r^2 = u1^(1 / (exponent + 1)), at angle 2 pi u2."""
        power = torch.log(u[:, 0]) / (self.exponent + 1)
        r, psi = torch.sqrt(-torch.expm1(power)), 2 * pi * u[:, 1]
        density = torch.exp(self.exponent * power) * (self.exponent + 1) / pi
        return LumpPoints((r * torch.cos(psi))[None], (r * torch.sin(psi))[None], density[None])

    def sample(self, wo: Directions, points: LumpPoints) -> Sample:
        """Mirror directions at the half vectors of the lump; the weight is ks, or less if reciprocal."""
        z = wo.z.clamp(min=1e-6)
        r_x, r_y = self._radii(wo)
        h = normalize(Vec3(r_x * points.x, r_y * points.y, z))
        c = dot(wo, h)
        wi = reflect(wo, h)
        visible = (wo.z > 0) & (wi.z > 0) & (c > 0)
        c = c.clamp(min=1e-6)
        pdf = points.density / (r_x * r_y) * z * z / (4 * c * h.z**3)
        weight = torch.where(visible, 1.0, 0.0)
        if self.reciprocal:
            share = self._density(wi, h, c) * wi.z / (pdf * z)
            weight = torch.where(visible, share.clamp(max=1), 0.0)
        return Sample(wi, pdf, tuple(ks * weight for ks in self.ks))

    def _density(self, wo: Directions, h: Directions, c: Values) -> Values:
        """lump(d) cos_o^2 / (4 c cos_h^3) [1/sr]"""
        r_x, r_y = self._radii(wo)
        z = wo.z.clamp(min=1e-6)
        x, y = z * h.x / (h.z * r_x), z * h.y / (h.z * r_y)
        rest = 1 - x * x - y * y
        lump = torch.exp2(self.exponent * torch.log2(rest.clamp(min=1e-12))) * (self.exponent + 1) / (pi * r_x * r_y)
        return torch.where(rest > 0, lump * z * z / (4 * c * h.z**3), 0.0)

    def _radii(self, wo: Directions) -> tuple[Values, Values]:
        """k r_x and k r_y: k < 1 if the lump would leave the disk."""
        z = wo.z.clamp(min=1e-6)
        # 1 - sin_o in a form that does not lose digits at grazing views.
        room = z * z / (1 + torch.sqrt((1 - z * z).clamp(min=0)))
        k = (room / torch.maximum(*self.radii)).clamp(max=1)
        return self.radii[0] * k, self.radii[1] * k


@MATERIALS.register("halfway_vector_disk")
class HalfwayVectorDisk(Material):
    """f(wo, wi) = kd / pi + ks lump(d) cos_o^2 / (4 c cos_i cos_h^3), d = cos_o (h_x, h_y) / h_z.

    lump(d) = (exponent + 1) / (pi k^2 r_x r_y) (1 - ((d_x / r_x)^2 + (d_y / r_y)^2) / k^2)^exponent, zero outside its
    ellipse; k = min(1, (1 - sin_o) / max(r_x, r_y)) keeps the ellipse where light is above the surface. The albedo is
    ks for every view. The model is not reciprocal. The reciprocal variant has a lower albedo: with exponent 8 and
    radius 0.3 from 0.99 ks along the normal down to 0.84 ks. Towards grazing views the lobe becomes a mirror.

    Regular sampling uses one pattern for all views, with the Beckmann slopes radius / sqrt(exponent + 1) that the lump
    has along the normal. The pattern does not fit the lobe of grazing views.

    Attributes:
        radius: r_x, r_y of the lump along t and b, in (0, 1]; a scalar is isotropic.
        exponent: exponent of the lump, in [0, 10000]; 0 is a uniform disk.
        reciprocal: use the smaller of f(wo, wi) and f(wi, wo).
        ks: factor of the lobe, its albedo, a scalar or RGB in [0, 1].
        kd: diffuse albedo, a scalar or RGB in [0, 1].

    Source: Edwards et al. 2006, as in the Disney BRDF Explorer (edwards06.brdf). The text of the paper was not
    available: k, two radii and the reciprocal variant are reconstructed.
    """

    radius: Widths = (0.3, 0.3)
    exponent: Annotated[float, Field(ge=0, le=1e4)] = 8.0
    reciprocal: bool = False
    ks: Color = (1.0, 1.0, 1.0)
    kd: Color = (0.0, 0.0, 0.0)

    def reflectance(self, device: str = "cpu") -> Reflectance:
        """The model as tensors on a device."""
        r_x, r_y, n = (scalar(v, device) for v in (*self.radius, self.exponent))
        widths = r_x / torch.sqrt(n + 1), r_y / torch.sqrt(n + 1)
        lobe = Lump(widths, channels(self.ks, device), (r_x, r_y), n, self.reciprocal)
        return Reflectance(channels_unless_black(self.kd, device), (lobe,))
