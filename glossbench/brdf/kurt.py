"""The model of Kurt, Szirmay-Kalos and Krivanek 2010: normalised Beckmann lobes with a free shadowing exponent."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from typing import Annotated, Any, NamedTuple

import torch
from pydantic import BeforeValidator, Field
from torch import Tensor

from glossbench.brdf.lobe import Lobe, Sample, channels
from glossbench.brdf.material import MATERIALS, Material, Reflectance
from glossbench.directions import Vec3, dot, normalize, reflect
from glossbench.options import Color, Fraction, Options, Widths


class HalfVectors(NamedTuple):
    """Half vectors (1, N) and their density over 4, D(h) cos_h / 4 (1, N)."""

    h: Vec3
    quarter_pdf: Tensor


@dataclass(frozen=True)
class Beckmann(Lobe):
    """f = ks F(c) D(h) / (4 c (cos_i cos_o)^shadowing), c = wo . h.

    D(h) = q / (pi m_x m_y cos_h^4), q = exp(-tan^2(theta_h) (cos^2(phi_h) / m_x^2 + sin^2(phi_h) / m_y^2)).

    Source: Kurt et al. 2010, as Luksch et al. 2014 eq. 2 to 7 and 10.
    """

    shadowing: Tensor

    def q(self, slope2: Tensor) -> Tensor:
        """exp(-slope2), eq. 5."""
        return torch.exp(-slope2)

    def slope_at(self, q: Tensor) -> Tensor:
        """sqrt(-log q)"""
        return torch.sqrt(-torch.log(q))

    def V(self, wo: Vec3, wi: Vec3, c: Tensor) -> Tensor:
        """1 / (4 c (cos_i cos_o)^shadowing), eq. 2."""
        return self._shadowing(wo, wi) / (4 * c)

    def sample_points(self, u: Tensor) -> HalfVectors:
        """Half vectors with density D cos_h.

        With r = sqrt(-log u1) the slopes are h_x / h_z = m_x r cos(2 pi u2) and h_y / h_z = m_y r sin(2 pi u2):
        eq. 6 and 7 without their arctangents, in all four quadrants.
        """
        r, psi = torch.sqrt(-torch.log(u[:, 0])), 2 * pi * u[:, 1]
        x, y = self.widths[0] * r * torch.cos(psi), self.widths[1] * r * torch.sin(psi)
        h = normalize(Vec3(x[None], y[None], torch.ones_like(x)[None]))
        return HalfVectors(h, self.D(h) * h.z / 4)

    def sample(self, wo: Vec3, points: HalfVectors) -> Sample:
        """Mirror directions at the half vectors.

        D cancels: f cos_i / pdf = F cos_i / (cos_h (cos_i cos_o)^shadowing).
        """
        h = points.h
        c = dot(wo, h)
        wi = reflect(wo, h)
        visible = (wi.z > 0) & (c > 0)
        weight = torch.where(visible, wi.z * self._shadowing(wo, wi) / h.z, 0.0)
        return Sample(wi, points.quarter_pdf / c.clamp(min=1e-4), tuple(F * weight for F in self.F(c)))

    def pdf_over_D(self, wo: Vec3, h: Vec3, c: Tensor) -> Tensor:
        """cos_h / (4 c), eq. 10 over eq. 4."""
        return h.z / (4 * c)

    def _shadowing(self, wo: Vec3, wi: Vec3) -> Tensor:
        # exp2 of log2 runs three times as fast as a power, measured in the fused kernel.
        return torch.exp2(-self.shadowing * torch.log2((wi.z * wo.z).clamp(min=1e-12)))


class KurtLobe(Options):
    """One lobe of several: options as those of Kurt itself."""

    m: Widths = (0.1, 0.1)
    f0: Color = (1.0, 1.0, 1.0)
    shadowing: Fraction = 0.0
    ks: Color = (1.0, 1.0, 1.0)


def _lobes(value: Any) -> Any:
    if isinstance(value, tuple):
        return tuple(KurtLobe.create(v) if isinstance(v, Mapping) else v for v in value)
    return value


KurtLobe.name = "kurt.lobes"


@MATERIALS.register("kurt")
class Kurt(Material):
    """f(wo, wi) = kd / pi + sum over lobes of ks F(c) D(h) / (4 c (cos_i cos_o)^shadowing).

    Conserves energy for shadowing = 0; for larger exponents that depends on m.

    Attributes:
        m: Beckmann slopes m_x, m_y along t and b, in (0, 1]; a scalar is isotropic.
        f0: reflectance at normal incidence r_0, a scalar or RGB in [0, 1].
        shadowing: the paper's exponent alpha, in [0, 1].
        ks: factor of the lobe, a scalar or RGB in [0, 1].
        kd: diffuse albedo, a scalar or RGB in [0, 1].
        lobes: up to 16 lobes, each a mapping of m, f0, shadowing, ks; they replace the four options above.

    Source: Kurt et al. 2010; Luksch et al. 2014 eq. 1 to 5.
    """

    m: Widths = (0.1, 0.1)
    f0: Color = (1.0, 1.0, 1.0)
    shadowing: Fraction = 0.0
    ks: Color = (1.0, 1.0, 1.0)
    kd: Color = (0.0, 0.0, 0.0)
    lobes: Annotated[tuple[KurtLobe, ...], Field(max_length=16), BeforeValidator(_lobes)] = ()

    def reflectance(self, device: str = "cpu") -> Reflectance:
        """The model as tensors on a device."""
        own = KurtLobe(m=self.m, f0=self.f0, shadowing=self.shadowing, ks=self.ks)
        diffuse = channels(self.kd, device) if any(self.kd) else ()
        return Reflectance(diffuse, tuple(_beckmann(lobe, device) for lobe in self.lobes or (own,)))


def _beckmann(lobe: KurtLobe, device: str) -> Beckmann:
    m_x, m_y, shadowing = (torch.tensor(v, dtype=torch.float32, device=device) for v in (*lobe.m, lobe.shadowing))
    return Beckmann((m_x, m_y), channels(lobe.f0, device), channels(lobe.ks, device), shadowing)
