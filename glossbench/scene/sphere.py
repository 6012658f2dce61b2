"""The sphere: every normal of a hemisphere in one image, the test object of the sampling papers."""

from dataclasses import dataclass
from typing import Annotated

import torch
from pydantic import Field
from torch import Tensor

from glossbench.directions import Vec3, cross, normalize
from glossbench.scene.points import VIEWS, ShadingPoints, View


@dataclass(frozen=True)
class UnitSphere:
    """A convex scene: no point hides the light of another."""


@VIEWS.register("sphere")
class Sphere(View):
    """A unit sphere that fills a square image, seen along -z by an orthographic camera.

    The pixel at (x, y) in [-1, 1]^2 shows the normal (x, y, sqrt(1 - x^2 - y^2)); wo = (0, 0, 1) everywhere. The
    tangent runs along circles of latitude: t = up x n / |up x n|, b = n x t.

    Attributes:
        resolution: pixels along an edge.
    """

    resolution: Annotated[int, Field(ge=1, le=8192)] = 256

    def _grid(self) -> tuple[Tensor, Tensor]:
        s = (torch.arange(self.resolution, dtype=torch.float64) * 2 + 1) / self.resolution - 1
        return s[None, :].expand(len(s), -1), -s[:, None].expand(-1, len(s))

    def mask(self) -> Tensor:
        """True (H, W) where a pixel's centre lies inside the disc."""
        x, y = self._grid()
        return x * x + y * y < 1

    def points(self) -> ShadingPoints:
        """One shading point for each pixel of the mask."""
        x, y = (c[self.mask()] for c in self._grid())
        n = Vec3(x, y, torch.sqrt(1 - x * x - y * y))
        zero, one = torch.zeros_like(x), torch.ones_like(x)
        # At a pole every tangent is as good as another: x is.
        at_pole = (n.x == 0) & (n.z == 0)
        t = normalize(Vec3(torch.where(at_pole, one, n.z), zero, -n.x))
        frame = (t, cross(n, t), n, Vec3(zero, zero, one))
        return ShadingPoints(*(Vec3(*(c.float() for c in v)) for v in frame))

    def scene(self) -> UnitSphere:
        """The sphere itself, the same at every resolution."""
        return UnitSphere()
