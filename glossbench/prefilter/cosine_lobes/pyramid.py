"""Partial environment maps: N cubes, each lit by only one region, filtered level by level into cosine lobes.

Most texels of such a cube are black. For each face and level a window is stored: the whole face, or the smallest
rectangle around the lit texels. All windows are in one flat table whose row 0 is black.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import max_pool2d

from glossbench.directions import Vec3
from glossbench.envmap.cubemap import add_border, face_coordinates
from glossbench.envmap.pyramid import Taps
from glossbench.errors import InputError
from glossbench.prefilter.pyramids import halve

LobeFilter = Literal["none", "box", "gauss", "cosine", "sqrt_cosine"]
Storage = Literal["cube", "cropped"]

_COSINES = np.cos(np.radians([-60, -30, 0, 30, 60]))
# One row of each separable 5-tap filter, which is applied before each 2x2 mean.
FIVE_TAPS: dict[LobeFilter, tuple[float, ...]] = {
    "none": (1.0,),
    "box": (1.0, 1.0, 1.0, 1.0, 1.0),
    "gauss": (1.0, 4.0, 6.0, 4.0, 1.0),
    "cosine": tuple(_COSINES),
    "sqrt_cosine": tuple(np.sqrt(_COSINES)),
}
# The 5 taps and the mean of two in one pass at every second texel. For "gauss" they are the six of a Gauss 6x6 pyramid.
LOBE_FILTERS: dict[LobeFilter, tuple[float, ...]] = {
    name: tuple(np.convolve(taps, (1, 1)).tolist()) for name, taps in FIVE_TAPS.items()
}
# Bytes of the cubes that are filtered in one pass. Measured, 256^2 and 64 regions: 4 MiB takes a quarter more time than
# 32 or 128 MiB.
BATCH_BYTES = 1 << 25
TEXEL_BYTES = 12  # three float32


@dataclass(frozen=True)
class PartialMaps:
    """N cubes with levels at every power of two up to their own resolution.

    Attributes:
        texels: (T, 3) float32, row 0 black.
        windows: (L, 6 N, 5) int32: row and column of the first texel in the bordered face, height, width, first row
            in `texels`. The index of a face of cube i is 6 i + face.
        sizes: texels along an edge of each level, without the border, (L,), int32.
    """

    texels: Tensor
    windows: Tensor
    sizes: Tensor

    def __len__(self) -> int:
        return self.windows.shape[1] // 6

    def taps(self, d: Vec3, lod: Tensor | None) -> Taps:
        """Eight rows and weights, (P, N), one column per cube, for unit directions (P, 1); trilinear and seamless.

        lod: level, (P, 1) or (1, 1), clamped to the existing levels; None reads only level 0.
        """
        face, s, t, _ = face_coordinates(d)
        image = face.long() + 6 * torch.arange(len(self), device=s.device)
        top = self.sizes.shape[0] - 1
        lod = torch.zeros_like(s) if lod is None else lod.clamp(0, top)
        lower = lod.long()
        fraction = lod - lower
        rows, weights = [], []
        for level, share in ((lower, 1 - fraction), ((lower + 1).clamp(max=top), fraction)):
            size = self.sizes[level]
            # The border shifts texels by 1, their centres by 1/2: x = s n - 1/2 + 1.
            x, y = (s * 0.5 + 0.5) * size + 0.5, (t * 0.5 + 0.5) * size + 0.5
            found = window_taps(self.windows[level, image], x, y, share)
            rows += found[0]
            weights += found[1]
        return tuple(rows), tuple(weights)

    def log2_texels_per_sr(self, d: Vec3) -> Tensor:
        """log2(R^2 / (4 major^3)), as for every cube."""
        major = torch.maximum(torch.maximum(d.x.abs(), d.y.abs()), d.z.abs())
        return 2 * torch.log2(self.sizes[0].float()) - 2 - 3 * torch.log2(major)


def window_taps(window: Tensor, x: Tensor, y: Tensor, share: Tensor) -> tuple[list[Tensor], list[Tensor]]:
    """Four rows of a table and weights of the texels around x (column) and y (row), bilinear; row 0 outside a window.

    Args:
        window: (.., 5) first row, first column, height, width, first row in the table.
        share: factor of the weights.
    """
    first_row, first_column, height, width, first = window.unbind(-1)
    left, top = x.floor(), y.floor()
    i, j = left.int() - first_column, top.int() - first_row
    fx, fy = x - left, y - top
    rows, weights = [], []
    for below, row_share in ((0, 1 - fy), (1, fy)):
        for right, column_share in ((0, 1 - fx), (1, fx)):
            row, column = j + below, i + right
            inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
            rows.append(torch.where(inside, first + row * width + column, 0).int())
            weights.append((row_share * column_share * share).expand(inside.shape))
    return rows, weights


def cube_bytes(resolution: int, n_maps: int) -> int:
    """Bytes of N whole cubes of R texels per edge, with all their levels and borders."""
    return TEXEL_BYTES * (1 + 6 * n_maps * sum((n + 2) ** 2 for n in _list_sizes(resolution)))


def build_partial_maps(
    faces: Tensor, index: Tensor, n_maps: int, mip_filter: LobeFilter, storage: Storage, limit: float
) -> PartialMaps:
    """The cubes of a light (6, R, R, 3), with all levels; cube i is black except where `index` (6, R, R) is i.

    Each level is the finer one after the 5-tap filter and the mean of 2x2, also across edges (section 3.2 and figure
    2). All texels have the same weight, not their solid angle. All steps are linear: the sum of the cubes is the
    pyramid of the light.

    Args:
        limit: bytes that the table may take.

    Raises:
        InputError: the table would take more. This is raised before it is allocated.

    Source: Knuth et al. 2014, sections 3.1, 3.2 and 4.
    """
    resolution, needed = faces.shape[1], cube_bytes(faces.shape[1], n_maps)
    if storage == "cube" and needed > limit:
        raise InputError(
            f"{n_maps} partial maps of 6 x {resolution}^2 texels as cubes need {needed / 1e9:.2f} GB, more than the "
            f"limit of {limit / 1e9:.2f} GB; use fewer regions, a smaller light or storage: cropped"
        )
    sizes = _list_sizes(resolution)
    windows = torch.zeros(len(sizes), n_maps, 6, 5, dtype=torch.int32, device=faces.device)
    black = faces.new_zeros(1, 3)
    table = faces.new_empty(needed // TEXEL_BYTES, 3) if storage == "cube" else black
    table[0] = 0
    parts, used = [black], 1
    batch = max(1, BATCH_BYTES // (TEXEL_BYTES * 6 * (resolution + 4) ** 2))
    for start in range(0, n_maps, batch):
        n = min(batch, n_maps - start)
        for level, (images, lit) in enumerate(_build_levels(faces, index - start, n, LOBE_FILTERS[mip_filter])):
            window = _find_lit_windows(images, lit) if storage == "cropped" else _make_whole_windows(images)
            counts = (window[..., 2] * window[..., 3]).flatten()
            n_texels = int(counts.sum())
            if TEXEL_BYTES * (used + n_texels) > limit:
                raise InputError(
                    f"{n_maps} cropped partial maps of 6 x {resolution}^2 texels need more than the limit of "
                    f"{limit / 1e9:.2f} GB; use fewer regions or a smaller light"
                )
            window[..., 4] = (counts.cumsum(0) - counts + used).view(-1, 6)
            windows[level, start : start + n] = window.int()
            if storage == "cube":
                shape = (n, 6, *images.shape[1:3], 3)
                table[used : used + n_texels].view(shape).copy_(images.permute(3, 0, 1, 2, 4))
            else:
                parts.append(images.permute(3, 0, 1, 2, 4)[_make_mask(window, images.shape[1])])
            used += n_texels
    texels = table if storage == "cube" else torch.cat(parts)
    return PartialMaps(texels, windows.flatten(1, 2), torch.tensor(sizes, dtype=torch.int32, device=faces.device))


def _list_sizes(resolution: int) -> list[int]:
    return [resolution >> level for level in range(resolution.bit_length())]


def _build_levels(
    faces: Tensor, index: Tensor, n_maps: int, taps: tuple[float, ...]
) -> Iterator[tuple[Tensor, Tensor]]:
    """The maps 0 to B - 1, level by level: bordered faces (6, n + 2, n + 2, B, 3), and a mask of the texels (.., 1).

    The mask is above 0 where any of the maps may be lit.
    """
    images = faces.new_zeros(*faces.shape[:3], n_maps, 3)
    member = (index >= 0) & (index < n_maps)
    images.flatten(0, 2)[member.flatten().nonzero()[:, 0], index[member].long()] = faces[member]
    images, lit = images.flatten(3), member[..., None].float()
    width = len(taps) // 2 - 1
    while True:
        n = images.shape[1]
        # The same border is used for the filter and the table.
        margin = max(width, 1) if n > 1 else 1
        padded, padded_lit = add_border(images, margin), add_border(lit, margin)
        inner = slice(margin - 1, n + margin + 1)
        yield padded[:, inner, inner].unflatten(3, (-1, 3)), padded_lit[:, inner, inner]
        if n == 1:
            return
        if margin > width:
            padded, padded_lit = images, lit
        images, lit = _halve(padded, padded_lit, taps), _halve_mask(padded_lit, len(taps))


def _halve(padded: Tensor, lit: Tensor, taps: tuple[float, ...]) -> Tensor:
    """As `halve`, but computed only around the lit rows and columns of each face."""
    n = (padded.shape[1] - len(taps) + 2) // 2
    out = padded.new_zeros(6, n, n, padded.shape[3])
    for face, extent in enumerate(_find_extents(lit)):
        if extent is None:
            continue
        # Coarse texels whose taps 2 j .. 2 j + n_taps - 1 include a lit texel.
        rows, columns = ((max(0, (a - len(taps) + 2) // 2), min(n, (b - 1) // 2 + 1)) for a, b in extent)
        source = tuple(slice(2 * a, 2 * (b - 1) + len(taps)) for a, b in (rows, columns))
        out[face, slice(*rows), slice(*columns)] = halve(padded[face : face + 1, source[0], source[1]], taps)[0]
    return out


def _halve_mask(padded: Tensor, n_taps: int) -> Tensor:
    """The mask (6, n, n, 1) of texels that read a lit texel."""
    return max_pool2d(padded.permute(0, 3, 1, 2), n_taps, 2).permute(0, 2, 3, 1)


def _find_extents(lit: Tensor) -> list[tuple[tuple[int, int], ...] | None]:
    """For each face (6, n, n, 1), the rows and columns [first, last) that contain all lit texels; None without any."""
    extents: list[tuple[tuple[int, int], ...] | None] = []
    for face in (lit[..., 0] > 0).cpu().numpy():
        ends = [np.flatnonzero(face.any(axis)) for axis in (1, 0)]
        extents.append(tuple((int(at[0]), int(at[-1]) + 1) for at in ends) if ends[0].size else None)
    return extents


def _make_whole_windows(images: Tensor) -> Tensor:
    """Windows (B, 6, 5) of whole faces."""
    size = images.shape[1]
    window = torch.tensor([0, 0, size, size, 0], device=images.device)
    return window.expand(images.shape[3], 6, 5).clone()


def _find_lit_windows(images: Tensor, lit: Tensor) -> Tensor:
    """Windows (B, 6, 5) around the lit texels of each face; height and width are 0 if there are none."""
    windows = torch.zeros(images.shape[3], 6, 5, dtype=torch.int64, device=images.device)
    for face, extent in enumerate(_find_extents(lit)):
        if extent is None:
            continue
        part = images[face, slice(*extent[0]), slice(*extent[1])]
        for axis, (start, _) in enumerate(extent):
            along = (part.amax(1 - axis).amax(-1) > 0).int()  # (length, B)
            some, first = along.any(0), along.argmax(0)
            windows[:, face, axis] = torch.where(some, start + first, 0)
            windows[:, face, 2 + axis] = torch.where(some, len(along) - along.flip(0).argmax(0) - first, 0)
    return windows


def _make_mask(window: Tensor, size: int) -> Tensor:
    """True (B, 6, size, size) inside windows (B, 6, 5)."""
    at = torch.arange(size, device=window.device)
    row, column, height, width, _ = (v[..., None] for v in window.unbind(-1))
    rows, columns = (at >= row) & (at < row + height), (at >= column) & (at < column + width)
    return rows[..., :, None] & columns[..., None, :]
