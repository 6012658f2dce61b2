"""Lobes that are round about a direction R: what a cube of prefiltered light holds instead of a BRDF.

Letters: c = l . R, and away = 1 - c, which keeps its digits where c is near 1; h is halfway between R and l, so that
c_h^2 = 1 - away / 2. A lobe is the value of a BRDF times cosine for n = wo = R, up to a factor.
"""

from dataclasses import dataclass
from math import pi
from typing import Literal

import torch
from torch import Tensor

from glossbench.shapes import PairValues, Scalar

Weight = Literal["one", "cos", "g2", "cos_g"]
RoundShape = Literal["ggx", "cosine_power", "sg"]


@dataclass(frozen=True)
class RoundLobe:
    """shape(l) weight(l), zero below the horizon of R.

    Attributes:
        alpha: width, the alpha of GGX of the same width at its peak.
        weight: one, cos (c), g2 (GGX shadowing of l as seen from R), or cos_g (c times the G1 of Schlick, k = alpha/2).
        reach: largest `away` at which the lobe is not cut off; None if it ends at the horizon.
    """

    alpha: Scalar
    weight: Weight = "one"
    reach: Scalar | None = None

    def shape(self, away: PairValues) -> PairValues:
        """The lobe without its weight, at most about 1."""
        raise NotImplementedError

    def sample(self, u: Tensor) -> tuple[Tensor, Tensor]:
        """away and its density [1/sr], from u in (0, 1); large u are far from R. Samples may lie below the horizon."""
        raise NotImplementedError

    def value(self, away: PairValues) -> PairValues:
        """shape times weight, zero below the horizon.

        g2 = 2 c / (c + sqrt(alpha^2 + (1 - alpha^2) c^2)): Heitz 2014 eq. 99 for Lambda(wo) = 0. With it the lobe of
        GGX is its BRDF times cosine for n = wo = R and F = 1.
        """
        c, value = (1 - away).clamp(min=0), self.shape(away)
        if self.weight == "one":
            value = torch.where(away < 1, value, 0.0)
        elif self.weight == "g2":
            alpha2 = self.alpha * self.alpha
            value = value * 2 * c / (c + torch.sqrt(alpha2 + (1 - alpha2) * c * c))
        elif self.weight == "cos_g":
            value = value * c * c / (c * (1 - self.alpha / 2) + self.alpha / 2)
        else:
            value = value * c
        return value if self.reach is None else torch.where(away <= self.reach, value, 0.0)


@dataclass(frozen=True)
class RoundGGX(RoundLobe):
    """D(h) / D(R) = (alpha^2 / (alpha^2 c_h^2 + 1 - c_h^2))^2.

    Source: D, Walter et al. 2007 eq. 33; its samples, eq. 35.
    """

    def shape(self, away: PairValues) -> PairValues:
        alpha2 = self.alpha * self.alpha
        ratio = alpha2 / (alpha2 + (1 - alpha2) * (away / 2))
        return ratio * ratio

    def sample(self, u: Tensor) -> tuple[Tensor, Tensor]:
        """c_h^2 = (1 - u) / (1 + (alpha^2 - 1) u); the density of l is D / 4, as R . h = c_h."""
        alpha2 = self.alpha * self.alpha
        away = 2 * alpha2 * u / (1 - (1 - alpha2) * u)
        return away, self.shape(away) / (4 * pi * alpha2)


@dataclass(frozen=True)
class RoundCosine(RoundLobe):
    """c^p, p = (1 / alpha^2 - 1) / 2: near R the Phong lobe of the same width, a quarter of 2 / alpha^2 - 2.

    Source: the exponent of half vectors, Walter et al. 2007 section 5.2; a quarter of it, Fisher and Woo 1994.
    """

    @property
    def p(self) -> Tensor:
        """The exponent."""
        return (1 / (self.alpha * self.alpha) - 1) / 2

    def shape(self, away: PairValues) -> PairValues:
        return torch.exp(self.p * torch.log1p(-away.clamp(max=1 - 2.0**-24)))

    def sample(self, u: Tensor) -> tuple[Tensor, Tensor]:
        """c = (1 - u)^(1 / (p + 1)), with density (p + 1) / (2 pi) c^p."""
        away = -torch.expm1(torch.log1p(-u) / (self.p + 1))
        return away, self.shape(away) * (self.p + 1) / (2 * pi)


@dataclass(frozen=True)
class RoundGaussian(RoundLobe):
    """exp(2 (c_h - 1) / alpha^2): a spherical Gaussian of half vectors.

    Source: Wang et al. 2009, eq. 15, the spherical Gaussian of a microfacet density.
    """

    def shape(self, away: PairValues) -> PairValues:
        c_h = torch.sqrt((1 - away / 2).clamp(min=0))
        return torch.exp(-away / ((1 + c_h) * self.alpha * self.alpha))

    def sample(self, u: Tensor) -> tuple[Tensor, Tensor]:
        """1 - c_h is exponential with mean alpha^2 / 2, cut off at 1; dw_l = 4 c_h dw_h."""
        half = self.alpha * self.alpha / 2
        whole = -torch.expm1(-1 / half)
        fall = (-half * torch.log1p(-u * whole)).clamp(max=1 - 1e-6)
        pdf_h = torch.exp(-fall / half) / (2 * pi * half * whole)
        return 2 * fall * (2 - fall), pdf_h / (4 * (1 - fall))


ROUND_LOBES: dict[RoundShape, type[RoundLobe]] = {"ggx": RoundGGX, "cosine_power": RoundCosine, "sg": RoundGaussian}
