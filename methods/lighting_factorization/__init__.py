"""Lighting factorization, Latta and Kolb 2002: the whole lighting computation as a product of a few cube maps."""

from dataclasses import dataclass
from math import pi
from typing import Annotated, Any, Literal

import torch
from pydantic import Field
from torch import Tensor

from glossbench.prefilter import (
    METHODS,
    Contract,
    CubeMap,
    Fraction,
    LightingSamples,
    Material,
    Method,
    Pyramid,
    Radiance,
    Resolution,
    Seed,
    ShadingPoints,
    Solver,
    TexelWeight,
    add_border,
    anisotropy,
    build_pyramid,
    from_cubemap,
    lookup,
    sample_lighting_function,
    stage,
)

from .factors import (
    PARAMETERS,
    LightFactors,
    Parameters,
    dominant_direction,
    factor_direction,
    factor_lighting,
)
from .fixed_point import fixed_point
from .monte_carlo import estimate_lighting_function


@dataclass(frozen=True)
class Textures:
    """The textures to render: Lo = min(color product of t_j, 1) scale; without the minimum if `limited` is false.

    Attributes:
        maps: t_j, or log t_j if `logarithm` is true.
        color, scale: factors (3,).
        dominant: dominant direction of the light (3,).
    """

    maps: tuple[Pyramid, ...]
    color: Tensor
    scale: Tensor
    dominant: Tensor
    limited: bool
    logarithm: bool


