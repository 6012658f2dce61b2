"""Filtered importance sampling, Krivanek and Colbert 2008: BRDF samples that read a filtered light."""

from math import log2, pi
from typing import Annotated, Any, Literal

import torch
from pydantic import Field
from torch import Tensor

from glossbench.prefilter import (
    METHODS,
    SEEDED,
    Contract,
    CubeMap,
    Environment,
    Finite,
    InputError,
    Lobe,
    Material,
    Method,
    MipFilter,
    Occluder,
    PerPoint,
    PointSet,
    Radiance,
    Sampler,
    Seed,
    ShadingPoints,
    Vec3,
    View,
    filtered_samples,
    irradiance,
    kernel,
    luminance_distribution,
    occluder_of,
    over_points,
    points_2d,
    project,
    pyramid,
    spherical,
    stage,
    to_world,
    visible_diffuse,
    weighted_radiance,
)

from .affine_footprint import make_steps, sum_affine
from .stratum import mean_pdf, stratum_ratio
from .visibility_harmonics import attenuate, fit_visibility, smooth

LodBias = Literal[
    "plain", "unreal", "bevy", "three_r187", "hdrp", "filament", "filament_last_level", "babylon", "materialx", "godot",
    "gltf_ibl_sampler", "playcanvas",
]  # fmt: skip
# Levels that each code adds to log4 of the exact ratio 1 / (N p Omega_texel), from the sources of each code. Filament
# and Babylon use K = 4, and Filament's library for the GPU at least 2 levels on its last map; Unreal takes twice the
# solid angle of a texel; Godot takes the texels of an octahedral map for those of a cube; glTF-IBL-Sampler and
# PlayCanvas leave out the 4 pi of the sphere. HDRP adds alpha.
LOD_BIAS: dict[LodBias, float] = {
    "plain": 0.0,
    "unreal": -0.5,
    "bevy": 0.0,
    "three_r187": 0.5,
    "filament": 1.0,
    "filament_last_level": 2.0,
    "babylon": 1.0,
    "materialx": 1.15,
    "godot": 1.29,
    "gltf_ibl_sampler": 1.83,
    "playcanvas": 1.83,
}


