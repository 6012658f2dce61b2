"""The sphere: all normals of a hemisphere in one image, the test object of papers on sampling."""

from dataclasses import dataclass
from typing import Annotated

import torch
from pydantic import Field
from torch import Tensor

from glossbench.directions import Vec3, cross, normalize
from glossbench.scene.points import VIEWS, ShadingPoints, View, check_pixels


@dataclass(frozen=True)
class UnitSphere:
    """A convex scene: its points do not hide light from each other."""


@VIEWS.register("sphere")
class Sphere(View):
    """A unit sphere in the middle of the image, seen along -z by an orthographic camera.

    The pixel at (x, y) radii from the middle shows the normal (x, y, sqrt(1 - x^2 - y^2)); wo = (0, 0, 1) everywhere.
    The tangent is along circles of latitude: t = up x n / |up x n|, b = n x t.

    Attributes:
        resolution: rows of pixels.
        width: columns of pixels; by default as many as rows.
        coverage: share of the pixels that show the sphere, within a few pixels; by default its disc fills the shorter
            edge.
    """

    resolution: Annotated[int, Field(ge=1, le=8192)] = 256
    width: Annotated[int, Field(ge=1, le=8192)] | None = None
    coverage: Annotated[float, Field(gt=0, le=1)] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_pixels(self, self.resolution, self.width or self.resolution)

    def _make_grid(self) -> tuple[Tensor, Tensor]:
        """x to the right and y up of every pixel's centre (H, W), in radii."""
        height, width = self.resolution, self.width or self.resolution
        x = torch.arange(width, dtype=torch.float64) + 0.5 - width / 2
        y = height / 2 - 0.5 - torch.arange(height, dtype=torch.float64)
        radius = min(height, width) / 2
        if self.coverage is not None:
            squares = (x[None, :] ** 2 + y[:, None] ** 2).flatten()
            covered = max(1, round(self.coverage * height * width))
            # A little beyond the last of these pixels, because at the rim itself the view is at right angles to n.
            radius = float(squares.kthvalue(covered).values + 1) ** 0.5
        return (x / radius).expand(height, -1), (y / radius)[:, None].expand(-1, width)

    def mask(self) -> Tensor:
        """Whether each pixel's centre lies inside the disc, (H, W)."""
        x, y = self._make_grid()
        return x * x + y * y < 1

    def points(self) -> ShadingPoints:
        """One shading point for each pixel of the mask."""
        x, y = (c[self.mask()] for c in self._make_grid())
        n = Vec3(x, y, torch.sqrt(1 - x * x - y * y))
        zero, one = torch.zeros_like(x), torch.ones_like(x)
        # At a pole all tangents are equally good: x is used.
        at_pole = (n.x == 0) & (n.z == 0)
        t = normalize(Vec3(torch.where(at_pole, one, n.z), zero, -n.x))
        frame = (t, cross(n, t), n, Vec3(zero, zero, one))
        return ShadingPoints(*(Vec3(*(c.float() for c in v)) for v in frame))

    def scene(self) -> UnitSphere:
        """The sphere itself, the same at every resolution."""
        return UnitSphere()