@METHODS.register("lighting_factorization")
class LightingFactorization(Method):
    """Lo(v, n) ~ t1(n) t2(r), r the mirror direction of v; NRV adds t3(v), NRHD t3(h) t4(d) of a dominant light.

    The factors are cube maps. They are found by least squares of log Lo over all pairs of normal and view of a virtual
    cube; for each pair the light is summed texel by texel. A few lookups show any isotropic material, without sampling.
    It cannot show the part of Lo that is not such a product: lobes whose shape changes with the viewing angle, and
    Fresnel reflection at grazing views. The logarithm weights relative errors: dark parts count as much as highlights.
    A new light or a new material needs a new factorization.

    Attributes:
        parameters: NR (t1 t2), NRV or NRHD.
        edge: texels along the edge of the maps.
        first_edge: edge of the maps in the first solve. Each further solve doubles it and starts from the last result,
            with the same samples. If it is not below `edge`, there is only one solve.
        virtual_edge: V of the virtual cube of normals and views, which gives about (6 V^2)^2 / 2 samples.
        light_edge: texels along the edge of a face of the light that is summed.
        texel_weight: solid angle of a texel of the light: "exact", or "differential", eq. 11.
        normalisation: the factored quantity: "integral" is Lo; "mean" is Lo over the sum of all texel weights, 4 pi, as
            in eq. 9. The result is multiplied back, so this only changes the meaning of `clamp`.
        clamp: samples above this value are lowered to it. The absolute errors in the paper are those of clamped
            samples.
        floor: samples below this times the mean are raised to it, because zero does not have a logarithm.
        smoothness: weight lambda of the Laplacian against the samples; the paper does not give its value.
        sampling: "sum" over all texels, or "monte_carlo": by `samples` of light and material for each sample of Lo.
        samples: number of samples of light and material for each sample of Lo, if `sampling` is "monte_carlo".
        seed: seed of these samples.
        solver: solver of the least-squares problem.
        tolerance: relative residual at which the solver stops.
        max_iterations: largest number of iterations of each solve.
        textures: "float", or "8bit" as on the hardware of the paper, see `fixed_point`.
        prescale: for 8-bit textures whose product is above 4: the exponent with which they are brightened, from 0, not
            at all, to 1, by the whole missing factor. Brightening cuts off highlights.
        interpolation: between texels, of "radiance" as in hardware, or of its "logarithm" as in the solve.
        level: the MIP level that is shown; 0 is the finest.
        mip: "factorized": coarser levels are the solves of smaller edges; "box": they are box-filtered from the finest.

    Source: Latta and Kolb 2002. Differs: the start (see `average_start`); tangents are along the world's +x.
    """

    parameters: Parameters = "NR"
    edge: Resolution = 32
    first_edge: Resolution = 16
    virtual_edge: Annotated[int, Field(ge=4, le=24)] = 12
    light_edge: Annotated[int, Field(ge=4, le=256)] = 64
    texel_weight: TexelWeight = "exact"
    normalisation: Literal["integral", "mean"] = "integral"
    clamp: Annotated[float, Field(gt=0)] = 4.0
    floor: Annotated[float, Field(gt=0, le=0.1)] = 1e-4
    smoothness: Annotated[float, Field(ge=0, le=1e4)] = 1.0
    sampling: Literal["sum", "monte_carlo"] = "sum"
    samples: Annotated[int, Field(ge=1, le=1 << 14)] = 64
    seed: Seed = 0
    solver: Solver = "qmr"
    # Measured, copper in the Uffizi, 1.18 million samples, maps of 64, RMS at 1e-3 and 1e-4: 0.37110, 0.37108.
    tolerance: Annotated[float, Field(gt=0, le=0.1)] = 1e-4
    max_iterations: Annotated[int, Field(ge=1, le=100_000)] = 500
    textures: Literal["float", "8bit"] = "float"
    prescale: Fraction = 1.0
    interpolation: Literal["radiance", "logarithm"] = "radiance"
    level: Annotated[int, Field(ge=0, le=4)] = 0
    mip: Literal["factorized", "box"] = "factorized"

    equation = "L_o (v, n) approx t_1 (n) thin t_2 (r), quad r = 2 (n dot v) n - v"
    # Measured: furnace 0.56, because an albedo that depends only on the angle is not a product of functions of n and r;
    # turns 9e-8.
    contract = Contract(furnace=0.8, linear=False, budget=None, quick={"virtual_edge": 6, "light_edge": 16, "edge": 16})

    @property
    def is_random(self) -> bool:
        """Whether the seed changes the image: only Monte Carlo sums use it."""
        return self.sampling == "monte_carlo"

    def supports(self, material: Material, scene: Any) -> str | None:
        """The reason why an anisotropic material cannot be shown."""
        return anisotropy(material)

    def n_samples(self, material: Material) -> int:
        """Number of lookups."""
        return len(PARAMETERS[self.parameters])

    @stage
    def lighting(self, light: CubeMap, material: Material) -> LightingSamples:
        """Samples of the lighting function."""
        if self.sampling == "monte_carlo":
            return estimate_lighting_function(light, material, self.virtual_edge, self.samples, self.seed)
        return sample_lighting_function(light, material, self.virtual_edge, self.light_edge, self.texel_weight)

    @stage
    def factors(self, light: CubeMap, lighting: LightingSamples) -> LightFactors:
        """Factors of the samples, for each edge of the maps."""
        unit = 1.0 if self.normalisation == "integral" else 4 * pi
        edges, edge = [self.edge], self.edge
        while edge > self.first_edge:
            edge //= 2
            edges.insert(0, edge)
        return factor_lighting(
            lighting, self.parameters, dominant_direction(light), edges, self.smoothness, self.floor,
            self.clamp * unit, self.solver, self.tolerance, self.max_iterations,
        )  # fmt: skip

    @stage
    def maps(self, light: CubeMap, factors: LightFactors) -> Textures:
        """The textures to render, from the factors."""
        device = light.faces.device
        unit = 1.0 if self.normalisation == "integral" else 4 * pi
        box = self.mip == "box"
        steps = min(self.level, len(factors.logs) - 1)
        logs = factors.logs[-1 if box else -1 - steps]
        color, scale, limited = factors.lit, torch.ones(3), False
        logarithm = self.interpolation == "logarithm" and self.textures == "float"
        values = [log if logarithm else torch.exp(log) for log in logs]
        if box and steps:
            values = [build_pyramid(CubeMap(v, "factor"), "box").level(steps) for v in values]
        if self.textures == "8bit":
            # The range of the hardware applies to samples in the units of the paper.
            stored = fixed_point([v / unit ** (1 / len(values)) for v in values], self.prescale)
            values, limited = list(stored.textures), True
            color, scale = stored.color * factors.lit, torch.full((3,), float(stored.scale * unit))
        maps = tuple(_make_pyramid(v.to(device)) for v in values)
        return Textures(maps, color.to(device), scale.to(device), factors.dominant, limited, logarithm)

    def pictures(self, maps: Textures) -> dict[str, Tensor]:
        """The factors, each an unfolded cube."""
        crosses = {}
        for name, table in zip(PARAMETERS[self.parameters], maps.maps, strict=True):
            edge = int(table.sizes[0]) + 2
            faces = table.texels.view(6, edge, edge, 3)[:, 1:-1, 1:-1]
            faces = torch.exp(faces) if maps.logarithm else faces
            crosses[name] = from_cubemap(CubeMap(faces.contiguous(), name), "horizontal_cross")
        return crosses

    def shade(self, points: ShadingPoints, material: Material, maps: Textures) -> Radiance:
        """Radiance (P, 3): the product of the lookups."""
        names = PARAMETERS[self.parameters]
        read = [
            lookup(texels, factor_direction(name, points.n, points.wo, maps.dominant))
            for name, texels in zip(names, maps.maps, strict=True)
        ]
        product = torch.exp(torch.stack(read).sum(0)) if maps.logarithm else torch.stack(read).prod(0)
        product = product * maps.color
        return (product.clamp(max=1) if maps.limited else product) * maps.scale


def _make_pyramid(faces: Tensor) -> Pyramid:
    """Faces (6, R, R, 3) of any sign as a pyramid of one level."""
    sizes = torch.tensor([faces.shape[1]], dtype=torch.int32, device=faces.device)
    return Pyramid(add_border(faces).reshape(-1, 3), torch.zeros_like(sizes), sizes)
