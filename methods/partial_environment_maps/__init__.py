"""Partial environment maps, Knuth et al. 2014: a light in regions, each filtered separately into cosine lobes."""

from typing import Annotated, Any, Literal

from pydantic import Field

from glossbench.prefilter import (
    METHODS,
    Contract,
    CubeMap,
    Energy,
    LobeFilter,
    LobeLevels,
    LobeSum,
    Maps,
    Material,
    Method,
    Partition,
    Radiance,
    ShadingPoints,
    Shadows,
    Visibility,
    Volume,
    build_partial_maps,
    calibrate,
    lobe_radiance,
    lobe_sums,
    make_whole,
    median_cut,
    n_lookups,
    no_lobe_sums,
    no_shadows,
    shadows,
    stage,
)

from .map_calibration import MapLevels, calibrate_maps
from .parabolic_maps import build_parabolic_maps, compute_pitches


@METHODS.register("partial_environment_maps")
class PartialEnvironmentMaps(Method):
    """Lo ~ kd c(n, 1) + sum over k of A share_k c(r, s_k), c(d, s) = sum over regions i of VIS_i PEM_i(d, level(s)).

    PEM_i is a cube map that is black except in region i of the light. Each of its levels is filtered by 5 taps before
    the 2x2 mean; level(s) is the level at which one lit texel has become a lobe with the volume of cos^s (see
    `calibrate`). A glossy lobe is a sum of cosine lobes about r, the mirror direction of wo, fitted to f cos_i seen
    along the normal; A is its energy. This is exact for `phong`, whose exponent becomes s + 1 there (s without
    foreshortening). With two lobes, the share of the energy that the fit puts in a wrong place is below 1 % for `kurt`
    and `ward` of m <= 0.5, and 3 to 12 % for `ggx` of alpha 0.3 to 0.05. It cannot show how a lobe is stretched, cut or
    shifted in other views than along the normal: foreshortening, shadowing, the horizon, anisotropy. The filters of
    cubes give all texels the same weight, not their solid angle: a small light in the middle of a face loses up to half
    of its energy in the coarsest levels, a light at a corner gains energy. The levels are as fine as the fitted lobes
    need: for a mirror the texels of the light itself are read.

    Attributes:
        regions: number N of regions of the median cut, about N / 6 per face.
        visibility: VIS_i. "shadow_maps": one variance shadow map per region, blurred according to its size. "rays": one
            ray to the region's direction. "none": VIS_i = 1; then, as filtering is linear, the cubes are summed before
            they are filtered: one region, and one lookup per lobe. If the scene does not hide light, all give the same
            image.
        mip_filter: the 5 taps: none, box, gauss (1 4 6 4 1), cosine or sqrt_cosine of -60, -30, 0, 30, 60 degrees.
        volume: the volume of a lobe rho, by which levels are found: the integral of rho, or that of rho^3 / 3, the
            volume of its radial plot.
        energy: A. "normal": the energy of the view along the normal, because the paper's lobes have the same energy in
            all views; "albedo": the energy of each view, so that a constant light gives the albedo times the light.
        lobes: largest number of cosine lobes for each glossy lobe.
        storage: of the maps. "cube": whole cubes. "cropped": for each face and level of a cube, the rectangle that is
            lit; the images are equal. "parabolic": each region in a paraboloid map about its own direction, with its
            own levels; its lobes are round and keep their energy, and the images are nearer to the truth
            (docs/decisions/011).
        memory_limit: largest size of the maps [GB]; larger maps are refused.
        shadow_resolution: texels along the edge of a shadow map.
        blocker_distance: distance between a blocker and its shadow, in units of the mesh's half-extent; it sets the
            width of the blur. The paper does not state one. 0 for no blur.
        light_bleeding: a point of a shadow map that sees less than this share of a light is dark.

    Source: Knuth et al. 2014, sections 3 and 4, eq. 3 to 5; lobe sums as Kautz and McCool 2000. Differs: the factor A,
    for f cos_i, is not in eq. 4: c is a mean, its integral (s + 1) / (2 pi) times eq. 4. Cropped cubes are ours, and so
    is the quantity that the parabolic maps of section 5 filter, see `build_parabolic_maps`. The blur depends on the
    angle that a region's area spans, see `build_variance_shadow_maps`.
    """

    regions: Annotated[int, Field(ge=6, le=4096)] = 64
    visibility: Visibility = "none"
    mip_filter: LobeFilter = "sqrt_cosine"
    volume: Volume = "solid_angle"
    energy: Energy = "normal"
    lobes: Annotated[int, Field(ge=1, le=4)] = 2
    storage: Literal["cube", "cropped", "parabolic"] = "cube"
    memory_limit: Annotated[float, Field(gt=0, le=1024)] = 4.0
    shadow_resolution: Annotated[int, Field(ge=8, le=4096)] = 256
    # Measured, bunny under Grace, phong 32, at 0, 1/4, 1/2, 1: relative RMS 0.412, 0.407, 0.414, 0.434.
    blocker_distance: Annotated[float, Field(ge=0, le=4)] = 0.25
    light_bleeding: Annotated[float, Field(ge=0, lt=1)] = 0.0

    # Measured: furnace 7e-5. It has no budget, because more lookups do not bring it nearer to the truth.
    equation = (
        'L_o approx k_d thin c(n, 1) + sum_k A thin "share"_k thin c(r, s_k), '
        'quad c(d, s) = sum_i "VIS"_i thin "PEM"_i (d, "level"(s))'
    )
    contract = Contract(furnace=1e-3, budget=None, options={"energy": "albedo"})

    lobe_sums = lobe_sums
    shadows = shadows

    def supports(self, material: Material, scene: Any) -> str | None:
        """The reason why a lobe is not a sum of round lobes about the mirror direction, or why shadow maps fail."""
        return no_lobe_sums(material) or no_shadows(self.visibility, scene)

    def n_samples(self, material: Material) -> int:
        """Number of lookups: one per map for each cosine lobe, and for the diffuse part."""
        return (1 if self._one_cube else self.regions) * n_lookups(material, self.lobes)

    @property
    def _one_cube(self) -> bool:
        """Whether one cube, the sum of all, is enough."""
        return self.visibility == "none" and self.storage != "parabolic"

    @stage
    def partition(self, light: CubeMap) -> Partition:
        """The regions."""
        return make_whole(light) if self._one_cube else median_cut(light, self.regions)

    @stage
    def calibration(self, partition: Partition) -> LobeLevels | MapLevels:
        """Levels of exponents: one list for all cubes, or one for each paraboloid map."""
        if self.storage == "parabolic":
            return calibrate_maps(compute_pitches(partition), self.mip_filter, self.volume)
        return calibrate(partition.index.shape[1], self.mip_filter, self.volume)

    @stage
    def maps(self, light: CubeMap, partition: Partition) -> Maps:
        """The partial environment maps, filtered."""
        limit = self.memory_limit * 1e9
        if self.storage == "parabolic":
            return build_parabolic_maps(light, partition, self.mip_filter, limit)
        return build_partial_maps(light.faces, partition.index, len(partition), self.mip_filter, self.storage, limit)

    def shade(
        self,
        points: ShadingPoints,
        material: Material,
        lobe_sums: tuple[LobeSum, ...],
        calibration: LobeLevels | MapLevels,
        maps: Maps,
        shadows: Shadows,
    ) -> Radiance:
        """Radiance (P, 3)."""
        reflectance = material.as_lobes(points.device)
        return lobe_radiance(points, reflectance, lobe_sums, calibration, maps, shadows, self.energy)
