"""A checkerboard on the cube: hard edges everywhere, without aliasing."""

from typing import Annotated

import torch
from pydantic import Field
from torch import Tensor

from glossbench.envmap.cubemap import CubeMap, texel_solid_angles
from glossbench.envmap.lights.light import LIGHTS, Light
from glossbench.options import Radiance, Resolution


@LIGHTS.register("checker")
class Checker(Light):
    """Each face of the cube has cells x cells squares of two radiances; its top left square is bright.

    A texel holds the exact mean over its solid angle, so a texel across an edge is grey. With an even number of cells
    the mean over the sphere is (bright + dark) / 2, with an odd number it is nearer to bright. At some edges of the
    cube squares of equal radiance meet: three squares meet at each corner, but there are only two radiances.

    Attributes:
        cells: squares along the edge of a face; above half the resolution texels contain parts of several squares.
        bright, dark: the two radiances, a scalar or RGB.
        resolution: texels along the edge of a face, a power of two.
    """

    cells: Annotated[int, Field(ge=1, le=1024)] = 8
    bright: Radiance = (1.0, 1.0, 1.0)
    dark: Radiance = (0.0, 0.0, 0.0)
    resolution: Resolution = 256

    def cubemap(self) -> CubeMap:
        """The radiance itself."""
        share = _bright_share(self.resolution, self.cells)[..., None]
        bright, dark = (torch.tensor(c, dtype=torch.float64) for c in (self.bright, self.dark))
        face = (share * bright + (1 - share) * dark).float()
        return CubeMap(face.repeat(6, 1, 1, 1), self.key())


def _bright_share(resolution: int, cells: int) -> Tensor:
    """The bright share of each texel's solid angle, (R, R), float64.

    A face is cut along the edges of both texels and squares; each piece has one radiance and lies in one texel.
    """
    edges = [2 * torch.arange(n + 1, dtype=torch.float64) / n - 1 for n in (resolution, cells)]
    cuts = torch.cat(edges).unique()
    middle = (cuts[1:] + cuts[:-1]) / 2 + 1
    texel, square = ((middle * n / 2).long() for n in (resolution, cells))
    s, t = cuts[None, :], cuts[:, None]
    corner = torch.atan2(s * t, torch.sqrt(s * s + t * t + 1))
    pieces = corner.diff(dim=0).diff(dim=1) * ((square[:, None] + square[None, :]) % 2 == 0)
    rows = torch.zeros(resolution, len(texel), dtype=torch.float64).index_add_(0, texel, pieces)
    bright = torch.zeros(resolution, resolution, dtype=torch.float64).index_add_(1, texel, rows)
    return (bright / texel_solid_angles(resolution)).clamp(0, 1)
