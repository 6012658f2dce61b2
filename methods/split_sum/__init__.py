"""The split sum, Karis 2013: one lookup in a prefiltered light, times one albedo; and what programs make of it."""

from dataclasses import fields, replace
from typing import Annotated, Any, Literal

import torch
from pydantic import BeforeValidator, Field
from torch import Tensor

from glossbench.prefilter import (
    METHODS,
    Contract,
    CubeMap,
    Finite,
    Material,
    Method,
    Microfacet,
    Pyramid,
    Radiance,
    Resolution,
    RoundShape,
    ShadingPoints,
    ViewTable,
    Weight,
    diffuse_radiance,
    from_cubemap,
    irradiance,
    kernel,
    merge_channels,
    over_points,
    pyramid,
    reflect,
    stage,
    weighted_radiance,
    widen,
)

from .chain import build_chain, build_exact_level, lay_out
from .directions import lean
from .final import build_table, fit_terms
from .mappings import MAPPINGS, MappingName
from .settings import PRESETS, Direction, Estimator, Final, Preset, Settings, Source, Storage, TexelArea

N = Annotated[int, Field(ge=1, le=1 << 20)]
Samples = Annotated[
    tuple[N, ...], Field(min_length=1, max_length=16), BeforeValidator(lambda v: (v,) if isinstance(v, int) else v)
]


