"""Stages that several methods share. Each stage is one object, so one value serves all methods."""

from typing import Any

from torch import Tensor

from glossbench.brdf.material import Material
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.harmonics import irradiance_coefficients
from glossbench.envmap.paraboloid import Paraboloid, build_paraboloid
from glossbench.envmap.pyramid import Pyramid, build_pyramid
from glossbench.prefilter.view_table import ViewTable, tabulate
from glossbench.shading.method import stage
from glossbench.shading.stage_cache import read_option


@stage
def pyramid(self: Any, light: CubeMap) -> Pyramid | Paraboloid:
    """The filtered light, by the method's `mip_filter`: a cube, or a dual paraboloid if its `projection` says so."""
    if read_option(self, "projection", "cube") == "dual_paraboloid":
        return build_paraboloid(light, self.mip_filter)
    return build_pyramid(light, self.mip_filter)


@stage
def irradiance(self: Any, light: CubeMap) -> Tensor:
    """Nine spherical-harmonic coefficients of the irradiance, for the diffuse part."""
    return irradiance_coefficients(light)


@stage
def albedos(self: Any, material: Material) -> tuple[ViewTable, ...]:
    """The directional albedo of each lobe over the direction of the view, RGB."""
    return tuple(tabulate(lobe, lobe.albedo) for lobe in material.as_lobes().lobes)
