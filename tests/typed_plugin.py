"""A plug-in as its author writes it, checked strictly by `make check`: types reach it through the façade.

Each line of `faults` has a mistake. If mypy no longer sees one, the comment that names it is unused, which is an error.
"""

from typing import Annotated

import torch
from pydantic import Field

from glossbench.prefilter import METHODS, CubeMap, Material, Method, Radiance, ShadingPoints, stage


@METHODS.register("flat_light")
class FlatLight(Method):
    """The mean of the light times a gain."""

    gain: Annotated[float, Field(ge=0)] = 1.0

    @stage
    def mean(self, light: CubeMap) -> torch.Tensor:
        """The mean."""
        return light.mean().float() * self.gain

    def shade(self, points: ShadingPoints, material: Material, mean: torch.Tensor) -> Radiance:
        """The same for each point."""
        return mean.expand(len(points), 3).clone()


def faults() -> None:
    """Mistakes."""
    FlatLight(gain="much")  # type: ignore[arg-type]
    FlatLight.mean.function(FlatLight(), 1) + "text"  # type: ignore[operator]
    print(Material().no_such_name)  # type: ignore[attr-defined]
