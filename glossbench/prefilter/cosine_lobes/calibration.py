"""The level of a filtered cube that shows the lobe cos^s: one lit texel, filtered, has the same volume there."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import log2, pi
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from glossbench.directions import Vec3, cross, normalize, points_2d, spherical, stack, to_world
from glossbench.envmap.cubemap import texel_directions, texel_solid_angles
from glossbench.envmap.pyramid import lookup
from glossbench.prefilter.cosine_lobes.pyramid import LobeFilter, PartialMaps, build_partial_maps

Volume = Literal["radial_plot", "solid_angle"]
Places = Literal["sphere", "centre"]

N_CUBES = 8  # with three lit texels each, one per channel
N_ANGLES, N_AZIMUTHS = 129, 4
STEPS = 16  # between two levels
REACH = 6.0  # texels of the coarser level; beyond this distance a lobe is black, or the whole sphere is reached
# Cubes of these sizes and between are calibrated directly; other sizes use the nearest of them, see `_refine_levels`.
FINEST, COARSEST = 256, 16
# At this level neither the texels of level 0 nor the curvature of the sphere affect a lobe: the next is twice as wide.
# Measured, 512^2 from 256^2: levels off by up to 0.007 (sqrt_cosine, solid_angle), 0.014 (none, radial_plot).
ALIKE = 3


@dataclass(frozen=True)
class LobeLevels:
    """Exponents along the levels of a cube, from fine to coarse.

    Attributes:
        levels: (T,), with 16 steps between two whole levels.
        exponents: exponent s for which cos^s has the same volume as the lobe at that level, falling, (T,).
        errors: the difference between both lobes of equal volume, relative to that volume, (T,).
    """

    levels: NDArray[np.float64]
    exponents: NDArray[np.float64]
    errors: NDArray[np.float64]

    def level(self, s: float) -> float:
        """The level of an exponent: 0 for the finest lobe and all finer ones, the last for lobes wider than any."""
        return max(0.0, float(np.interp(-np.log1p(s), -np.log1p(self.exponents), self.levels)))

    def error(self, s: float) -> float:
        """The difference between both lobes at an exponent, relative to their volume."""
        return float(np.interp(-np.log1p(s), -np.log1p(self.exponents), self.errors))


def calibrate(
    resolution: int, mip_filter: LobeFilter, volume: Volume = "solid_angle", places: Places = "centre"
) -> LobeLevels:
    """Levels of a cube of R texels per edge for every exponent.

    K_l(theta) is the radiance at level l at an angle theta from a lit texel of unit flux. It is the mean over 24 lit
    texels, which lie at different places relative to coarser texels. Between levels it is linear, as the lookup is. The
    lobe is rho(theta) = K(theta) / K(0). Volumes of the lobe, and of cos^s:

        solid_angle   integral of rho dw: 2 pi / (s + 1)
        radial_plot   1/3 integral of rho^3 dw, the volume of the solid of radius rho: 2 pi / (3 (3 s + 1))

    The error is the integral of |rho^p - cos^(p s)| over the integral of cos^(p s), p = 1 for solid_angle and 3 for
    radial_plot.

    Args:
        places: places of the lit texels: in the middle quarter of a face, or all over the sphere.

    Source: Knuth et al. 2014, section 5, which does not specify the volume, the place of the texel, or the measure of a
    difference. Among the tested choices, solid_angle is nearest to the true convolution of lights, and radial_plot is
    nearest to the errors in the paper (docs/decisions/009).
    """
    at = min(max(resolution, COARSEST), FINEST)
    shift = int(log2(resolution / at))
    maps, centres = _light_texels(at, mip_filter, places)
    edges = 2 / maps.sizes.numpy()
    found = match_levels(lambda level, cosines: _measure_profile(maps, centres, cosines, level), edges, volume)
    return _refine_levels(found, shift) if shift > 0 else replace(found, levels=found.levels + shift)


def match_levels(
    profile: Callable[[int, NDArray[np.float64]], NDArray[np.float64]],
    edges: NDArray[Any],
    volume: Volume,
) -> LobeLevels:
    """Exponents of the lobes K_l, from their profiles at given cosines and the angles that their texels span."""
    power = 3 if volume == "radial_plot" else 1
    levels, exponents, errors = [], [], []
    shares = np.arange(STEPS) / STEPS
    for level, edge in enumerate(edges[1:]):
        reach = min(pi, REACH * edge)
        cosines, weight = _make_rings(reach)
        last = level == len(edges) - 2
        share = np.append(shares, 1.0)[: STEPS + last, None]
        mixed = (1 - share) * profile(level, cosines) + share * profile(level + 1, cosines)
        rho = (mixed / mixed[:, :1]) ** power
        # For the exponent p s, the integral is 2 pi / (p s + 1) in both measures.
        total = rho @ weight
        s = (2 * pi / total - 1) / power
        lobe = np.clip(cosines, 0, 1) ** np.maximum(power * s, 0)[:, None]
        levels.append(level + share[:, 0])
        exponents.append(s)
        errors.append(np.abs(rho - lobe) @ weight / total)
    falling = np.minimum.accumulate(np.concatenate(exponents))
    falling -= 1e-12 * np.arange(len(falling))
    kept = falling > -0.5
    return LobeLevels(np.concatenate(levels)[kept], falling[kept], np.concatenate(errors)[kept])


def _make_rings(reach: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cosines of rings up to an angle, and their solid angles by the trapezoid rule, (N_ANGLES,)."""
    # 1 - cos = (1 - cos(reach)) u^2, so that the angles are about equally spaced.
    u = np.linspace(0, 1, N_ANGLES)
    weight = 2 * pi * (1 - np.cos(reach)) * 2 * u * np.gradient(u)
    weight[-1] /= 2
    return 1 - (1 - np.cos(reach)) * u * u, weight


