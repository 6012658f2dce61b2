"""The modified Phong model of Lafortune and Willems 1994: a normalised cosine lobe about the mirror direction."""

from glossbench.brdf.cosine_lobe import MIRROR, Exponent, cosine_lobe
from glossbench.brdf.lobe import channels
from glossbench.brdf.material import MATERIALS, Material, Reflectance
from glossbench.options import Color


@MATERIALS.register("phong")
class Phong(Material):
    """f(wo, wi) = kd / pi + ks (s + 2) / (2 pi) max(wi . r, 0)^s, r the mirror direction of wo.

    Reciprocal. Conserves energy where kd + ks <= 1: ks is the albedo of the lobe seen along the normal. Towards
    grazing views the albedo falls to ks (s + 2) / (2 pi) B((s + 1) / 2, 3 / 2), about ks / sqrt(2 pi s).

    Attributes:
        s: exponent, in [0, 1e5]; for 0 the lobe is constant on the hemisphere about r.
        ks: factor of the lobe, a scalar or RGB in [0, 1].
        kd: diffuse albedo, a scalar or RGB in [0, 1].

    Source: Lafortune and Willems 1994, "Using the modified Phong reflectance model for physically based rendering".
    """

    s: Exponent = 20.0
    ks: Color = (1.0, 1.0, 1.0)
    kd: Color = (0.0, 0.0, 0.0)

    def reflectance(self, device: str = "cpu") -> Reflectance:
        """The model as tensors on a device."""
        lobe = cosine_lobe(MIRROR, self.s, self.ks, device)
        return Reflectance(channels(self.kd, device) if any(self.kd) else (), (lobe,))
