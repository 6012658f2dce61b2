"""All pairs of a normal and a view: the surface on which the factors of the lighting function are measured."""

from typing import Annotated

import torch
from pydantic import Field
from torch import Tensor

from glossbench.directions import Vec3, cross, dot, normalize, stack, vec3
from glossbench.envmap.cubemap import texel_directions
from glossbench.scene.points import VIEWS, ShadingPoints, View, check_pixels
from glossbench.scene.sphere import UnitSphere

# A view at right angles to the normal, up to rounding, does not count.
LEAST_COSINE = 1e-6


@VIEWS.register("virtual_cube")
class VirtualCube(View):
    """Every pair of texels of a cube as a normal (row) and a view (column), if their dot product is above 0.

    For every method, errors over its pixels are errors over samples of the lighting function. Rows and columns are in
    the order (face, row, column) of the texels. The tangent follows from the world's +x, see `tangent`.

    Attributes:
        edge: texels along the edge of a face; 16 gives 1,179,360 pairs.
        every: show one pair in this many, in the order of the pixels; a prime number reaches all normals and views.
        ceiling: metrics count larger radiance as this value, in images and reference; 0 means no ceiling.

    Source: the samples of Latta and Kolb 2002, sections 3.3 and 4, and the errors of their table 1, with ceiling 4.
    """

    edge: Annotated[int, Field(ge=2, le=24)] = 16
    every: Annotated[int, Field(ge=1)] = 1
    ceiling: Annotated[float, Field(ge=0)] = 4.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_pixels(self, 6 * self.edge**2, 6 * self.edge**2)

    def _find_pairs(self) -> Tensor:
        return valid_pairs(self.edge)[:: self.every]

    def mask(self) -> Tensor:
        """Whether each pair is shown, (6 edge^2, 6 edge^2)."""
        mask = torch.zeros(6 * self.edge**2, 6 * self.edge**2, dtype=torch.bool)
        mask[tuple(self._find_pairs().T)] = True
        return mask

    def points(self) -> ShadingPoints:
        """One shading point for each pair."""
        return pair_points(self.edge, self._find_pairs())

    def scene(self) -> UnitSphere:
        """A convex scene."""
        return UnitSphere()

    def recorded(self, radiance: Tensor) -> Tensor:
        """Radiance up to the ceiling."""
        return radiance.clamp(max=self.ceiling) if self.ceiling > 0 else radiance


def virtual_directions(edge: int) -> Tensor:
    """Centres of the texels of a cube, (6 V^2, 3), float64, in the order (face, row, column)."""
    return stack(Vec3(*(c.double() for c in texel_directions(edge)))).reshape(-1, 3)


def valid_pairs(edge: int) -> Tensor:
    """Numbers (S, 2) of the texels n, v of a cube with n . v > 0, normal by normal."""
    d = virtual_directions(edge)
    return (d @ d.T > LEAST_COSINE).nonzero()


def tangent(n: Vec3) -> Vec3:
    """t = (x - (x . n) n) / |.|, x the world's +x; if n = +-x all tangents are equally good, and +y is used.

    Source: Latta and Kolb 2002, below eq. 6, whose x is horizontal for the viewer.
    """
    t = Vec3(1 - n.x * n.x, -n.x * n.y, -n.x * n.z)
    singular = dot(t, t) < 1e-12
    return normalize(Vec3(*(torch.where(singular, v, c) for c, v in zip(t, (0.0, 1.0, 0.0), strict=True))))


def pair_points(edge: int, pairs: Tensor) -> ShadingPoints:
    """Shading points with the normals and views of pairs of texels of a cube."""
    d = virtual_directions(edge)
    n, wo = vec3(d[pairs[:, 0]]), vec3(d[pairs[:, 1]])
    t = tangent(n)
    return ShadingPoints(t, cross(n, t), n, wo).map(lambda c: c.float().contiguous())
