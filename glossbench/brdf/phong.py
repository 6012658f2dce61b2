"""Phong models: a cosine lobe about the mirror direction, modified (Lafortune and Willems 1994) or the original."""

from dataclasses import dataclass

from glossbench.brdf.cosine_lobe import MIRROR, CosineLobe, CosinePoints, Exponent, cosine_lobe
from glossbench.brdf.lobe import Sample
from glossbench.brdf.material import MATERIALS, Material, Reflectance
from glossbench.channels import channels_unless_black
from glossbench.options import Color
from glossbench.shapes import Directions, PairValues


@dataclass(frozen=True)
class UnforeshortenedLobe(CosineLobe):
    """f = ks (s + 1) / (2 pi) cos^s(alpha) / cos_i: f cos_i is a cosine lobe whose integral is ks.

    Towards grazing light f is unbounded; f cos_i is bounded. Not reciprocal. Samples below the surface have weight 0.
    """

    def f_and_pdf(self, wo: Directions, wi: Directions) -> tuple[tuple[PairValues, ...], PairValues]:
        """`f` and `pdf`, which share cos^s."""
        pdf = super().f_and_pdf(wo, wi)[1]
        value = pdf / wi.z.clamp(min=1e-6)
        return tuple(ks * value for ks in self.ks), pdf

    def sample(self, wo: Directions, points: CosinePoints) -> Sample:
        """The points about the mirror direction: f cos_i / pdf = ks."""
        wi, pdf, _ = super().sample(wo, points)
        above = (wi.z > 0).float()
        return Sample(wi, pdf, tuple(ks * above for ks in self.ks))


@MATERIALS.register("phong")
class Phong(Material):
    """f(wo, wi) = kd / pi + ks (s + 2) / (2 pi) max(wi . r, 0)^s, r the mirror direction of wo.

    Reciprocal. Conserves energy if kd + ks <= 1: ks is the albedo of the lobe for a view along the normal. Towards
    grazing views the albedo falls to ks (s + 2) / (2 pi) B((s + 1) / 2, 3 / 2), about ks / sqrt(2 pi s).

    Without foreshortening it is Phong's own model: the glossy part of f cos_i is ks (s + 1) / (2 pi) cos^s(alpha), the
    same lobe for all views. That model is not reciprocal.

    Attributes:
        s: exponent, in [0, 1e5]; for 0 the lobe is constant on the hemisphere about r.
        ks: factor of the lobe, a scalar or RGB in [0, 1].
        kd: diffuse albedo, a scalar or RGB in [0, 1].
        foreshortening: whether the lobe is multiplied by cos_i, as physics asks.

    Source: Lafortune and Willems 1994, "Using the modified Phong reflectance model for physically based rendering";
    without foreshortening Phong 1975, and Knuth et al. 2014 eq. 4.
    """

    s: Exponent = 20.0
    ks: Color = (1.0, 1.0, 1.0)
    kd: Color = (0.0, 0.0, 0.0)
    foreshortening: bool = True

    def reflectance(self, device: str = "cpu") -> Reflectance:
        """The model as tensors on a device."""
        lobe = cosine_lobe(MIRROR, self.s, self.ks, device)
        if not self.foreshortening:
            lobe = UnforeshortenedLobe(**vars(lobe))
        return Reflectance(channels_unless_black(self.kd, device), (lobe,))
