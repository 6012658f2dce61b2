"""A light under a round lobe as a sum over texels: P(R) = sum of w k(l . R) L(l) / sum of w k(l . R), w solid angles.

Two sums, with the same kernel. `sum_over_level` takes all texels of one level of a box pyramid. `sum_over_tree` takes
texels of all levels: for each tile of texels R, those that are small against the lobe and against their distance from
the tile, each at the centroid of its light. Both give the light itself where it is constant.
"""

from itertools import accumulate
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from glossbench.channels import LUMINANCE
from glossbench.directions import normalize, stack, vec3
from glossbench.envmap.cubemap import CubeMap, texel_directions, texel_solid_angles
from glossbench.envmap.pyramid import Pyramid
from glossbench.prefilter.round_lobes import RoundLobe
from glossbench.shading.kernels.backend import ready
from glossbench.shading.kernels.kernel import kernel

# A texel is summed whole if its edge is below OPENING times its distance, which counts from the lobe's own width on.
# Measured, spots of one texel and Grace, 256^2, alpha 0.05 to 0.8, against the sum over all texels of level 0.
OPENING = 0.25
COARSEST = 16  # edge of the cube whose texels are the largest that are summed: the horizon cuts those of coarser ones
TILE = 8  # texels along the edge of a tile
ROWS = 1 << 17  # texels R times texels of the light, at a time
EMPTY = 1e-30  # sum of weights below which no texel lies in the lobe


class Sources(NamedTuple):
    """Texels of the light that a sum takes: directions (S, 3); flux and solid angle (S, 4)."""

    d: Tensor
    values: Tensor


