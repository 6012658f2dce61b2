"""A picture of sky and sea with a low dynamic range, in which the sun and its reflection are made brighter by hand."""

from math import radians, sin
from typing import Annotated

import torch
from pydantic import Field

from glossbench.directions import stack
from glossbench.envmap.cubemap import CubeMap, texel_directions
from glossbench.envmap.lights.light import LIGHTS, Light
from glossbench.envmap.lights.placing import build_frame
from glossbench.options import Finite, Resolution

_ZENITH, _HORIZON = (0.15, 0.3, 0.65), (0.75, 0.8, 0.85)
_SUN, _WATER = (1.0, 0.9, 0.7), (0.02, 0.06, 0.08)


@LIGHTS.register("loch")
class Loch(Light):
    """Sky, sea and sun with values in [0, 1]; the disc of the sun and its reflection are multiplied by 10^powers.

    Sky: the colour changes from zenith to horizon as (1 - d_y)^4. Sea: a mirror image of the sky, weighted by Schlick's
    law with 0.02, over a dark blue. The reflection of the sun in the waves has three times the height of the disc and
    the same law.

    Attributes:
        powers: powers of ten by which the sun is made brighter.
        elevation: angle of the sun above the horizon [degrees].
        azimuth: angle of the sun from forward (-z) to the right (+x) [degrees].
        radius: radius of the disc [degrees].
        resolution: texels along the edge of a face, a power of two.

    Source: it replaces the rendered environment "Loch" of J. Heath, which is not public, and its change by Latta and
    Kolb 2002, section 4.1. Shapes and colours are ours.
    """

    powers: Annotated[float, Field(ge=0, le=6)] = 2.0
    elevation: Annotated[float, Field(ge=0, le=90)] = 25.0
    azimuth: Finite = 135.0
    radius: Annotated[float, Field(gt=0, le=45)] = 3.0
    resolution: Resolution = 64

    def cubemap(self) -> CubeMap:
        """The radiance itself; each texel is the mean of 4 x 4 directions."""
        k = 4
        d = stack(texel_directions(self.resolution, k)).double()
        up = d[..., 1:2].abs()
        sky = torch.lerp(torch.tensor(_ZENITH).double(), torch.tensor(_HORIZON).double(), (1 - up) ** 4)
        sun = build_frame(self.azimuth, self.elevation)[0]
        # The chord is exact for small angles, where the arccosine is not. The height of the reflection is divided by 3.
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