@METHODS.register("filtered_importance_sampling")
class FilteredImportanceSampling(Method):
    """Lo ~ (1/N) sum of L(wi, l) f cos_i / p, l = max(1/2 log2(K / (N p Omega_texel)) + mip_bias, 0).

    wi is drawn by the BRDF's own sampler, with the same N points at every pixel; l is the level of the pyramid whose
    texel covers the solid angle K / (N p) of a sample. Each glossy lobe is summed separately with its share of the
    samples; the diffuse part uses nine spherical harmonics. The isotropic filter is round: it blurs or misses the
    stretched shape of an anisotropic lobe or a grazing view. The affine filter is an ellipse, the image of the sample's
    square of side sqrt(K / N) under the Jacobian of u -> wi, from finite differences. It takes `probes` lookups along
    its major axis with Heckbert's Gaussian weights exp(-2 x^2), at the level of its minor axis. The minor axis is at
    least 1 / probes of the major axis, as in anisotropic filters of graphics hardware.

    Attributes:
        samples: N, divided among the lobes.
        sampler: how half vectors are drawn: as the model of the lobe usually does ("own"; visible normals for GGX); by
            its normals, with density D cos_h; by the normals that wo sees; by a spherical cap, which has the same
            density; or by a smaller cap, which leaves out most of those that reflect below the surface. The last three
            need the masking function of GGX.
        k: extent K of the filter; the paper chose 4 by eye, for a box pyramid.
        lod_bias: levels of a known code instead of 1/2 log2 K: unreal -0.5, plain and bevy 0, three_r187 0.5, filament
            and babylon 1, filament_last_level 2, materialx 1.15, godot 1.29, gltf_ibl_sampler and playcanvas 1.83;
            hdrp alpha, here the geometric mean of both widths of the lobe, and 1 for the diffuse part.
        kernel: p in l: "point", p at the sample; "stratum", the mean of p over the cone about the sample in which its
            integral is 1 / N, by two rounds of omega = 1 / (N p) from p at five directions; "normal_stratum", p at the
            sample times the ratio that the mean of p over the sample's own stratum has to it in a view along the
            normal, in closed form. Both are our adaptations of the idea of Tokuyoshi, who solves it for the squares of
            a reflective shadow map.
        mip_bias: number of levels to add to l.
        mip_filter: filter of the pyramid.
        clamp: limit of a texel's luminance before it is filtered, in means of the light, as engines cut suns; this
            loses energy. The diffuse part keeps it.
        projection: projection of the light: the dual paraboloid of the paper, or a cube with seamless edges.
        footprint: shape of the filter: isotropic (section 4.2, eq. 12 and 13), or affine (reported at the end of that
            section).
        probes: lookups of an affine footprint; an isotropic footprint always takes one lookup.
        visibility: the shadows, if the scene hides light. "spherical_harmonics": as in the paper, shadow tests in a few
            directions that are the same for all points. At each point, spherical harmonics are fitted to visibility
            times cosine. Their scalar product with those of the light is the diffuse part; divided by cos_i and limited
            to [0, 1], they attenuate each filtered sample. This blurs shadows, and guesses where no direction was
            tested. "rays": one shadow ray per sample; the diffuse part then takes N more filtered samples.
        visibility_samples: number of directions of shadow tests.
        visibility_directions: drawn by luminance, or uniform over the sphere.
        visibility_order: number of bands of the harmonics; n bands have n^2 coefficients. The "4th order" of the paper
            has 16, bands 0 to 3, as Sloan et al. 2002 count.
        visibility_smoothing: standard deviation [pixels] of a Gaussian that blurs the image of the coefficients. The
            paper hides the texels of its shadow maps by this; shadow rays do not need it. The cosine within the
            coefficients is blurred, too.
        points: the kind of the N points of the unit square.
        seed: seed of random points and of the scrambling of Sobol's.

    Source: Krivanek and Colbert 2008, sections 4.2, 5.1 and 5.2. Differs: shadow rays instead of shadow maps, and
    smoothing in the image, within the outline of the surface, instead of in the texture of the surface. Samplers, Heitz
    2018; Dupuy and Benyoub 2023; Eto and Tokuyoshi 2023. The kernel of a stratum, after Tokuyoshi 2016.
    """

    samples: Annotated[int, Field(ge=1, le=1 << 20)] = 40
    sampler: Sampler = "own"
    k: Annotated[float, Field(gt=0, le=1024)] = 4.0
    lod_bias: LodBias | None = None
    kernel: Literal["point", "stratum", "normal_stratum"] = "point"
    mip_bias: Annotated[Finite, Field(ge=-4, le=4)] = 0.0
    mip_filter: MipFilter = "box"
    clamp: Annotated[float, Field(gt=0)] | None = None
    projection: Literal["cube", "dual_paraboloid"] = "cube"
    footprint: Literal["isotropic", "affine"] = "isotropic"
    probes: Annotated[int, Field(ge=1, le=32)] = 8
    visibility: Literal["none", "spherical_harmonics", "rays"] = "none"
    visibility_samples: Annotated[int, Field(ge=1, le=1 << 16)] = 16
    visibility_directions: Literal["luminance", "uniform"] = "luminance"
    visibility_order: Annotated[int, Field(ge=1, le=8)] = 4
    visibility_smoothing: Annotated[float, Field(ge=0, le=64)] = 0.0
    points: PointSet = "hammersley"
    seed: Seed = 0

    # Measured: furnace 1.5e-4, slope -0.65.
    equation = (
        "L_o approx 1/N sum_(i=1)^N (L(omega_i, l) thin f cos theta_i)/p, "
        'quad l = max(1/2 log_2 K/(N p thin Omega_"texel") + "mip bias", 0)'
    )
    contract = Contract(furnace=1e-3, budget=("samples", (16, 64, 256, 1024)), slope=-0.5)

    pyramid = pyramid
    irradiance = irradiance

    @property
    def is_random(self) -> bool:
        """Whether the seed changes the image: only random points use it."""
        return self.points in SEEDED

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.lod_bias is not None and self.k != 4:
            raise InputError(
                f"filtered_importance_sampling.lod_bias replaces k, got both {self.lod_bias!r} and {self.k!r}"
            )
        if self.kernel != "point" and self.footprint == "affine":
            raise InputError(
                f"filtered_importance_sampling.kernel {self.kernel!r} is for the isotropic footprint, got affine"
            )

    def supports(self, material: Material, scene: Any) -> str | None:
        """The reason why its lobes cannot be sampled in this way."""
        return None if self.sampler == "own" else material.as_lobes().explain_sampler(self.sampler)

    def n_samples(self, material: Material) -> int:
        """Number of samples of all lobes, at least one for each."""
        return sum(material.as_lobes().share(self.samples))

    @stage
    def light_coefficients(self, light: CubeMap) -> Tensor | None:
        """Coefficients of the light (K, 3), for the diffuse part; None without visibility in spherical harmonics."""
        return project(light, self.visibility_order).float() if self.visibility == "spherical_harmonics" else None

    @stage
    def visibility_coefficients(self, light: CubeMap, scene: Any, view: View) -> PerPoint | None:
        """Coefficients of visibility times cosine (P, K) for the points of the view."""
        occluder = occluder_of(scene)
        if self.visibility != "spherical_harmonics" or occluder is None:
            return None
        device = str(light.faces.device)
        u = points_2d(self.visibility_samples).to(device)
        uniform = spherical(torch.acos(1 - 2 * u[:, 0]), 2 * pi * u[:, 1])
        d = uniform if self.visibility_directions == "uniform" else luminance_distribution(light).sample(u)[0]
        fit = fit_visibility(view.points().to(device), occluder, Vec3(*(c.float() for c in d)), self.visibility_order)
        return PerPoint(smooth(fit, view.mask(), self.visibility_smoothing))

    def shade(
        self,
        points: ShadingPoints,
        material: Material,
        pyramid: Environment,
        irradiance: Tensor,
        scene: Any = None,
        light_coefficients: Tensor | None = None,
        visibility_coefficients: PerPoint | None = None,
    ) -> Radiance:
        """Radiance (P, 3)."""
        reflectance = material.as_lobes(points.device).sampled_by(self.sampler)
        occluder = occluder_of(scene) if self.visibility == "rays" else None
        u = points_2d(self.samples, self.points, self.seed).to(points.device)
        level = self._level(self.samples, torch.ones((), device=points.device))
        hidden: Occluder | PerPoint | None = occluder
        if light_coefficients is not None and visibility_coefficients is not None:
            hidden, radiance = visibility_coefficients, torch.zeros(len(points), 3, device=points.device)
            if reflectance.diffuse:
                radiance += visibility_coefficients.values @ light_coefficients * torch.stack(reflectance.diffuse_f())
        else:
            radiance = visible_diffuse(points, reflectance, irradiance, occluder, pyramid, u, level)
        for lobe, n in zip(reflectance.lobes, reflectance.share(self.samples), strict=True):
            u = points_2d(n, self.points, self.seed).to(points.device)
            samples = lobe.sample_points(u)
            level = self._level(n, torch.sqrt(lobe.widths[0] * lobe.widths[1]))
            if self.kernel == "normal_stratum":
                level = level - 0.5 * torch.log2(stratum_ratio(lobe, u))
            if self.kernel == "stratum":
                count = torch.tensor(n, device=points.device)
                radiance += over_points(_sum_strata, points, n * 9, lobe, samples, pyramid, level, count, hidden) / n
            elif self.footprint == "isotropic":
                radiance += over_points(_sum_isotropic, points, n, lobe, samples, pyramid, level, hidden) / n
            else:
                stepped = make_steps(lobe, u)
                places = torch.arange(1, 2 * self.probes, 2, device=points.device) / self.probes - 1
                arguments = (lobe, samples, stepped, pyramid, level, places, hidden)
                radiance += over_points(sum_affine, points, n * self.probes, *arguments) / n
        return radiance

    def _level(self, n: int, alpha: Tensor) -> Tensor:
        """log4(K / n) plus the bias, which may be the width of the lobe."""
        if self.lod_bias == "hdrp":
            return alpha + (self.mip_bias - log2(n) / 2)
        extent = log2(self.k) / 2 if self.lod_bias is None else LOD_BIAS[self.lod_bias]
        return alpha.new_tensor(extent + self.mip_bias - log2(n) / 2)


