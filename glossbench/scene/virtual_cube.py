"""All directions of a normal with all of a view: the surface on which factors of the lighting function are measured."""

from typing import Annotated

import torch
from pydantic import Field
from torch import Tensor

from glossbench.directions import Vec3, cross, dot, normalize, stack, vec3
from glossbench.envmap.cubemap import texel_directions
from glossbench.scene.points import VIEWS, ShadingPoints, View, check_pixels
from glossbench.scene.sphere import UnitSphere

# A view at right angles to the normal, up to rounding, is none.
LEAST_COSINE = 1e-6


@VIEWS.register("virtual_cube")
class VirtualCube(View):
    """Every pair of texels of a cube as a normal and a view: row a normal, column a view, nothing where n . v <= 0.

    So errors over its pixels are errors over samples of the lighting function, whatever the method. Rows and columns
    are in the order (face, row, column) of the texels. The tangent is that of the world's +x, see `tangent`.

    Attributes:
        edge: texels along the edge of a face; of 16 there are 1,179,360 pairs.
        every: shows one pair in so many, in the order of the pixels; a prime number meets all normals and views.
        ceiling: radiance above counts as this in metrics, in images and reference alike; 0 for no ceiling.

    Source: the samples of Latta and Kolb 2002, sections 3.3 and 4, and the errors of their table 1; ceiling 4 there.
    """

    edge: Annotated[int, Field(ge=2, le=24)] = 16
    every: Annotated[int, Field(ge=1)] = 1
    ceiling: Annotated[float, Field(ge=0)] = 4.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_pixels(self, 6 * self.edge**2, 6 * self.edge**2)

    def _pairs(self) -> Tensor:
        return valid_pairs(self.edge)[:: self.every]

    def mask(self) -> Tensor:
        """True (6 edge^2, 6 edge^2) for the pairs that are shown."""
        mask = torch.zeros(6 * self.edge**2, 6 * self.edge**2, dtype=torch.bool)
        mask[tuple(self._pairs().T)] = True
        return mask

    def points(self) -> ShadingPoints:
        """One shading point for each pair."""
        return pair_points(self.edge, self._pairs())

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
    """t = (x - (x . n) n) / |.|, x the world's +x; where n = +-x every tangent is as good as another, and +y is taken.

    Source: Latta and Kolb 2002, below eq. 6, where x is horizontal for the viewer.
    """
    t = Vec3(1 - n.x * n.x, -n.x * n.y, -n.x * n.z)
    singular = dot(t, t) < 1e-12
    return normalize(Vec3(*(torch.where(singular, v, c) for c, v in zip(t, (0.0, 1.0, 0.0), strict=True))))


def pair_points(edge: int, pairs: Tensor) -> ShadingPoints:
    """Shading points with the normals and views of pairs of texels of a cube."""
    d = virtual_directions(edge)
    n, wo = vec3(d[pairs[:, 0]]), vec3(d[pairs[:, 1]])
    t = tangent(n)
    return ShadingPoints(t, cross(n, t), n, wo).each(lambda c: c.float().contiguous())
