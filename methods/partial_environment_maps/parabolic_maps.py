"""Parabolic storage of partial environment maps: each region in a paraboloid map about its own direction.

The paraboloid about a shows the direction d at p = (d.t, d.b) / (1 + d.a), on a plane where a is the origin, directions
at 90 degrees from a are the unit circle, and -a is infinitely far. An area dA at radius r spans the solid angle
4 / (1 + r^2)^2 dA = (1 + d.a)^2 dA. A map stores energy per unit of area, L (1 + d.a)^2, so that filters whose weights
sum to one keep its energy.
"""

from dataclasses import dataclass
from math import ceil, log2

import torch
from torch import Tensor
from torch.nn.functional import one_hot, pad

from glossbench.prefilter import (
    LOBE_FILTERS,
    TEXEL_BYTES,
    CubeMap,
    InputError,
    LobeFilter,
    Partition,
    Pyramid,
    Taps,
    Vec3,
    add_border,
    cross,
    dot,
    finest,
    halve,
    normalize,
    stack,
    texel_directions,
    to_local,
    to_world,
    vec3,
    window_taps,
)

Frame = tuple[Vec3, Vec3, Vec3]

COARSEST = 1.0  # least pitch of the last level: its lobe is wider than that of s = 1 for every filter
LARGEST = 2.0  # largest r of a region's texels, 127 degrees; a rectangle of one face ends at sqrt(2)
POLE = 1e-3  # 1 + d.a; below it, within 2.6 degrees of -a, everything is black
MARGIN = 2  # texels of a map around the centres of its region: one texel of the cube spans less than two of them


@dataclass(frozen=True)
class ParabolicMaps:
    """N paraboloid maps with equal numbers of levels. Each level stores the rectangle that its region reaches.

    Texel (j, i) of level l lies at p = ((i + 1/2), (j + 1/2)) 2^l pitch, i and j of either sign.

    Attributes:
        texels: (T, 3) float32, row 0 black: L (1 + d.a)^2.
        windows: (L, N, 5) int32: row and column of the first texel, height, width, first row in `texels`.
        pitch: edge of a texel of level 0 on the plane, (N,).
        t, b, a: the frame of each map, components (1, N).
    """

    texels: Tensor
    windows: Tensor
    pitch: Tensor
    t: Vec3
    b: Vec3
    a: Vec3

    def __len__(self) -> int:
        return self.windows.shape[1]

    def taps(self, d: Vec3, lod: Tensor | None) -> Taps:
        """Eight rows and weights, (P, N), one column per map, for unit directions (P, 1); trilinear.

        lod: level, which broadcasts with (P, N), clamped to the existing levels; None reads only level 0.
        """
        local = to_local(d, self.t, self.b, self.a)
        near = (1 + local.z).clamp(min=POLE)
        radiance = torch.where(1 + local.z > POLE, 1 / (near * near), 0.0)
        image = torch.arange(len(self), device=near.device)
        top = self.windows.shape[0] - 1
        lod = torch.zeros_like(self.pitch) if lod is None else lod.clamp(0, top)
        lower = lod.long()
        fraction = lod - lower
        rows, weights = [], []
        for level, share in ((lower, 1 - fraction), ((lower + 1).clamp(max=top), fraction)):
            scale = torch.exp2(-level) / (self.pitch * near)
            x, y = local.x * scale - 0.5, local.y * scale - 0.5
            found = window_taps(self.windows[level, image], x, y, share * radiance)
            rows += found[0]
            weights += found[1]
        return tuple(rows), tuple(weights)

    def log2_texels_per_sr(self, d: Vec3) -> Tensor:
        """-log2(pitch^2 (1 + d.a)^2)."""
        return -2 * torch.log2(self.pitch * (1 + dot(d, self.a)).clamp(min=POLE))


def compute_pitches(partition: Partition) -> Tensor:
    """Edge length of a texel of each map (N,): at the middle of the map it spans a mean texel of the region.

    4 pitch^2 = solid angle of the region / its number of texels
    """
    count = torch.bincount(partition.index.flatten(), minlength=len(partition))
    return 0.5 * torch.sqrt(partition.solid_angle / count)


def n_levels(pitch: Tensor) -> int:
    """Number of levels from the smallest of these pitches up to `COARSEST`."""
    return 1 + max(0, ceil(log2(COARSEST / float(pitch.min()))))


def build_parabolic_maps(light: CubeMap, partition: Partition, mip_filter: LobeFilter, limit: float) -> ParabolicMaps:
    """The maps of all regions of a light, with all levels.

    The cube is black except in the region. A texel of level 0 is the mean of bilinear lookups of this cube at its 2x2
    sub-texel centres. Each map is then scaled, with one factor per channel, so that its energy is that of the region.

    Args:
        limit: bytes that the table may take.

    Raises:
        InputError: the table would take more, or a region extends more than 127 degrees from its direction. This is
            raised before the table is allocated.

    Source: Knuth et al. 2014, section 5. Differs: energy is filtered, not radiance, because coarse levels of radiance
    lose energy.
    """
    pitch, n = compute_pitches(partition), len(partition)
    frames = _make_frames(partition.direction)
    windows = find_level_windows(_find_spans(light, partition, frames, pitch), n_levels(pitch), mip_filter)
    needed = TEXEL_BYTES * n_texels(windows)
    if needed > limit:
        raise InputError(
            f"{n} parabolic partial maps of 6 x {light.resolution}^2 texels need {needed / 1e9:.2f} GB, more than the "
            f"limit of {limit / 1e9:.2f} GB; use fewer regions or a smaller light"
        )
    texels = light.faces.new_empty(n_texels(windows), 3)
    texels[0] = 0
    cube, owner = finest(light), _find_owners(partition)
    for i in range(n):
        t, b, a = (Vec3(*(c[i] for c in v)) for v in frames)
        image = _build_level_0(cube, owner == i, (t, b, a), pitch[i], windows[0, i])
        energy = image.double().sum((0, 1)) * pitch[i].double() ** 2
        factor = torch.where(energy > 0, partition.power[i] / energy, 1.0).float()
        fill(texels, windows[:, i], image * factor, mip_filter)
    return ParabolicMaps(texels, windows.int().to(pitch.device), pitch, *(Vec3(*(c[None] for c in v)) for v in frames))


