"""A lobe about the direction to the viewer, as of road paint and reflectors."""

from glossbench.brdf.cosine_lobe import Exponent, cosine_lobe
from glossbench.brdf.material import MATERIALS, Material, Reflectance
from glossbench.channels import channels_unless_black
from glossbench.options import Color


@MATERIALS.register("retroreflector")
class Retroreflector(Material):
    """f(wo, wi) = kd / pi + ks (s + 2) / (2 pi) max(wi . wo, 0)^s.

    Attributes:
        s: exponent, in [0, 1e5].
        ks: factor of the lobe, a scalar or RGB in [0, 1].
        kd: diffuse albedo, a scalar or RGB in [0, 1].

    Source: Lafortune et al. 1997, with the lobe about wo.
    """

    s: Exponent = 20.0
    ks: Color = (1.0, 1.0, 1.0)
    kd: Color = (0.0, 0.0, 0.0)

    def reflectance(self, device: str = "cpu") -> Reflectance:
        """The model as tensors on a device."""
        lobe = cosine_lobe((1.0, 1.0, 1.0), self.s, self.ks, device)
        return Reflectance(channels_unless_black(self.kd, device), (lobe,))