def _refine_levels(found: LobeLevels, n_halvings: int) -> LobeLevels:
    """Levels of a cube that is 2^n times as fine.

    Its fine levels are the given ones at a smaller size; its coarse levels are the given ones, moved by n levels.
    Between them one level is repeated, each time at twice the size, which is a quarter of the exponent.
    """
    i = np.arange(len(found.levels) + STEPS * n_halvings)
    repeats = np.clip(i // STEPS - ALIKE, 0, n_halvings)
    source = i - STEPS * repeats
    return LobeLevels(i / STEPS, found.exponents[source] * 4.0 ** (n_halvings - repeats), found.errors[source])


def _light_texels(resolution: int, mip_filter: LobeFilter, places: Places) -> tuple[PartialMaps, Tensor]:
    """Cubes with three lit texels of unit flux each, one per channel, and the directions of these (N, 3, 3)."""
    n = 3 * N_CUBES
    u = points_2d(n, "r2")
    if places == "sphere":
        wanted = stack(spherical(torch.acos(1 - 2 * u[:, 0]), 2 * pi * u[:, 1]))
    else:
        wanted = stack(normalize(Vec3(u[:, 0] - 0.5, u[:, 1] - 0.5, torch.ones(n))))
    d = stack(texel_directions(resolution)).reshape(-1, 3)
    texel = (wanted @ d.T).argmax(1)
    flux = 1 / texel_solid_angles(resolution).expand(6, -1, -1).reshape(-1)[texel]
    faces, index = torch.zeros(len(d), 3), torch.zeros(len(d), dtype=torch.int32)
    order = torch.arange(n)
    faces[texel, order % 3] = flux.float()
    index[texel] = (order // 3).int()
    shape = (6, resolution, resolution)
    maps = build_partial_maps(faces.view(*shape, 3), index.view(shape), N_CUBES, mip_filter, "cropped", 1e9)
    return maps, d[texel].view(N_CUBES, 3, 3)


def _measure_profile(
    maps: PartialMaps, centres: Tensor, cosines: NDArray[np.float64], level: int
) -> NDArray[np.float64]:
    """K_l at these cosines, (N_ANGLES,): the mean over texels and azimuths."""
    theta = torch.arccos(torch.tensor(cosines).clamp(-1, 1))[:, None]
    turns = torch.arange(N_AZIMUTHS)[None] * (2 * pi / N_AZIMUTHS)
    golden = torch.arange(len(cosines), dtype=torch.float64)[:, None] * 2.399963
    local = spherical(theta.expand(-1, N_AZIMUTHS), golden + turns)
    total = np.zeros(len(cosines))
    for cube in range(len(maps)):
        one = PartialMaps(maps.texels, maps.windows[:, 6 * cube : 6 * cube + 6], maps.sizes)
        n = Vec3(*centres[cube].double().T[:, :, None, None])
        aside = torch.nn.functional.one_hot(centres[cube].abs().argmin(1), 3).double()
        t = normalize(cross(n, Vec3(*aside.T[:, :, None, None])))
        d = to_world(local, t, cross(n, t), n)  # (3, N_ANGLES, N_AZIMUTHS)
        flat = Vec3(*(c.flatten().float() for c in d))
        radiance = lookup(one, flat, torch.full_like(flat.x, float(level))).view(3, len(cosines), -1, 3)
        total += sum(radiance[k, :, :, k].double().mean(1).numpy() for k in range(3))
    return total / (3 * len(maps))