@kernel("filtered_importance_sampling")
def _sum_isotropic(
    points: ShadingPoints,
    lobe: Lobe,
    samples: Any,
    pyramid: Environment,
    level: Tensor,
    hidden: Occluder | Tensor | None = None,
) -> Radiance:
    """Sum over samples of one lobe; level = log4(K / N) plus the bias."""
    wi, d, lod, weight = filtered_samples(points, lobe, samples, pyramid, level)
    return weighted_radiance(pyramid, d, lod, attenuate(weight, points, d, wi, hidden))


@kernel("stratum_kernel")
def _sum_strata(
    points: ShadingPoints,
    lobe: Lobe,
    samples: Any,
    pyramid: Environment,
    level: Tensor,
    n: Tensor,
    hidden: Occluder | Tensor | None = None,
) -> Radiance:
    """`_sum_isotropic`, with levels by the mean density over the cone that holds 1 / n of the probability."""
    wo = points.wo_local()
    wi, pdf, weight = lobe.sample(wo, samples)
    density = mean_pdf(lobe, wo, wi, pdf, n)
    d = to_world(wi, points.t, points.b, points.n)
    lod = level + 0.5 * (pyramid.log2_texels_per_sr(d) - torch.log2(density))
    return weighted_radiance(pyramid, d, lod, attenuate(weight, points, d, wi, hidden))
