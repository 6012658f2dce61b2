"""A picture of a sky over a sea with a low range of brightness, whose sun and its reflection are raised by hand."""

from math import radians, sin
from typing import Annotated

import torch
from pydantic import Field

from glossbench.directions import stack
from glossbench.envmap.cubemap import CubeMap, texel_directions
from glossbench.envmap.lights.light import LIGHTS, Light
from glossbench.envmap.lights.placing import facing
from glossbench.options import Finite, Resolution

_ZENITH, _HORIZON = (0.15, 0.3, 0.65), (0.75, 0.8, 0.85)
_SUN, _WATER = (1.0, 0.9, 0.7), (0.02, 0.06, 0.08)


@LIGHTS.register("loch")
class Loch(Light):
    """Sky, sea and sun in values of [0, 1], but for the sun's disc and its reflection, which are 10^powers times that.

    Sky: from the zenith's colour to the horizon's as (1 - d_y)^4. Sea: what a mirror reflects of it, by Schlick's law
    with 0.02, over a dark blue. The reflection in the waves is three times as high as the disc, and reflects alike.

    Attributes:
        powers: of ten, by which the sun is raised.
        elevation: of the sun above the horizon, in degrees.
        azimuth: of the sun from forward (-z) to the right (+x), in degrees.
        radius: of the disc, in degrees.
        resolution: texels along the edge of a face, a power of two.

    Source: stands for the rendered environment "Loch" of J. Heath, which is not public, and for what Latta and Kolb
    2002, section 4.1, do to it. Shapes and colours are ours.
    """

    powers: Annotated[float, Field(ge=0, le=6)] = 2.0
    elevation: Annotated[float, Field(ge=0, le=90)] = 25.0
    azimuth: Finite = 135.0
    radius: Annotated[float, Field(gt=0, le=45)] = 3.0
    resolution: Resolution = 64

    def cubemap(self) -> CubeMap:
        """The radiance itself: of each texel the mean of 4 x 4 directions."""
        k = 4
        d = stack(texel_directions(self.resolution, k)).double()
        up = d[..., 1:2].abs()
        sky = torch.lerp(torch.tensor(_ZENITH).double(), torch.tensor(_HORIZON).double(), (1 - up) ** 4)
        sun = facing(self.azimuth, self.elevation)[0]
        # The chord is exact for small angles, where the arccosine is not; of the reflection, a third of its height.
        offset = torch.stack([d[..., 0], d[..., 1].abs(), d[..., 2]], -1) - sun
        below = d[..., 1] < 0
        height = torch.where(below, offset[..., 1] / 3, offset[..., 1])
        chord = torch.sqrt(offset[..., 0] ** 2 + height**2 + offset[..., 2] ** 2)
        disc = (chord < 2 * sin(radians(self.radius) / 2))[..., None]
        seen = torch.where(disc, 10**self.powers * torch.tensor(_SUN).double(), sky)
        fresnel = 0.02 + 0.98 * (1 - up) ** 5
        sea = fresnel * seen + (1 - fresnel) * torch.tensor(_WATER).double()
        radiance = torch.where(below[..., None], sea, seen)
        r = self.resolution
        return CubeMap(radiance.view(6, r, k, r, k, 3).mean((2, 4)).float(), self.key())
