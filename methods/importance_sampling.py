"""Importance sampling of the BRDF without a filter: the baseline for prefiltering."""

from typing import Annotated, Any, Literal

from pydantic import Field
from torch import Tensor

from glossbench.prefilter import (
    METHODS,
    SEEDED,
    Contract,
    CubeMap,
    Environment,
    Lobe,
    Material,
    Method,
    Occluder,
    PointSet,
    Radiance,
    Sampler,
    Seed,
    ShadingPoints,
    finest,
    irradiance,
    kernel,
    occluder_of,
    over_points,
    points_2d,
    stage,
    to_world,
    unhidden,
    visible_diffuse,
    weighted_radiance,
)


@METHODS.register("importance_sampling")
class ImportanceSampling(Method):
    """Lo ~ (1/N) sum of L(wi) f cos_i / p, wi drawn by the BRDF's sampler, the same N points at every pixel.

    Each glossy lobe is summed separately with its share of the samples; the diffuse part uses nine spherical harmonics.
    Small bright lights appear as separate images of themselves until the spacing of the samples is below their width.

    Attributes:
        samples: N, divided among the lobes.
        sampler: how half vectors are drawn: as the model of the lobe usually does ("own"; visible normals for GGX); by
            its normals, with density D cos_h; by the normals that wo sees; by a spherical cap, which has the same
            density; or by a smaller cap, which leaves out most of those that reflect below the surface. The last three
            need the masking function of GGX.
        visibility: "rays": one shadow ray per sample if the scene hides light; the diffuse part then takes N more
            samples.
        points: the kind of the N points of the unit square.
        seed: seed of random points and of the scrambling of Sobol's.

    Source: Cook 1986; visible normals, Heitz 2018; caps, Dupuy and Benyoub 2023, Eto and Tokuyoshi 2023.
    """

    samples: Annotated[int, Field(ge=1, le=1 << 20)] = 40
    sampler: Sampler = "own"
    visibility: Literal["none", "rays"] = "none"
    points: PointSet = "hammersley"
    seed: Seed = 0

    # Measured: furnace 1.5e-4, slope -0.95; random points would give -0.5.
    equation = "L_o approx 1/N sum_(i=1)^N (L(omega_i) thin f cos theta_i)/p"
    contract = Contract(furnace=1e-3, budget=("samples", (16, 64, 256, 1024)), slope=-0.5)

    irradiance = irradiance

    @property
    def is_random(self) -> bool:
        """Whether the seed changes the image: only random points use it."""
        return self.points in SEEDED

    def supports(self, material: Material, scene: Any) -> str | None:
        """The reason why its lobes cannot be sampled in this way."""
        return None if self.sampler == "own" else material.as_lobes().explain_sampler(self.sampler)

    def n_samples(self, material: Material) -> int:
        """Number of samples of all lobes, at least one for each."""
        return sum(material.as_lobes().share(self.samples))

    @stage
    def texels(self, light: CubeMap) -> Environment:
        """The light with borders, for a bilinear lookup."""
        return finest(light)

    def shade(
        self, points: ShadingPoints, material: Material, texels: Environment, irradiance: Tensor, scene: Any = None
    ) -> Radiance:
        """Radiance (P, 3)."""
        reflectance = material.as_lobes(points.device).sampled_by(self.sampler)
        occluder = occluder_of(scene) if self.visibility == "rays" else None
        u = points_2d(self.samples, self.points, self.seed).to(points.device)
        radiance = visible_diffuse(points, reflectance, irradiance, occluder, texels, u)
        for lobe, n in zip(reflectance.lobes, reflectance.share(self.samples), strict=True):
            samples = lobe.sample_points(points_2d(n, self.points, self.seed).to(points.device))
            radiance += over_points(_kernel, points, n, lobe, samples, texels, occluder) / n
        return radiance


@kernel("importance_sampling")
def _kernel(
    points: ShadingPoints, lobe: Lobe, samples: Any, texels: Environment, occluder: Occluder | None
) -> Radiance:
    """Sum over samples of one lobe."""
    wi, _, weight = lobe.sample(points.wo_local(), samples)
    d = to_world(wi, points.t, points.b, points.n)
    return weighted_radiance(texels, d, None, unhidden(weight, points, d, occluder))