@METHODS.register("split_sum")
class SplitSum(Method):
    """Lo ~ kd E(n) / pi + sum over lobes of P(d, alpha) ks (f0 A(cos_o) + B(cos_o)).

    P(R, alpha) = integral of L k / integral of k, k a lobe that is round about R, computed for the texels R of a cube:
    level by level, each with a width alpha of its own, and read between two levels. d is the mirror direction, or leans
    to the normal. A and B are the albedo of the material's own lobe, linear in f0. The lobe k is that of the view along
    the normal, so the method cannot show how a highlight is stretched or cut by the horizon at other views, no
    anisotropy, and no colour of Fresnel that changes within a lobe. For widths alpha_x, alpha_y it reads their mean,
    the roughness of Filament and HDRP before they stretch the direction of an anisotropic lookup.

    Without a preset the options have the values of the family's floor: an exhaustive sum with the exact lobe, for the
    exact alpha, without levels. What is left is the error of the two ideas themselves: the lobe for n = wo = R, and the
    mean of a product as a product of means. An option that is given beside a preset replaces that of the preset.

    A preset says how a program filters, not all that it does: multiscatter is off in all of them, because the truth of
    a material scatters light once; their sample points are Hammersley's; their cubes halve from level to level.

    Attributes:
        preset: the choices of a program, as of 2024 to 2026. What was not read from its source is marked in
            settings.py. Left out: eevee's fade to harmonics above roughness 0.7, bevy's bounded sampler, the 0.001 that
            playcanvas adds to a pdf, the box filter's replacement in unreal.
        lobe: ggx; cosine_power, c^p with p = (1 / alpha^2 - 1) / 2; or sg, a Gaussian of half vectors.
        weight: of a direction l with c = l . R: one; cos, c, which is Karis's choice; g2, which makes ggx the exact
            lobe for n = wo = R; cos_g, c times Schlick's G1.
        estimator: exhaustive, a sum over texels; fis, samples of the lobe that read a box pyramid; cone, samples
            uniform in a cone; hybrid, fis and in the last three levels exhaustive.
        samples: of fis and cone: one number, or one for each level from level 1 on; the last serves the rest, too.
        tail: share of the lobe that is used: u of a sample's angle is multiplied by it, and a sum ends where it ends.
        lod_bias: levels to add to log4(1 / (N pdf Omega)); "alpha" adds alpha; -16 reads the light itself.
        texel_area: Omega. cube, 4 pi / (6 R^2); output, with R of the level that is filtered, not of its source;
            octahedral, the cube's formula on an octahedral map with as many texels: 1.29 levels coarser.
        sum_edge: exhaustive sums take all texels of the level with this edge. None: texels of all levels, as fine as
            the lobe and the distance need, each at the centroid of its light. Measured, spots of 128^2, RMS of P over
            its mean: 5e-4 for alpha 0.05, 1.3e-3 for 0.2, 8e-4 for 0.8; with an edge of 16: 0.22, 0.021, 0.005.
        source: what a level is filtered from: the light, or the level before, by the width that three.js r182 to r186
            or EEVEE chose for it.
        resolution: edge of level 0, at most that of the light.
        levels: their number.
        smallest: edge below which levels are not halved.
        mapping: of roughness to levels. "exact": one level, filtered for the material's alpha, for each lobe.
        storage: of the levels.
        direction: d. mirror; filament, frostbite and hdrp lean, see directions.py.
        final: A and B. table, for the material's own lobe; fit, Karis's formula for GGX.
        multiscatter: whether a lobe is multiplied by 1 + f0 (1 / y - 1), y its albedo for f0 = 1, for light that is
            reflected more than once.

    Source: Karis 2013; sg, Wang et al. 2009; frostbite, Lagarde and Rousiers 2014. Presets: filament 13d3ade, hdrp
    0c658a0, three.js of 2025-12 and 2026-09, godot 105e81f, babylon 1267e09, gltf_ibl_sampler 08fa122, playcanvas
    04847c6, eevee 3b3a573; unreal by an inventory of 2026-09, and 5.8. Differs: the table is that of the material's own
    lobe, which has height-correlated shadowing if it is GGX.
    """

    preset: Preset | None = None
    lobe: RoundShape | None = None
    weight: Weight | None = None
    estimator: Estimator | None = None
    samples: Samples | None = None
    tail: Annotated[float, Field(gt=0, le=1)] | None = None
    lod_bias: Annotated[Finite, Field(ge=-16, le=8)] | Literal["alpha"] | None = None
    texel_area: TexelArea | None = None
    sum_edge: Resolution | None = None
    source: Source | None = None
    resolution: Resolution | None = None
    levels: Annotated[int, Field(ge=2, le=16)] | None = None
    smallest: Annotated[int, Field(ge=1, le=64)] | None = None
    mapping: MappingName | None = None
    storage: Storage | None = None
    direction: Direction | None = None
    final: Final | None = None
    multiscatter: bool | None = None

    equation = (
        "L_o approx sum_k P(d, alpha_k) thin k_s (f_0 thin A + B), "
        'quad P(R, alpha) = (integral L(omega) thin k(omega dot R) thin "d" omega) / '
        '(integral k(omega dot R) thin "d" omega)'
    )
    # Measured: furnace 3e-4; a sum of lights is off by 2e-4, as the centroids of
    # the texels of an exhaustive sum depend on the light.
    contract = Contract(furnace=1e-3, linear=False)

    mip_filter = "box"
    pyramid = pyramid
    irradiance = irradiance

    @property
    def settings(self) -> Settings:
        """Every option: as given, or by the preset."""
        base = PRESETS[self.preset] if self.preset else Settings()
        given = {each.name: getattr(self, each.name) for each in fields(Settings)}
        return replace(base, **{name: value for name, value in given.items() if value is not None})

    @property
    def baked(self) -> Settings:
        """The settings that decide the chain; the others have their defaults, so that equal chains are shared."""
        floor = Settings()
        return replace(self.settings, direction=floor.direction, final=floor.final, multiscatter=floor.multiscatter)

    def supports(self, material: Material, scene: Any) -> str | None:
        """The reason why a lobe does not have a width of half vectors; None if all have one."""
        others = [lobe for lobe in material.as_lobes().lobes if not isinstance(lobe, Microfacet)]
        return "its lobe is not one of half vectors, and has no alpha" if others else None

    def n_samples(self, material: Material) -> int:
        """One lookup for each lobe."""
        return len(material.as_lobes().lobes)

    @stage
    def chain(self, light: CubeMap, pyramid: Pyramid) -> Pyramid | None:
        """The prefiltered levels; None for the mapping "exact"."""
        return None if self.baked.mapping == "exact" else build_chain(light, pyramid, self.baked)

    @stage
    def exact_levels(self, light: CubeMap, pyramid: Pyramid, material: Material) -> tuple[Pyramid, ...]:
        """For the mapping "exact", one level for each lobe; else none."""
        if self.baked.mapping != "exact":
            return ()
        return tuple(build_exact_level(light, pyramid, _alpha(lobe), self.baked) for lobe in _lobes(material))

    @stage
    def tables(self, material: Material) -> tuple[ViewTable, ...]:
        """The albedo of each lobe over cos_o, for f0 = 0 and f0 = 1."""
        return tuple(build_table(lobe) for lobe in _lobes(material))

    def pictures(self, chain: Pyramid | None, exact_levels: tuple[Pyramid, ...]) -> dict[str, Tensor]:
        """The levels, each an unfolded cube."""
        levels = exact_levels if chain is None else (chain,)
        faces = [each.level(i) for each in levels for i in range(len(each.sizes)) if each.sizes[i] > 1]
        return {
            f"level {i}": from_cubemap(CubeMap(each.contiguous()), "horizontal_cross") for i, each in enumerate(faces)
        }

    def shade(
        self,
        points: ShadingPoints,
        light: CubeMap,
        material: Material,
        chain: Pyramid | None,
        exact_levels: tuple[Pyramid, ...],
        tables: tuple[ViewTable, ...],
        irradiance: Tensor,
    ) -> Radiance:
        """Radiance (P, 3)."""
        settings, reflectance, cos_o = self.settings, material.as_lobes(points.device), points.wo_local().z
        radiance = diffuse_radiance(reflectance, irradiance, points.n)
        for k, lobe in enumerate(_lobes(material, points.device)):
            alpha = _alpha(lobe)
            if chain is None:
                levels, at = exact_levels[k], 0.0
            else:
                levels, at = chain, MAPPINGS[settings.mapping].level(alpha, lay_out(light, settings))
            level = torch.tensor(at, device=points.device)
            P = over_points(_read, points, 8, levels, level, alpha, settings.direction)
            terms = fit_terms(alpha**0.5, cos_o) if settings.final == "fit" else tables[k].at(points.wo_local())
            x, y = terms.unbind(1)
            albedo = [f0 * (y - x) + x for f0 in lobe.f0]
            if settings.multiscatter:
                albedo = [a * (1 + f0 * (1 / y - 1)) for a, f0 in zip(albedo, lobe.f0, strict=True)]
            n = max(len(albedo), len(lobe.ks))
            scale = [a * ks for a, ks in zip(widen(tuple(albedo), n), widen(lobe.ks, n), strict=True)]
            radiance = radiance + merge_channels([P * s[:, None] for s in scale])
        return radiance


def _lobes(material: Material, device: str = "cpu") -> list[Microfacet]:
    return [lobe for lobe in material.as_lobes(device).lobes if isinstance(lobe, Microfacet)]


def _alpha(lobe: Microfacet) -> float:
    """The mean of both widths."""
    return float(lobe.widths[0] + lobe.widths[1]) / 2


@kernel("split_sum")
def _read(points: ShadingPoints, levels: Pyramid, level: Tensor, alpha: float, direction: Direction) -> Radiance:
    """P at each point, (P, 3)."""
    d = lean(reflect(points.wo, points.n), points.n, points.wo_local().z, alpha, direction)
    return weighted_radiance(levels, d, level.expand(d.x.shape), (torch.ones_like(d.x),))
