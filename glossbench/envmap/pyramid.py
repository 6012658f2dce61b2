"""MIP pyramids of a cube, and the trilinear lookup without seams.

All levels lie in one flat table of texels. Each face has a one-texel border from its neighbours, so a lookup is eight
rows of the table and eight weights, without a branch. Level l has R / 2^l texels along an edge.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import torch
from jaxtyping import Float, Int, Int32
from torch import Tensor
from torch.nn.functional import embedding_bag

from glossbench.channels import Channels, merge_channels
from glossbench.directions import Vec3
from glossbench.envmap.cubemap import CubeMap, add_border, face_coordinates
from glossbench.shapes import Directions, Faces, PointDirections, Radiance, Texels, Values

Taps = tuple[tuple[Int[Tensor, "*#pairs"], ...], tuple[Values, ...]]  # rows of a table of texels, and their weights


class Environment(Protocol):
    """Texels at several resolutions, and the texels that a direction reads."""

    @property
    def texels(self) -> Texels:
        """All texels, level by level."""

    def taps(self, d: Directions, lod: Values | None) -> Taps:
        """K rows of `texels`, int32, and their K weights for unit directions.

        lod: level, for trilinear interpolation, clamped to the existing levels; None reads only level 0.
        """

    def log2_texels_per_sr(self, d: Directions) -> Values:
        """log2 of the number of level-0 texels per steradian around a unit direction."""


@dataclass(frozen=True)
class MipTable:
    """Square images at several resolutions in one flat table.

    Attributes:
        texels: level by level, image by image, rows with a one-texel border.
        offsets: first row of each level.
        sizes: texels along an edge without border of each level.
    """

    texels: Texels
    offsets: Int32[Tensor, "levels"]
    sizes: Int32[Tensor, "levels"]

    def bilinear(self, image: Int[Tensor, "*#pairs"], s: Values, t: Values, lod: Values | None) -> Taps:
        """Rows and weights at image coordinates s (right), t (down) in [0, 1].

        There are eight, bilinear in two levels and linear between them; or four of level 0 if lod is None.
        """
        if lod is None:
            pairs = [(torch.zeros_like(image), torch.ones_like(s))]
        else:
            top = self.sizes.shape[0] - 1
            lod = lod.clamp(0, top)
            lower = lod.int()
            fraction = lod - lower
            pairs = [(lower, 1 - fraction), ((lower + 1).clamp(max=top), fraction)]
        rows, weights = [], []
        for level, share in pairs:
            size = self.sizes[level]
            # The border shifts texels by 1, centres are shifted by 1/2: x = s n - 1/2 + 1.
            x, y = s * size + 0.5, t * size + 0.5
            i, j = x.int(), y.int()
            fx, fy = x - i, (y - j) * share
            stride = size + 2
            first = self.offsets[level] + (image * stride + j) * stride + i
            rows += [first, first + 1, first + stride, first + stride + 1]
            right, below, corner = fx * (share - fy), fy * (1 - fx), fx * fy
            weights += [share - fy - right, right, below, corner]
        return tuple(rows), tuple(weights)


@dataclass(frozen=True)
class Pyramid(MipTable):
    """A cube at every power of two up to its own resolution; the six images are its faces."""

    def level(self, level: int) -> Faces:
        """Faces of one level without borders."""
        start, n = int(self.offsets[level]), int(self.sizes[level])
        return self.texels[start : start + 6 * (n + 2) ** 2].view(6, n + 2, n + 2, 3)[:, 1:-1, 1:-1]

    def taps(self, d: Directions, lod: Values | None) -> Taps:
        """Rows and weights for unit directions; without seams, because borders hold the texels of neighbours."""
        face, s, t, _ = face_coordinates(d)
        return self.bilinear(face, s * 0.5 + 0.5, t * 0.5 + 0.5, lod)

    def log2_texels_per_sr(self, d: Directions) -> Values:
        """log2(R^2 / (4 major^3)): a texel has area 4 / R^2 on the face [-1, 1]^2 and subtends 4 major^3 / R^2."""
        major = torch.maximum(torch.maximum(d.x.abs(), d.y.abs()), d.z.abs())
        return 2 * torch.log2(self.sizes[0].float()) - 2 - 3 * torch.log2(major)


def finest(light: CubeMap) -> Pyramid:
    """The light itself as a pyramid of one level."""
    sizes = torch.tensor([light.resolution], dtype=torch.int32, device=light.faces.device)
    return Pyramid(add_border(light.faces).reshape(-1, 3), torch.zeros_like(sizes), sizes)


def join_levels(levels: Sequence[Tensor]) -> Pyramid:
    """A pyramid of given faces (6, R_l, R_l, 3), of any sizes, from fine to coarse."""
    sizes = [faces.shape[1] for faces in levels]
    offsets = [sum(6 * (n + 2) ** 2 for n in sizes[:level]) for level in range(len(sizes))]
    starts, edges = torch.tensor([offsets, sizes], dtype=torch.int32, device=levels[0].device)
    return Pyramid(torch.cat([add_border(faces).reshape(-1, 3) for faces in levels]), starts, edges)


def weighted_radiance(environment: Environment, d: Directions, lod: Values | None, weight: Channels) -> Radiance:
    """Sum over samples of weight * L(d, lod), from directions, levels and weights (P, N).

    A grey weight takes one fused gather and sum without temporaries, a coloured weight one per channel.
    """
    rows, shares = environment.taps(d, lod)
    table = torch.stack(rows, dim=-2).flatten(1)
    sums = [
        # Each tap is weighted before the stack: the fused loop over the stacked table would not be vectorised.
        embedding_bag(
            table,
            environment.texels,
            per_sample_weights=torch.stack([share * w for share in shares], dim=-2).flatten(1),
            mode="sum",
        )
        for w in weight
    ]
    return merge_channels(sums)


def lookup(environment: Environment, d: PointDirections, lod: Float[Tensor, "points"] | None = None) -> Radiance:
    """Radiance for directions and levels."""
    column = Vec3(*(c[:, None] for c in d))
    return weighted_radiance(environment, column, None if lod is None else lod[:, None], (torch.ones_like(column.x),))