def sum_over_level(source: Pyramid, lobe: RoundLobe, edge: int, at: int) -> Tensor:
    """P at the texels of a cube of this edge, (6, edge, edge, 3): all texels of the level of edge `at` are summed."""
    faces = _level(source, at)
    w = texel_solid_angles(at).float().to(faces.device).expand(6, -1, -1)[..., None]
    d = stack(texel_directions(at)).to(faces.device).reshape(-1, 3)
    sources = Sources(d, torch.cat([faces * w, w], -1).reshape(-1, 4))
    r = stack(texel_directions(edge)).to(faces.device).reshape(-1, 3)
    step = max(2, ROWS // len(d))
    run = ready(_sum_texels, [r[:step], *sources, lobe], len(r) * len(d))
    with torch.no_grad():
        sums = torch.cat([run(rows, *sources, lobe) for rows in r.split(step)])
    return _divide(sums.view(6, edge, edge, 4), _level(source, edge))


def sum_over_tree(light: CubeMap, source: Pyramid, lobe: RoundLobe, edge: int, opening: float = OPENING) -> Tensor:
    """P at the texels of a cube of this edge, (6, edge, edge, 3), from texels of all levels of the light.

    A texel stays whole if its edge h <= opening sqrt(distance^2 + (2 alpha)^2), where distance is the smallest between
    it and the tile; 2 alpha is the scale on which a lobe of half vectors of width alpha changes.
    """
    levels = _pool(light)
    tile = min(TILE, edge)
    n = edge // tile
    centres = stack(texel_directions(n)).to(light.faces.device)
    r = stack(texel_directions(edge)).to(light.faces.device)
    tiles = r.view(6, n, tile, n, tile, 3).transpose(2, 3).reshape(6 * n * n, tile * tile, 3)
    radius = (tiles - centres.reshape(-1, 1, 3)).norm(dim=-1).amax(1)
    every = Sources(torch.cat([level.d for level in levels]), torch.cat([level.values for level in levels]))
    run = None
    sums: list[Tensor] = []
    with torch.no_grad():
        for face, within in zip(centres.reshape(6, -1, 3), radius.view(6, -1), strict=True):
            for rows, chosen in zip(
                tiles[len(sums) : len(sums) + n * n], _choose(levels, face, within, lobe, opening), strict=True
            ):
                arguments = [rows, every.d[chosen], every.values[chosen], lobe]
                run = run or ready(_sum_texels, arguments, r[..., 0].numel() * len(chosen))
                sums.append(run(*arguments))
    grid = torch.stack(sums).view(6, n, n, tile, tile, 4).transpose(2, 3).reshape(6, edge, edge, 4)
    return _divide(grid, _level(source, edge))


@kernel("texel_sums")
def _sum_texels(r: Tensor, d: Tensor, values: Tensor, lobe: RoundLobe) -> Tensor:
    """Sum over texels of the lobe's value times (w L, w), (R, 4)."""
    return lobe.value(1 - r @ d.T) @ values


def _level(source: Pyramid, edge: int) -> Tensor:
    return source.level(source.sizes.tolist().index(edge))


def _divide(sums: Tensor, unfiltered: Tensor) -> Tensor:
    """The mean radiance; where the lobe is so narrow that it misses all centres of texels, the light unfiltered."""
    return torch.where(sums[..., 3:] > EMPTY, sums[..., :3] / sums[..., 3:].clamp(min=EMPTY), unfiltered)


def _pool(light: CubeMap) -> list[Sources]:
    """Texels of all levels from the finest to the coarsest that is summed, each with the sums of its quarters.

    The direction of a texel is the centroid of its light, so that what is bright in it stays in its place.
    """
    faces = light.faces
    w = texel_solid_angles(light.resolution).float().to(faces.device).expand(6, -1, -1)[..., None]
    d = stack(texel_directions(light.resolution)).to(faces.device)
    luminance = faces @ faces.new_tensor(LUMINANCE)
    # A share of the mean keeps the centroid of a black texel in its middle.
    mass = w * (luminance + 1e-6 * luminance.mean() + EMPTY)[..., None]
    table = torch.cat([faces * w, w, d * mass, mass], -1).permute(0, 3, 1, 2)
    levels = []
    while True:
        rows = table.permute(0, 2, 3, 1).reshape(-1, 8)
        levels.append(Sources(stack(normalize(vec3(rows[:, 4:7]))), rows[:, :4]))
        if table.shape[-1] <= min(COARSEST, light.resolution):
            return levels
        table = 4 * avg_pool2d(table, 2)


def _choose(levels: list[Sources], centres: Tensor, radius: Tensor, lobe: RoundLobe, opening: float) -> list[Tensor]:
    """For each tile of one face, the numbers of the texels to sum, in the concatenated levels."""
    starts = [0, *accumulate(len(each.d) for each in levels)]
    n_tiles, coarsest = len(centres), len(levels[-1].d)
    tile = torch.arange(n_tiles, device=centres.device).repeat_interleave(coarsest)
    texel = torch.arange(coarsest, device=centres.device).repeat(n_tiles)
    kept: list[tuple[Tensor, Tensor]] = []
    for level in range(len(levels) - 1, -1, -1):
        n = round((len(levels[level].d) / 6) ** 0.5)
        h = 2 / n
        gap = (levels[level].d[texel] - centres[tile]).norm(dim=1) - radius[tile] - h / 2**0.5
        whole = h <= opening * torch.sqrt(gap.clamp(min=0) ** 2 + (2 * lobe.alpha) ** 2)
        if level == 0:
            whole = torch.ones_like(whole)
        above = gap < 2**0.5  # the distance of the horizon
        kept.append((tile[whole & above], texel[whole & above] + starts[level]))
        tile, texel = _quarter(tile[above & ~whole], texel[above & ~whole], n)
    tile, texel = (torch.cat(part) for part in zip(*kept, strict=True))
    order = torch.argsort(tile, stable=True)
    return list(texel[order].split(torch.bincount(tile, minlength=n_tiles).tolist()))


def _quarter(tile: Tensor, texel: Tensor, n: int) -> tuple[Tensor, Tensor]:
    """Each pair of a tile and a texel of a cube of edge n as four pairs with the texels of the next level."""
    row, column = texel // n, texel % n  # the rows of all faces, one below the other
    part = torch.arange(4, device=texel.device)
    finer = (2 * row[:, None] + part // 2) * (2 * n) + 2 * column[:, None] + part % 2
    return tile.repeat_interleave(4), finer.flatten()
