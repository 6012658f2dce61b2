"""Stages that several methods share. Each stage is one object, so one value serves all methods."""

from typing import Any

from torch import Tensor

from glossbench.brdf.material import Material
from glossbench.channels import LUMINANCE
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.harmonics import irradiance_coefficients
from glossbench.envmap.paraboloid import Paraboloid
from glossbench.envmap.pyramid import Pyramid
from glossbench.prefilter.pyramids import build_paraboloid, build_pyramid
from glossbench.prefilter.view_table import ViewTable, tabulate
from glossbench.shading.method import stage
from glossbench.shading.stage_cache import read_option

TINY = 1e-30  # keeps black black


@stage
def pyramid(self: Any, light: CubeMap) -> Pyramid | Paraboloid:
    """The filtered light, by the method's `mip_filter`: a cube, or a dual paraboloid if its `projection` says so.

    A method with an option `clamp` filters a light whose texels are cut at so many times its mean luminance.
    """
    limit = read_option(self, "clamp", None)
    if limit is not None:
        light = _cut(light, limit)
    if read_option(self, "projection", "cube") == "dual_paraboloid":
        return build_paraboloid(light, self.mip_filter)
    return build_pyramid(light, self.mip_filter)


def _cut(light: CubeMap, limit: float) -> CubeMap:
    """The light, whose texels are darkened to a luminance of at most `limit` times its mean; colours stay."""
    luminance = light.faces @ light.faces.new_tensor(LUMINANCE)
    mean = light.mean()
    highest = limit * float(mean @ mean.new_tensor(LUMINANCE))
    return CubeMap(light.faces * (highest / luminance.clamp(min=max(highest, TINY)))[..., None], light.key)


@stage
def irradiance(self: Any, light: CubeMap) -> Tensor:
    """Nine spherical-harmonic coefficients of the irradiance, for the diffuse part."""
    return irradiance_coefficients(light)


@stage
def albedos(self: Any, material: Material) -> tuple[ViewTable, ...]:
    """The directional albedo of each lobe over the direction of the view, RGB."""
    return tuple(tabulate(lobe, lobe.albedo) for lobe in material.as_lobes().lobes)
