"""An overcast sky without gradation: one radiance above the horizon, nothing below."""

import torch

from glossbench.envmap.cubemap import CubeMap, texel_directions
from glossbench.envmap.lights.light import LIGHTS, Light
from glossbench.options import Radiance, Resolution


@LIGHTS.register("hemisphere")
class Hemisphere(Light):
    """L(d) = radiance where d_y > 0, else 0. A surface that faces up gets the irradiance pi radiance.

    Attributes:
        radiance: a scalar or RGB.
        resolution: texels along the edge of a face, a power of two.
    """

    radiance: Radiance = (1.0, 1.0, 1.0)
    resolution: Resolution = 16

    def cubemap(self) -> CubeMap:
        """The radiance itself."""
        above = (texel_directions(self.resolution).y > 0).float()
        return CubeMap(above[..., None] * torch.tensor(self.radiance), self.key())
