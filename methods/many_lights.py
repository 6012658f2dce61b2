"""Many lights: each region of the light as one directional light."""

from typing import Annotated, Any

from pydantic import Field
from torch import Tensor

from glossbench.prefilter import (
    METHODS,
    Contract,
    CubeMap,
    Material,
    Method,
    Partition,
    Radiance,
    Reflectance,
    ShadingPoints,
    Shadows,
    Vec3,
    Visibility,
    kernel,
    median_cut,
    merge_channels,
    no_shadows,
    over_points,
    shadows,
    stage,
    to_local,
)


@METHODS.register("many_lights")
class ManyLights(Method):
    """Lo ~ sum over regions i of VIS_i f(wo, d_i) cos_i Phi_i: all light of a region, Phi_i, comes from direction d_i.

    It is good for diffuse surfaces; on a glossy surface the lights are visible one by one.

    Attributes:
        regions: number N of regions of the median cut, about N / 6 per face.
        visibility: VIS_i. "shadow_maps": one variance shadow map per region, blurred according to its size. "rays": one
            ray to d_i. "none": VIS_i = 1.
        shadow_resolution: texels along the edge of a shadow map.
        blocker_distance: distance between a blocker and its shadow, in units of the mesh's half-extent; it sets the
            width of the blur. 0 for no blur.
        light_bleeding: a point of a shadow map that sees less than this share of a light is dark.

    Source: Dachsbacher et al. 2014, with which Knuth et al. 2014, section 1, compare their method; lights after Debevec
    2008, shadows after Annen et al. 2008.
    """

    regions: Annotated[int, Field(ge=6, le=4096)] = 64
    visibility: Visibility = "none"
    shadow_resolution: Annotated[int, Field(ge=8, le=4096)] = 256
    blocker_distance: Annotated[float, Field(ge=0, le=4)] = 0.25
    light_bleeding: Annotated[float, Field(ge=0, lt=1)] = 0.0

    # Measured: furnace 0.018, turns 0.003, slope -0.99. It is not linear, because the cuts depend on the light.
    equation = 'L_o approx sum_i "VIS"_i thin f(omega_o, d_i) cos theta_i thin Phi_i'
    contract = Contract(furnace=0.03, linear=False, turns=0.01, budget=("regions", (24, 96, 384, 1536)), slope=-0.8)

    shadows = shadows

    def supports(self, material: Material, scene: Any) -> str | None:
        """The reason why a scene cannot have shadow maps, if it cannot."""
        return no_shadows(self.visibility, scene)

    def n_samples(self, material: Material) -> int:
        """Number of lights."""
        return self.regions

    @stage
    def partition(self, light: CubeMap) -> Partition:
        """The regions."""
        return median_cut(light, self.regions)

    def shade(self, points: ShadingPoints, material: Material, partition: Partition, shadows: Shadows) -> Radiance:
        """Radiance (P, 3)."""
        direction = Vec3(*(c[None] for c in partition.direction))
        reflectance = material.reflectance(points.device)
        return over_points(_kernel, points, self.regions, reflectance, direction, partition.power, shadows)


@kernel("many_lights")
def _kernel(
    points: ShadingPoints, reflectance: Reflectance, direction: Vec3, power: Tensor, shadows: Shadows
) -> Radiance:
    """Sum over lights."""
    wi = to_local(direction, points.t, points.b, points.n)
    weight = wi.z * shadows.visible(points)
    sums = [(channel * weight) @ power for channel in reflectance.f(points.wo_local(), wi)]
    return merge_channels(sums)
