"""The model of Cook and Torrance 1982: Beckmann facets that shadow each other as V-shaped grooves do."""

from dataclasses import dataclass
from math import pi
from typing import Literal

import torch
from torch import Tensor

from glossbench.brdf.material import MATERIALS, Material, Reflectance
from glossbench.brdf.microfacet import Beckmann
from glossbench.channels import channels, channels_unless_black, scalar
from glossbench.options import Color, Widths
from glossbench.shapes import Directions, Values


@dataclass(frozen=True)
class Grooves(Beckmann):
    """f = ks F(c) D(h) G factor / (cos_i cos_o), D Beckmann's, G = min(1, 2 cos_h cos_o / c, 2 cos_h cos_i / c).

    Source: G, Torrance and Sparrow 1967, as Cook and Torrance 1982.
    """

    factor: Tensor

    def V(self, wo: Directions, wi: Directions, h: Directions, c: Values) -> Values:
        """factor G / (cos_i cos_o); if G < 1 the smaller cosine cancels."""
        lit = 1 / (wi.z * wo.z).clamp(min=1e-12)
        return self.factor * torch.minimum(lit, 2 * h.z / (c * torch.maximum(wi.z, wo.z)))


@MATERIALS.register("cook_torrance")
class CookTorrance(Material):
    """f(wo, wi) = kd / pi + ks F(c) D(h) G(wo, wi) factor / (cos_i cos_o).

    D(h) = exp(-tan^2(theta_h) (cos^2(phi_h)/m_x^2 + sin^2(phi_h)/m_y^2)) / (pi m_x m_y cos_h^4);
    G = min(1, 2 cos_h cos_o / c, 2 cos_h cos_i / c). Reciprocal. Conserves energy with the factor 1/4.

    Attributes:
        m: Beckmann slopes m_x, m_y along t and b, in (0, 1]; a scalar is isotropic.
        f0: reflectance at normal incidence, a scalar or RGB in [0, 1].
        factor: "1/4", which follows from the integral of D cos_h = 1, or "1/pi", the constant of the paper. As D is
            normalised here, unlike in the paper, "1/pi" gives 4 / pi times the energy of "1/4".
        ks: factor of the lobe, a scalar or RGB in [0, 1].
        kd: diffuse albedo, a scalar or RGB in [0, 1].

    Source: Cook and Torrance 1982; the factor, Walter et al. 2007. Differs: F is by Schlick 1994; two slopes, where the
    paper has one.
    """

    m: Widths = (0.1, 0.1)
    f0: Color = (1.0, 1.0, 1.0)
    factor: Literal["1/4", "1/pi"] = "1/4"
    ks: Color = (1.0, 1.0, 1.0)
    kd: Color = (0.0, 0.0, 0.0)

    def reflectance(self, device: str = "cpu") -> Reflectance:
        """The model as tensors on a device."""
        value = 1 / 4 if self.factor == "1/4" else 1 / pi
        m_x, m_y, factor = (scalar(v, device) for v in (*self.m, value))
        lobe = Grooves((m_x, m_y), channels(self.ks, device), channels(self.f0, device), factor)
        return Reflectance(channels_unless_black(self.kd, device), (lobe,))
