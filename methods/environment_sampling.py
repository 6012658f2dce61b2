"""Environment sampling: the light as N directional lights, drawn in proportion to luminance."""

from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field
from torch import Tensor

from glossbench.prefilter import (
    METHODS,
    SEEDED,
    Contract,
    CubeMap,
    Material,
    Method,
    Occluder,
    PointSet,
    Radiance,
    Reflectance,
    Seed,
    ShadingPoints,
    Vec3,
    finest,
    kernel,
    lookup,
    luminance_distribution,
    merge_channels,
    occluder_of,
    over_points,
    points_2d,
    stage,
    to_local,
    unhidden,
)


class DirectionalLights(NamedTuple):
    """N lights: directions with components (1, N), and radiance over pdf over N, (N, 3)."""

    direction: Vec3
    power: Tensor


@METHODS.register("environment_sampling")
class EnvironmentSampling(Method):
    """Lo ~ (1/N) sum of f(wo, wi) cos_i L(wi) / p(wi), wi drawn in proportion to luminance, the same at every pixel.

    It is good for rough materials under small bright lights; a glossy material shows N separate highlights.

    Attributes:
        samples: N.
        visibility: "rays": one shadow ray per sample if the scene hides light.
        points: the kind of the N points of the unit square.
        seed: seed of random points and of the scrambling of Sobol's.

    Source: the baseline of Krivanek and Colbert 2008, figure 3; sampling after Pharr and Humphreys 2004.
    """

    samples: Annotated[int, Field(ge=1, le=1 << 20)] = 64
    visibility: Literal["none", "rays"] = "none"
    points: PointSet = "hammersley"
    seed: Seed = 0

    # Measured: furnace 0.009, turns 0.013, slope -0.81. Another light, or a turned one, gives other directions: so
    # `turns` measures noise.
    equation = "L_o approx 1/N sum_(i=1)^N (f(omega_o, omega_i) cos theta_i thin L(omega_i))/p(omega_i)"
    contract = Contract(furnace=0.03, linear=False, turns=0.03, budget=("samples", (64, 256, 1024, 4096)), slope=-0.5)

    @property
    def is_random(self) -> bool:
        """Whether the seed changes the image: only random points use it."""
        return self.points in SEEDED

    @stage
    def lights(self, light: CubeMap) -> DirectionalLights:
        """The directional lights."""
        u = points_2d(self.samples, self.points, self.seed).to(light.faces.device)
        d, pdf = luminance_distribution(light).sample(u)
        radiance = lookup(finest(light), d)
        return DirectionalLights(Vec3(*(c[None] for c in d)), radiance / (pdf * self.samples)[:, None])

    def shade(
        self, points: ShadingPoints, material: Material, lights: DirectionalLights, scene: Any = None
    ) -> Radiance:
        """Radiance (P, 3)."""
        occluder = occluder_of(scene) if self.visibility == "rays" else None
        return over_points(_kernel, points, self.samples, material.reflectance(points.device), lights, occluder)


@kernel("environment_sampling")
def _kernel(
    points: ShadingPoints, reflectance: Reflectance, lights: DirectionalLights, occluder: Occluder | None = None
) -> Radiance:
    """Sum over lights."""
    wi = to_local(lights.direction, points.t, points.b, points.n)
    weight = tuple(channel * wi.z for channel in reflectance.f(points.wo_local(), wi))
    sums = [w @ lights.power for w in unhidden(weight, points, lights.direction, occluder)]
    return merge_channels(sums)