def find_level_windows(spans: Tensor, n: int, mip_filter: LobeFilter) -> Tensor:
    """The windows of maps at each of n levels, (n, N, 5), from the spans of their level 0, (N, 4).

    A span is the first lit row and column of texels, and the last ones + 1. Texel j of a level has the taps
    2 j - w .. 2 j + 1 + w of the finer level.
    """
    width = len(LOBE_FILTERS[mip_filter]) // 2 - 1
    levels = [spans.cpu()]
    for _ in range(n - 1):
        low, high = levels[-1].split(2, dim=1)
        levels.append(torch.cat([(low - width) // 2, (high - 1 + width) // 2 + 1], dim=1))
    low, high = torch.stack(levels).split(2, dim=2)
    counts = (high - low).prod(2)
    first = 1 + counts.flatten().cumsum(0).view_as(counts) - counts
    return torch.cat([low, high - low, first[..., None]], dim=2)


def n_texels(windows: Tensor) -> int:
    """Number of rows in the table of these windows, including the black one."""
    return 1 + int((windows[..., 2] * windows[..., 3]).sum())


def fill(texels: Tensor, windows: Tensor, image: Tensor, mip_filter: LobeFilter) -> None:
    """Write the levels of one map, windows (L, 5), whose level 0 is an image (height, width, 3), into a table."""
    taps = LOBE_FILTERS[mip_filter]
    width = len(taps) // 2 - 1
    finer = None
    for window in windows.tolist():
        if finer:
            margins: list[int] = []  # texels around the finer level that the taps read: left, right, top, bottom
            for axis in (1, 0):
                before = finer[axis] - (2 * window[axis] - width)
                margins += before, 2 * (window[2 + axis] + width) - finer[2 + axis] - before
            image = halve(pad(image, (0, 0, *margins))[None], taps)[0]
        first = window[4]
        texels[first : first + image.shape[0] * image.shape[1]] = image.reshape(-1, 3)
        finer = window


def _make_frames(a: Vec3) -> Frame:
    """t, b and a (N,): t and b follow the edges of the face that a meets, made normal to a."""
    aside = one_hot(stack(a).abs().argmin(1), 3).float()
    t = normalize(cross(vec3(aside), a))
    return t, cross(a, t), a


def _find_spans(light: CubeMap, partition: Partition, frames: Frame, pitch: Tensor) -> Tensor:
    """First row and column, and last row and column + 1, of each region in its map at level 0, (N, 4)."""
    index = partition.index.flatten().long()
    d = Vec3(*(c.flatten().to(index.device) for c in texel_directions(light.resolution)))
    local = to_local(d, *(Vec3(*(c[index] for c in v)) for v in frames))
    p = torch.stack([local.y, local.x], dim=1) / (1 + local.z).clamp(min=1e-6)[:, None]
    farthest = float(p.norm(dim=1).max())
    if farthest > LARGEST:
        raise InputError(
            f"a parabolic map can hold a region up to {LARGEST:g} on its plane (127 degrees) from its direction; "
            f"a region of this light reaches {min(farthest, 1e6):.3g}"
        )
    at, where = p / pitch[index][:, None], index[:, None].expand(-1, 2)
    empty = at.new_zeros(len(partition), 2)
    low, high = (empty.scatter_reduce(0, where, at, kind, include_self=False) for kind in ("amin", "amax"))
    return torch.cat([low.floor().long() - MARGIN, high.ceil().long() + MARGIN], dim=1)


def _find_owners(partition: Partition) -> Tensor:
    """The region of each row of a cube's table; -1 for the rows outside a corner of the cube."""
    owner = add_border(partition.index[..., None].float())[..., 0]
    owner[:, [0, 0, -1, -1], [0, -1, 0, -1]] = -1
    return owner.flatten()


def _build_level_0(cube: Pyramid, member: Tensor, frame: Frame, pitch: Tensor, window: Tensor) -> Tensor:
    """Means over 2x2 of L (1 + d.a)^2, for a cube whose rows are black except the members: (height, width, 3)."""
    top, left, height, width, _ = window.tolist()
    y, x = (
        (torch.arange(2 * first, 2 * (first + n), device=pitch.device) + 0.5) * (pitch / 2)
        for first, n in ((top, height), (left, width))
    )
    y, x = torch.meshgrid(y, x, indexing="ij")
    # 1 + d.a = 2 / (1 + r^2), and the part of d normal to a is p (1 + d.a).
    near = 2 / (1 + x * x + y * y)
    rows, weights = cube.taps(to_world(Vec3(x * near, y * near, near - 1), *frame), None)
    weights = tuple(weight * member[row] * near * near for row, weight in zip(rows, weights, strict=True))
    taps = [cube.texels[row] * weight[..., None] for row, weight in zip(rows, weights, strict=True)]
    energy = taps[0] + taps[1] + taps[2] + taps[3]
    return energy.view(height, 2, width, 2, 3).mean(dim=(1, 3))
