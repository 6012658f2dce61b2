"""All directions of a normal with all of a view: the surface on which factors of the lighting function are measured."""

from typing import Annotated

import torch
from pydantic import Field
from torch import Tensor

from glossbench.lighting_function import pair_points, valid_pairs
from glossbench.scene.points import VIEWS, ShadingPoints, View, check_pixels
from glossbench.scene.sphere import UnitSphere


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
