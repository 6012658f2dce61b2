"""The model of Kurt, Szirmay-Kalos and Krivanek 2010: normalised Beckmann lobes with a free shadowing exponent."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import torch
from pydantic import BeforeValidator, Field
from torch import Tensor

from glossbench.brdf.material import MATERIALS, MAX_LOBES, Material, Reflectance
from glossbench.brdf.microfacet import Beckmann
from glossbench.channels import channels, channels_unless_black, scalar
from glossbench.options import Color, Fraction, Options, Widths
from glossbench.shapes import Directions, Values


@dataclass(frozen=True)
class FreeShadowing(Beckmann):
    """f = ks F(c) D(h) / (4 c (cos_i cos_o)^shadowing), c = wo . h, D Beckmann's.

    Source: Kurt et al. 2010, as in Luksch et al. 2014 eq. 2 to 5.
    """

    shadowing: Tensor

    def V(self, wo: Directions, wi: Directions, h: Directions, c: Values) -> Values:
        """1 / (4 c (cos_i cos_o)^shadowing), eq. 2."""
        # exp2 of log2 is three times as fast as a power, measured in the fused kernel.
        return torch.exp2(-self.shadowing * torch.log2((wi.z * wo.z).clamp(min=1e-12))) / (4 * c)


class KurtLobe(Options):
    """One of several lobes, with the options of Kurt itself."""

    m: Widths = (0.1, 0.1)
    f0: Color = (1.0, 1.0, 1.0)
    shadowing: Fraction = 0.0
    ks: Color = (1.0, 1.0, 1.0)


def _read_lobes(value: Any) -> Any:
    if isinstance(value, tuple):
        return tuple(KurtLobe.create(v) if isinstance(v, Mapping) else v for v in value)
    return value


KurtLobe.name = "kurt.lobes"


@MATERIALS.register("kurt")
class Kurt(Material):
    """f(wo, wi) = kd / pi + sum over lobes of ks F(c) D(h) / (4 c (cos_i cos_o)^shadowing).

    For shadowing = 0 it conserves energy; for larger exponents this depends on m.

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
    lobes: Annotated[tuple[KurtLobe, ...], Field(max_length=MAX_LOBES), BeforeValidator(_read_lobes)] = ()

    def reflectance(self, device: str = "cpu") -> Reflectance:
        """The model as tensors on a device."""
        own = KurtLobe(m=self.m, f0=self.f0, shadowing=self.shadowing, ks=self.ks)
        diffuse = channels_unless_black(self.kd, device)
        return Reflectance(diffuse, tuple(_build_lobe(lobe, device) for lobe in self.lobes or (own,)))


def _build_lobe(lobe: KurtLobe, device: str) -> FreeShadowing:
    m_x, m_y, shadowing = (scalar(v, device) for v in (*lobe.m, lobe.shadowing))
    return FreeShadowing((m_x, m_y), channels(lobe.ks, device), channels(lobe.f0, device), shadowing)
