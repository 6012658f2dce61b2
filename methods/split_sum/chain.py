"""The prefiltered levels of a light: each a cube whose texel R holds the light under a round lobe about R."""

from dataclasses import replace
from math import log, log2, pi, sqrt

import torch
from torch import Tensor

from glossbench.prefilter import (
    ROUND_LOBES,
    CubeMap,
    Pyramid,
    Radiance,
    RoundLobe,
    ShadingPoints,
    Vec3,
    cross,
    finest,
    join_levels,
    kernel,
    over_points,
    points_2d,
    sum_over_level,
    sum_over_tree,
    tangent,
    texel_directions,
    to_world,
    weighted_radiance,
)

from .mappings import MAPPINGS, Layout
from .settings import Settings
from .storage import store

SUMMED_LEVELS = 3  # of a hybrid: the last ones
FINENESS = 32  # texels of an exact level per 1 / alpha: bilinear lookups then blur the lobe by less than 0.5 %


def lay_out(light: CubeMap, settings: Settings) -> Layout:
    """The number of levels, and the edge of level 0, at most that of the light."""
    return Layout(settings.levels, min(settings.resolution, light.resolution))


def build_chain(light: CubeMap, source: Pyramid, settings: Settings) -> Pyramid:
    """All levels; edges halve from level to level, down to `smallest`."""
    layout = lay_out(light, settings)
    alphas = [MAPPINGS[settings.mapping].alpha(level, layout) for level in range(layout.levels)]
    levels: list[Tensor] = []
    for i, alpha in enumerate(alphas):
        edge = max(layout.edge >> i, min(settings.smallest, layout.edge), 1)
        if alpha == 0:
            faces = _level(source, edge)
        elif settings.source == "light":
            summed = settings.estimator == "exhaustive" or (
                settings.estimator == "hybrid" and i >= layout.levels - SUMMED_LEVELS
            )
            n = settings.samples[min(max(i - 1, 0), len(settings.samples) - 1)]
            faces = filter_light(light, source, alpha, edge, settings, n, summed)
        else:
            before = finest(CubeMap(levels[-1]))
            n = settings.samples[min(i - 1, len(settings.samples) - 1)]
            step = compute_step(alphas[i - 1], alpha, settings)
            faces = _filter(before, _make_lobe(step, settings, light), edge, settings, n)
        levels.append(store(faces, settings.storage))
    return join_levels(levels)


def build_exact_level(light: CubeMap, source: Pyramid, alpha: float, settings: Settings) -> Pyramid:
    """One level for one width; its edge is as fine as the lobe needs, at most `resolution`."""
    needed = 1 << max(0, round(log2(FINENESS / alpha) + 0.5))
    edge = min(needed, lay_out(light, settings).edge)
    summed = settings.estimator in ("exhaustive", "hybrid")
    faces = filter_light(light, source, alpha, edge, settings, settings.samples[-1], summed)
    return join_levels([store(faces, settings.storage)])


def filter_light(
    light: CubeMap, source: Pyramid, alpha: float, edge: int, settings: Settings, n: int, summed: bool
) -> Tensor:
    """The light under a lobe (6, edge, edge, 3): a sum over texels, or over n samples."""
    lobe = _make_lobe(alpha, settings, light)
    if not summed:
        return _filter(source, lobe, edge, settings, n)
    if settings.sum_edge is None:
        return sum_over_tree(light, source, lobe, edge)
    return sum_over_level(source, lobe, edge, min(settings.sum_edge, light.resolution))


def compute_step(before: float, alpha: float, settings: Settings) -> float:
    """The width of the filter from a level of one width to a wider one, as known programs choose it."""
    r0, r1 = sqrt(before), sqrt(alpha)
    if settings.source == "eevee":
        return float((r1**3 - r0**3) ** (2 / 3))
    return (sqrt(r1 * r1 - r0 * r0) * 1.25 * r1) ** 2


def _make_lobe(alpha: float, settings: Settings, light: CubeMap) -> RoundLobe:
    """The lobe of a level; an exhaustive sum cuts off its tail where samples of it would end."""
    lobe = ROUND_LOBES[settings.lobe](torch.tensor(min(alpha, 1.0), device=light.faces.device), settings.weight)
    if settings.tail == 1:
        return lobe
    return replace(lobe, reach=lobe.sample(torch.tensor(settings.tail))[0])


def _level(source: Pyramid, edge: int) -> Tensor:
    return source.level(source.sizes.tolist().index(edge))


def _filter(source: Pyramid, lobe: RoundLobe, edge: int, settings: Settings, n: int) -> Tensor:
    """sum of w_j L(l_j, lod_j) / sum of w_j: the same samples about every texel R."""
    u = points_2d(n).double().to(source.texels.device)
    wide = replace(lobe, alpha=lobe.alpha.double())
    radial, phi = u[:, 1] * settings.tail, 2 * pi * u[:, 0]
    if settings.estimator == "cone":
        away = radial * (1 - _cone_cosine(float(lobe.alpha)))
        weight, pdf = wide.value(away), torch.ones_like(away)
    else:
        away, pdf = wide.sample(radial)
        weight = wide.value(away) / pdf
    sin = torch.sqrt(away * (2 - away))
    wi = Vec3(*(c.float()[None] for c in (sin * torch.cos(phi), sin * torch.sin(phi), 1 - away)))
    lod = _levels_of(source, pdf, edge, settings, n, float(lobe.alpha)).float()[None]
    weight = (weight / weight.sum()).float()[None]
    r = Vec3(*(c.flatten().to(source.texels.device) for c in texel_directions(edge)))
    t = tangent(r)
    points = ShadingPoints(t, cross(r, t), r, r)
    return over_points(_sum_samples, points, n, wi, lod, weight, source).view(6, edge, edge, 3)


def _cone_cosine(alpha: float) -> float:
    """Cosine of the cone of EEVEE: it is twice as wide as the half vectors at which the lobe falls to 0.01 or 0.14."""
    half = 1 + log(0.01 + 0.13 * alpha) * alpha * alpha / 2
    return 2 * half * half - 1 if half > 0 else -1.0


def _levels_of(source: Pyramid, pdf: Tensor, edge: int, settings: Settings, n: int, alpha: float) -> Tensor:
    """lod = log4(1 / (N p Omega)) + bias; Omega = 4 pi / (6 R^2) for a cube of edge R.

    R is that of the source, or that of the level in its place. The octahedral formula is the same with R^2 the number
    of all texels of the map, not of a sixth of them, as if the map were a face.
    """
    if len(source.sizes) == 1:
        return torch.zeros_like(pdf)
    bias = alpha if settings.lod_bias == "alpha" else settings.lod_bias
    texels = 6 * (edge if settings.texel_area == "output" else int(source.sizes[0])) ** 2
    if settings.texel_area == "octahedral":
        texels *= 6
    return 0.5 * torch.log2(texels / (4 * pi * n * pdf)) + bias


@kernel("filtered_texels")
def _sum_samples(points: ShadingPoints, wi: Vec3, lod: Tensor, weight: Tensor, source: Pyramid) -> Radiance:
    """Sum over samples of weight L(d, lod), d about the texel's own direction."""
    d = to_world(wi, points.t, points.b, points.n)
    return weighted_radiance(source, d, lod, (weight,))
