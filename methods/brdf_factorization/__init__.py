"""BRDF factorization, McCool et al. 2001: directional lights on a BRDF that is a product of two textures."""

from typing import Annotated

from pydantic import Field

from glossbench.prefilter import (
    METHODS,
    Contract,
    CubeMap,
    Material,
    Method,
    Partition,
    Radiance,
    ShadingPoints,
    Solver,
    Vec3,
    make_whole,
    median_cut,
    stage,
    to_local,
)

from .factors import BRDFFactors, factor_brdf


@METHODS.register("brdf_factorization")
class BRDFFactorization(Method):
    """Lo ~ sum over K directional lights of p(wi) q(h) p(wo) cos_i E_k, p and q the factors of the BRDF.

    Each light is one direction that stands for a region of the environment: correct for a light of few small sources, a
    baseline for any other light. A new light costs almost nothing, because the factors depend only on the material. It
    cannot show extended lights, nor the part of a BRDF that is not such a product.

    Attributes:
        lights: number K of regions of a median cut, at least 6; or 1: the whole light comes from its mean direction, or
            from above if it does not have one, such as a constant light.
        edge: texels along the edge of a factor's map.
        pairs: number of pairs of directions at which the BRDF is sampled.
        smoothness: weight lambda of the Laplacian against the samples: a larger weight gives smoother maps.
        solver: solver of the least-squares problem.
        tolerance: relative residual at which the solver stops.
        floor: values of the BRDF below this times its maximum are raised to it.

    Source: McCool et al. 2001; compared so in Latta and Kolb 2002, section 4.2.
    """

    lights: Annotated[int, Field(ge=1, le=4096)] = 1
    edge: Annotated[int, Field(ge=4, le=256)] = 32
    pairs: Annotated[int, Field(ge=100, le=10_000_000)] = 100_000
    smoothness: Annotated[float, Field(ge=0, le=1e4)] = 1.0
    floor: Annotated[float, Field(gt=0, le=0.1)] = 1e-4
    solver: Solver = "qmr"
    tolerance: Annotated[float, Field(gt=0, le=0.1)] = 1e-5

    equation = "L_o approx sum_k p(omega_k) thin q(h_k) thin p(omega_o) cos theta_k thin E_k"
    # Measured: furnace 1.0, for a narrow lobe that is not such a product; 18 with all light from one direction. turns
    # 4e-7. It is not linear, because the regions of a sum of lights are not those of its terms.
    contract = Contract(
        furnace=1.5, linear=False, budget=None, options={"lights": 384, "edge": 32, "pairs": 20_000},
        quick={"pairs": 5000, "edge": 8},
    )  # fmt: skip

    def n_samples(self, material: Material) -> int:
        """Number of lights."""
        return self.lights

    def notes(self) -> tuple[str, ...]:
        """A note that one light stands for the whole environment, which may not have a mean direction."""
        if self.lights > 1:
            return ()
        return (
            "brdf_factorization with lights: 1 takes all light from its mean direction (from above if it does not have "
            "one, such as a constant light); lights: 6 or more shows an extended light",
        )

    @stage
    def factors(self, material: Material) -> BRDFFactors:
        """The factors of the BRDF."""
        return factor_brdf(material, self.edge, self.pairs, self.smoothness, self.floor, self.solver, self.tolerance)

    @stage
    def sources(self, light: CubeMap) -> Partition:
        """The directional lights."""
        return make_whole(light) if self.lights == 1 else median_cut(light, self.lights)

    def shade(self, points: ShadingPoints, material: Material, factors: BRDFFactors, sources: Partition) -> Radiance:
        """Radiance (P, 3)."""
        wo = points.wo_local()
        total = points.n.x.new_zeros(len(points), 3)
        placed = BRDFFactors(factors.p.to(points.device), factors.q.to(points.device))
        for k in range(len(sources)):
            d = Vec3(*(c[k].expand(len(points)) for c in sources.direction))
            wi = to_local(d, points.t, points.b, points.n)
            total += placed.f(wo, wi) * wi.z.clamp(min=0)[:, None] * sources.power[k]
        return total
