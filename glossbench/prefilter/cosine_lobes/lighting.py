"""Shading with maps that are filtered into cosine lobes: one lookup for each lobe and region of the light."""

from typing import Any, Literal, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from glossbench.brdf.material import Material, Reflectance
from glossbench.directions import reflect
from glossbench.envmap.pyramid import Environment, weighted_radiance
from glossbench.prefilter.cosine_lobes.lobe_sum import LobeSum, fit_lobe_sum, no_lobe_sum
from glossbench.prefilter.light_shadows import Shadows
from glossbench.scene.points import ShadingPoints
from glossbench.shading.kernels import over_points
from glossbench.shading.method import stage

Energy = Literal["normal", "albedo"]


class Maps(Environment, Protocol):
    """Maps of the regions of one light, one column of taps per map; the sum of the maps is the light."""

    def __len__(self) -> int: ...


class Levels(Protocol):
    """The level of the maps that shows the lobe cos^s: one level for all maps, or one for each map, (N,)."""

    def level(self, s: float) -> float | NDArray[np.float64]: ...


@stage
def lobe_sums(self: Any, material: Material) -> tuple[LobeSum, ...]:
    """Cosine lobes of each glossy lobe, at most the method's `lobes`."""
    return tuple(fit_lobe_sum(lobe, self.lobes) for lobe in material.as_lobes().lobes)


def no_lobe_sums(material: Material) -> str | None:
    """The reason why a lobe of a material is not a sum of round lobes about the mirror direction; None if all are."""
    reasons = (no_lobe_sum(lobe) for lobe in material.as_lobes().lobes)
    return next((reason for reason in reasons if reason), None)


def n_lookups(material: Material, lobes: int) -> int:
    """Number of lookups in one map: one for each cosine lobe (at most `lobes` per glossy lobe) and the diffuse part."""
    reflectance = material.as_lobes()
    n_lobes = sum(len(fit_lobe_sum(lobe, lobes).exponents) for lobe in reflectance.lobes)
    return n_lobes + bool(reflectance.diffuse)


def lobe_radiance(
    points: ShadingPoints,
    reflectance: Reflectance,
    lobe_sums: tuple[LobeSum, ...],
    calibration: Levels,
    maps: Maps,
    shadows: Shadows,
    energy: Energy,
) -> Tensor:
    """Radiance (P, 3): kd c(n, 1) + sum over lobes and their cosine lobes k of A share_k c(r, s_k).

    c(d, s) = sum over maps i of VIS_i PEM_i(d, level_i(s)), r the mirror direction of wo.

    Args:
        lobe_sums: the cosine lobes of each glossy lobe.
        energy: A, the albedo of the "normal" view, or the albedo of each view.

    Source: Knuth et al. 2014, eq. 5.
    """
    exponents = [s for lobe_sum in lobe_sums for s in lobe_sum.exponents]
    diffuse = bool(reflectance.diffuse)
    radiance = torch.zeros(len(points), 3, device=points.device)
    if not diffuse and not exponents:
        return radiance
    levels = np.array([calibration.level(s) for s in [1.0] * diffuse + exponents])
    at = torch.tensor(levels, dtype=torch.float32, device=points.device).view(len(levels), 1, -1)
    # Eight taps with their windows take about 4 times the temporaries of a lookup.
    means = iter(over_points(_compute_means, points, 4 * len(maps), maps, shadows, at, diffuse).split(3, dim=1))
    if diffuse:
        radiance += torch.stack(reflectance.diffuse) * next(means)
    cos_o = points.wo_local().z
    for lobe_sum in lobe_sums:
        a = lobe_sum.interpolate_albedo(torch.ones_like(cos_o) if energy == "normal" else cos_o).to(points.device)
        for share in lobe_sum.shares:
            radiance += share * a * next(means)
    return radiance


def _compute_means(points: ShadingPoints, maps: Maps, shadows: Shadows, levels: Tensor, diffuse: bool) -> Tensor:
    """c at levels (K, 1, 1 or N): (P, 3 K), all about r, except the first about n if there is a diffuse part."""
    visible = (shadows.visible(points),)
    axes = [points.n] * diffuse + [reflect(points.wo, points.n)] * (len(levels) - diffuse)
    return torch.cat([weighted_radiance(maps, d, level, visible) for d, level in zip(axes, levels, strict=True)], dim=1)
