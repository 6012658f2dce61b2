"""Ambient occlusion: the radiance of an open scene, darkened by the same factor in all directions."""

from typing import Annotated, Any, Literal

from pydantic import Field
from torch import Tensor

from glossbench.prefilter import (
    LUMINANCE,
    METHODS,
    Contract,
    CubeMap,
    Energy,
    LobeFilter,
    LobeLevels,
    LobeSum,
    Material,
    Method,
    NoShadows,
    PartialMaps,
    Radiance,
    Seed,
    ShadingPoints,
    View,
    Volume,
    build_partial_maps,
    calibrate,
    cube_bytes,
    lobe_radiance,
    lobe_sums,
    make_whole,
    n_lookups,
    no_lobe_sums,
    stage,
)

from .openness import openness


@METHODS.register("ambient_occlusion")
class AmbientOcclusion(Method):
    """Lo ~ AO(x) c(x), AO the cosine-weighted share of the hemisphere that x sees, c the radiance without occlusion.

    c takes one lookup in a filtered cube for each cosine lobe, as partial environment maps without occlusion. It cannot
    show directional occlusion: a blocker darkens a glossy surface by the same factor, whether or not it hides the
    mirror direction.

    Attributes:
        lighting: "environment": the light itself, "AO with color". "constant": a grey light with the same mean
            luminance instead, "AO (shadow only)".
        rays: number N of rays at each point.
        seed: seed of the rays.
        mip_filter: filter of the cube, 5 taps before each 2x2 mean.
        volume: the volume of a lobe, by which levels are found.
        energy: the energy of a lobe; "normal": that of the view along the normal, "albedo": that of each view.
        lobes: largest number of cosine lobes for each glossy lobe.

    Source: the comparisons of Knuth et al. 2014, figure 6 (b) and (c). The paper does not give a formula: this reading
    is ours. Ambient occlusion as Zhukov et al. 1998, without a limit of distance.
    """

    lighting: Literal["environment", "constant"] = "environment"
    rays: Annotated[int, Field(ge=1, le=1 << 16)] = 64
    seed: Seed = 0
    mip_filter: LobeFilter = "sqrt_cosine"
    volume: Volume = "solid_angle"
    energy: Energy = "normal"
    lobes: Annotated[int, Field(ge=1, le=4)] = 2

    # Measured: furnace 7e-5, as for partial environment maps with one cube.
    equation = 'L_o approx "AO"(x) thin c(x)'
    contract = Contract(furnace=1e-3, budget=None, options={"energy": "albedo"})

    lobe_sums = lobe_sums

    def supports(self, material: Material, scene: Any) -> str | None:
        """The reason why a lobe is not a sum of round lobes about the mirror direction, if it is not."""
        return no_lobe_sums(material)

    def n_samples(self, material: Material) -> int:
        """Number of lookups: one for each cosine lobe and one for the diffuse part."""
        return n_lookups(material, self.lobes)

    @stage
    def calibration(self, light: CubeMap) -> LobeLevels:
        """Levels of exponents; they depend only on the resolution of the light."""
        return calibrate(light.resolution, self.mip_filter, self.volume)

    @stage
    def maps(self, light: CubeMap) -> PartialMaps:
        """The filtered light, or its mean."""
        faces, region = light.faces, make_whole(light)
        if self.lighting == "constant":
            mean = region.power[0] / region.solid_angle
            faces = (mean @ mean.new_tensor(LUMINANCE)).expand_as(faces)
        limit = cube_bytes(light.resolution, 1)
        return build_partial_maps(faces, region.index, 1, self.mip_filter, "cube", limit)

    @stage
    def ambient(self, scene: Any, view: View) -> Tensor:
        """AO of each point (P,)."""
        return openness(scene, view.points(), self.rays, self.seed)

    def shade(
        self,
        points: ShadingPoints,
        material: Material,
        lobe_sums: tuple[LobeSum, ...],
        calibration: LobeLevels,
        maps: PartialMaps,
        ambient: Tensor,
    ) -> Radiance:
        """Radiance (P, 3)."""
        reflectance = material.as_lobes(points.device)
        open_scene = lobe_radiance(points, reflectance, lobe_sums, calibration, maps, NoShadows(1), self.energy)
        return ambient.to(points.device)[:, None] * open_scene
