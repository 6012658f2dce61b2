"""Partial environment maps, Knuth et al. 2014: a light in regions, each filtered by itself into cosine lobes."""

from typing import Annotated, Any, Literal

import torch
from pydantic import Field
from torch import Tensor

from glossbench.brdf.lobe_sum import LobeSum, fit_lobe_sum, no_lobe_sum
from glossbench.brdf.material import Material
from glossbench.directions import reflect
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.lobe_calibration import LobeLevels, Volume, calibrate
from glossbench.envmap.lobe_pyramid import LobeFilter, PartialMaps, Storage, build_partial_maps
from glossbench.envmap.median_cut import Partition, median_cut, whole
from glossbench.envmap.pyramid import weighted_radiance
from glossbench.fusion import over_points
from glossbench.scene.points import ShadingPoints
from glossbench.shading import METHODS, Contract, Method, stage


@METHODS.register("partial_environment_maps")
class PartialEnvironmentMaps(Method):
    """Lo ~ kd c(n, 1) + sum over k of A share_k c(r, s_k), c(d, s) = sum over regions i of VIS_i PEM_i(d, level(s)).

    PEM_i is a cube that is black but for region i of the light, with levels that are filtered by 5 taps before each
    2x2 mean; level(s) is where one lit texel has become a lobe of the volume of cos^s (see lobe_calibration). A glossy
    lobe is a sum of cosine lobes about r, the mirror direction of wo, fitted to f cos_i seen along the normal, A its
    energy. That is exact for `phong`, whose exponent becomes s + 1 there (s without foreshortening); the part of the
    energy that the fit puts in the wrong place with two lobes is below 1 % for `kurt` and `ward` of m <= 0.5, 3 to
    12 % for `ggx` of alpha 0.3 to 0.05. It cannot show what stretches, cuts or shifts a lobe away from the normal
    view: foreshortening, shadowing, the horizon, anisotropy. Filters count texels alike, not by solid angle: a small
    light in the middle of a face loses up to half of its energy in the coarsest levels, one at a corner gains. Nothing
    finer than the fitted lobes is lost: up to a mirror the light's own texels are read.

    Attributes:
        regions: N of the median cut, about N / 6 a face.
        visibility: VIS_i. "none": nothing is occluded, so the maps are summed before they are filtered, as filtering
            is linear: one region and one lookup a lobe. "ones": the same image by N lookups, eq. 5 as it stands.
        mip_filter: the 5 taps: none, box, gauss (1 4 6 4 1), cosine or sqrt_cosine of -60, -30, 0, 30, 60 degrees.
        volume: by which levels are found, of a lobe rho: the integral of rho, or that of rho^3 / 3, its radial plot's.
        energy: A. "normal": of the view along the normal, as the paper's lobes have one from all sides; "albedo": of
            each view, which brings back a constant light times the albedo.
        lobes: cosine lobes at most for each glossy lobe.
        storage: of the maps: whole cubes, or of each face and level the rectangle that is lit; the images are equal.
        memory_limit: of the maps [GB]; what needs more is refused.

    Source: Knuth et al. 2014, sections 3 and 4, eq. 3 to 5; lobe sums as Kautz and McCool 2000. Differs: A for f cos_i,
    where eq. 4 has no factor: c is a mean, its integral (s + 1) / (2 pi) times eq. 4. In place of the parabolic maps
    of section 5, cropped cubes: one calibration for all.
    """

    regions: Annotated[int, Field(ge=6, le=4096)] = 64
    visibility: Literal["none", "ones"] = "none"
    mip_filter: LobeFilter = "sqrt_cosine"
    volume: Volume = "solid_angle"
    energy: Literal["normal", "albedo"] = "normal"
    lobes: Annotated[int, Field(ge=1, le=4)] = 2
    storage: Storage = "cube"
    memory_limit: Annotated[float, Field(gt=0, le=1024)] = 4.0

    # Measured: furnace 7e-5. More lookups bring it no nearer to the truth: there is no budget.
    contract = Contract(furnace=1e-3, budget=None, options={"energy": "albedo"})

    def supports(self, material: Material, scene: Any) -> str | None:
        """A reason where a lobe is no sum of round lobes about the mirror direction."""
        reasons = (no_lobe_sum(lobe) for lobe in material.reflectance().lobes)
        return next((reason for reason in reasons if reason), None)

    def n_samples(self, material: Material) -> int:
        """Lookups: the maps, for each cosine lobe and the diffuse part."""
        reflectance = material.reflectance()
        n_lobes = sum(len(fit_lobe_sum(lobe, self.lobes).exponents) for lobe in reflectance.lobes)
        n_maps = 1 if self.visibility == "none" else self.regions
        return n_maps * (n_lobes + bool(reflectance.diffuse))

    @stage
    def lobe_sums(self, material: Material) -> tuple[LobeSum, ...]:
        """Cosine lobes of each glossy lobe."""
        return tuple(fit_lobe_sum(lobe, self.lobes) for lobe in material.reflectance().lobes)

    @stage
    def calibration(self, light: CubeMap) -> LobeLevels:
        """Levels of exponents; of the light only its resolution counts."""
        return calibrate(light.resolution, self.mip_filter, self.volume)

    @stage
    def partition(self, light: CubeMap) -> Partition:
        """The regions."""
        return whole(light) if self.visibility == "none" else median_cut(light, self.regions)

    @stage
    def maps(self, light: CubeMap, partition: Partition) -> PartialMaps:
        """The partial environment maps, filtered."""
        limit = self.memory_limit * 1e9
        return build_partial_maps(light.faces, partition.index, len(partition), self.mip_filter, self.storage, limit)

    def shade(
        self,
        points: ShadingPoints,
        material: Material,
        lobe_sums: tuple[LobeSum, ...],
        calibration: LobeLevels,
        maps: PartialMaps,
    ) -> Tensor:
        """Radiance (P, 3)."""
        reflectance = material.reflectance(points.device)
        radiance = torch.zeros(len(points), 3, device=points.device)

        def c(kernel: Any, s: float) -> Tensor:
            level = torch.tensor(calibration.level(s), dtype=torch.float32, device=points.device)
            # Eight taps with their windows: some 4 times the temporaries of a lookup.
            return over_points(kernel, points, 4 * len(maps), maps, level)

        if reflectance.diffuse:
            radiance += torch.stack(reflectance.diffuse) * c(_about_normal, 1.0)
        cos_o = points.wo_local().z
        for lobe_sum in lobe_sums:
            energy = lobe_sum.albedo_at(torch.ones_like(cos_o) if self.energy == "normal" else cos_o)
            for s, share in zip(lobe_sum.exponents, lobe_sum.shares, strict=True):
                radiance += share * energy.to(points.device) * c(_about_mirror, s)
        return radiance


def _about_normal(points: ShadingPoints, maps: PartialMaps, level: Tensor) -> Tensor:
    """Eq. 5 for lobes about n."""
    return weighted_radiance(maps, points.n, level.expand_as(points.n.x), (_visible(points, maps),))


def _about_mirror(points: ShadingPoints, maps: PartialMaps, level: Tensor) -> Tensor:
    """Eq. 5 for lobes about r."""
    r = reflect(points.wo, points.n)
    return weighted_radiance(maps, r, level.expand_as(r.x), (_visible(points, maps),))


def _visible(points: ShadingPoints, maps: PartialMaps) -> Tensor:
    """VIS_i of each point (P, N): all ones, as nothing is occluded."""
    return torch.ones_like(points.n.x).expand(-1, len(maps))
