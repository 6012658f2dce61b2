"""The level of each paraboloid map that shows the lobe cos^s: maps of different pitch have different levels."""

from math import pi
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from glossbench.prefilter import N_ANGLES, N_AZIMUTHS, REACH, LobeFilter, LobeLevels, Volume, match_levels, window_taps

from .parabolic_maps import POLE, fill, find_level_windows, n_levels, n_texels


class MapLevels(NamedTuple):
    """Exponents along the levels of each map, for maps that differ."""

    maps: tuple[LobeLevels, ...]

    def level(self, s: float) -> NDArray[np.float64]:
        """The level of an exponent in each map, (N,)."""
        return np.array([levels.level(s) for levels in self.maps])


def calibrate_maps(pitch: Tensor, mip_filter: LobeFilter, volume: Volume = "solid_angle") -> MapLevels:
    """Levels of paraboloid maps of these pitches for every exponent: as `calibrate`, but for each map.

    K_l(theta) is the radiance of a map with one lit texel at its middle. On the plane, in units of texels, it is the
    same for all maps; they differ only in the angle that a texel spans.
    """
    lobes = _measure_plane_lobes(n_levels(pitch), mip_filter)
    radii = np.linspace(0, REACH, lobes.shape[1])

    def levels(pitch: float) -> LobeLevels:
        edges = pitch * 2.0 ** np.arange(len(lobes))

        def profile(level: int, cosines: NDArray[np.float64]) -> NDArray[np.float64]:
            near = np.maximum(1 + cosines, POLE)
            radius = np.sqrt((1 - cosines) / near) / edges[level]
            return np.interp(radius, radii, lobes[level], right=0.0) / near**2

        return match_levels(profile, 2 * edges, volume)

    return MapLevels(tuple(levels(p) for p in pitch.tolist()))


def _measure_plane_lobes(n: int, mip_filter: LobeFilter) -> NDArray[np.float64]:
    """Values of n levels of a plane with one lit texel at the origin, at radii from 0 to 6 texels, (n, 513)."""
    windows = find_level_windows(torch.tensor([[0, 0, 1, 1]]), n, mip_filter)
    texels = torch.zeros(n_texels(windows), 3)
    fill(texels, windows[:, 0], torch.ones(1, 1, 3), mip_filter)
    radius = torch.linspace(0, REACH, 4 * N_ANGLES - 3, dtype=torch.float64)[:, None]
    turn = torch.arange(4 * N_AZIMUTHS) * (pi / (2 * N_AZIMUTHS)) + radius * 2.399963
    lobes = []
    for level, window in enumerate(windows[:, 0]):
        at = 0.5 / 2**level - 0.5  # the middle of the lit texel
        rows, shares = window_taps(window, at + radius * turn.cos(), at + radius * turn.sin(), torch.ones(()))
        values = [texels[row.long(), 0] * share for row, share in zip(rows, shares, strict=True)]
        lobes.append(torch.stack(values).sum(0).mean(1).numpy())
    return np.stack(lobes)
