"""Cosine lobes of a light, level by level, as CubeMapGen and cmft filter them."""

from math import log2
from typing import Annotated, Any, Literal

import torch
from pydantic import Field

from glossbench.prefilter import (
    METHODS,
    MIRROR,
    Contract,
    CosineLobe,
    CubeMap,
    Finite,
    Lobe,
    Material,
    Method,
    Microfacet,
    Pyramid,
    Radiance,
    Resolution,
    RoundCosine,
    ShadingPoints,
    ViewTable,
    albedos,
    diffuse_radiance,
    irradiance,
    join_levels,
    kernel,
    over_points,
    pyramid,
    reflect,
    stage,
    sum_over_tree,
    weighted_radiance,
)

CUT = 1e-5  # of the peak: beyond, a lobe is 0
LARGEST = 1e5  # exponent of a lobe that no cube resolves


@METHODS.register("prefiltered_cosine_lobes")
class PrefilteredCosineLobes(Method):
    """Lo ~ kd E(n) / pi + sum over lobes of albedo(cos_o) P(r, p), P(R, p) = sum of w (R . l)^p L / sum of w (R . l)^p.

    r is the mirror direction, w are solid angles of texels. Level m of M is filtered for the specular power
    2^(gloss_scale gloss + gloss_bias), gloss = max(0, 1 - m / (M - 1)); the power p of its lobe follows by the model.
    Between two levels the lookup is linear. The specular power of a Phong lobe is its exponent s. That of microfacets
    of width alpha is q = 2 / alpha^2 - 2 for half vectors, and q / 4 for directions. So the tail of GGX is missing, and
    whatever is not round about the mirror direction: stretched and cut highlights, anisotropy (a mean width is read).
    The albedo is that of the material's lobe at each view.

    Attributes:
        model: of the specular power p0 of a level: phong filters with p0, phongbrdf with p0 + 1 (for the cosine),
            blinn with p0 / 4, blinnbrdf with p0 / 4 + 1. Phong models read level s or q / 4, Blinn models 4 s or q.
        gloss_scale: 10 in the programs' examples.
        gloss_bias: 1 in the programs' examples.
        resolution: edge of level 0, at most that of the light.
        levels: M, with edges that halve from level to level.

    Source: Kautz et al. 2000, for the idea; the formulas, cmft cad5f31, after AMD's CubeMapGen. Differs: the sum takes
    texels of all levels, as in `split_sum`; measured there, it is off by at most 1.3e-3 of the mean.
    """

    model: Literal["phong", "phongbrdf", "blinn", "blinnbrdf"] = "blinnbrdf"
    gloss_scale: Annotated[Finite, Field(gt=0, le=16)] = 10.0
    gloss_bias: Annotated[Finite, Field(ge=0, le=8)] = 1.0
    resolution: Resolution = 256
    levels: Annotated[int, Field(ge=2, le=14)] = 7

    equation = (
        'L_o approx "albedo"(cos theta_o) thin P(r, p), quad '
        "P(R, p) = (sum_i w_i thin (R dot omega_i)^p L(omega_i)) / (sum_i w_i thin (R dot omega_i)^p)"
    )
    contract = Contract(furnace=1e-3, linear=False)

    mip_filter = "box"
    pyramid = pyramid
    irradiance, albedos = irradiance, albedos

    def supports(self, material: Material, scene: Any) -> str | None:
        """The reason why a lobe has no specular power; None if all have one."""
        known = all(_exponent(lobe) is not None for lobe in material.as_lobes().lobes)
        return None if known else "the axis of its lobe is not the mirror direction"

    def n_samples(self, material: Material) -> int:
        """One lookup for each lobe."""
        return len(material.as_lobes().lobes)

    @stage
    def chain(self, light: CubeMap, pyramid: Pyramid) -> Pyramid:
        """The filtered levels."""
        edge = min(self.resolution, light.resolution)
        levels = []
        for level in range(self.levels):
            gloss = 1 - level / (self.levels - 1)
            lobe = _make_lobe(self._filter_power(2 ** (self.gloss_scale * gloss + self.gloss_bias)))
            levels.append(sum_over_tree(light, pyramid, lobe, max(edge >> level, 1)))
        return join_levels(levels)

    def shade(
        self,
        points: ShadingPoints,
        material: Material,
        chain: Pyramid,
        albedos: tuple[ViewTable, ...],
        irradiance: torch.Tensor,
    ) -> Radiance:
        """Radiance (P, 3)."""
        reflectance = material.as_lobes(points.device)
        radiance = diffuse_radiance(reflectance, irradiance, points.n)
        for lobe, albedo in zip(reflectance.lobes, albedos, strict=True):
            level = torch.tensor(self._level(lobe), device=points.device)
            radiance = radiance + over_points(_read, points, 8, chain, level) * albedo.at(points.wo_local())
        return radiance

    def _filter_power(self, specular: float) -> float:
        """p of a level by its specular power."""
        p = specular / 4 if self.model.startswith("blinn") else specular
        return p + 1 if self.model.endswith("brdf") else p

    def _level(self, lobe: Lobe) -> float:
        """The level with the specular power of a lobe."""
        s = _exponent(lobe) or 0.0
        specular = min(max(4 * s if self.model.startswith("blinn") else s, 1e-3), LARGEST)
        gloss = (log2(specular) - self.gloss_bias) / self.gloss_scale
        return (1 - gloss) * (self.levels - 1)


def _exponent(lobe: Lobe) -> float | None:
    """s of a lobe about the mirror direction; None if its axis is another."""
    if isinstance(lobe, Microfacet):
        alpha = float(lobe.widths[0] + lobe.widths[1]) / 2
        return (2 / alpha**2 - 2) / 4
    if isinstance(lobe, CosineLobe) and tuple(map(float, lobe.C)) == MIRROR:
        return float(lobe.s)
    return None


def _make_lobe(p: float) -> RoundCosine:
    """(R . l)^p, cut off where it is below 1e-5."""
    return RoundCosine(torch.tensor((2 * p + 1) ** -0.5), reach=torch.tensor(1 - CUT ** (1 / p)))


@kernel("prefiltered_cosine_lobes")
def _read(points: ShadingPoints, chain: Pyramid, level: torch.Tensor) -> Radiance:
    """P(r) at a level, (P, 3)."""
    d = reflect(points.wo, points.n)
    return weighted_radiance(chain, d, level.expand(d.x.shape), (torch.ones_like(d.x),))
