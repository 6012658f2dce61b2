"""The light in blocks: its Legendre moments over the blocks of a quadtree on each face of the cube.

A face [-1, 1]^2 is divided into 2^l x 2^l blocks at level l. Over a block with coordinates x, y in [-1, 1] the light is
known by its moments

    L_jk = mean over the block of L(x, y) p_j(y) p_k(x),    p_j = sqrt(2 j + 1) P_j, j, k < Q,

where P_j are Legendre's polynomials. The bilinear interpolant of the texels has exact moments: each texel contributes a
hat function along each axis. A smooth function g with coefficients g_jk = mean of g p_j p_k then has

    mean of L g over the block = sum of L_jk g_jk,

up to the part of g that no polynomial of degree below Q represents. Blocks are numbered (face 2^l + row) 2^l + column.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import torch
from numpy.polynomial import legendre
from torch import Tensor

from glossbench.envmap.cubemap import CubeMap, add_border

ORDER = 6  # Q: nodes and moments along each axis of a block
MOMENTS = ORDER * ORDER
LARGEST_TABLE = 1 << 24  # numbers in the table of a level: finer levels are computed when they are asked for


@cache
def gauss() -> tuple[Tensor, Tensor]:
    """Gauss-Legendre nodes (Q,) in [-1, 1], float64, and the matrix (Q, Q) from values there to coefficients."""
    x, w = legendre.leggauss(ORDER)
    return torch.from_numpy(x), torch.from_numpy((_evaluate_polynomials(x) * w[:, None] / 2).T)


@cache
def shells() -> Tensor:
    """The pairs (j, k) as indices j Q + k, sorted by the larger of both: the last 2 Q - 1 have degree Q - 1."""
    j, k = torch.meshgrid(torch.arange(ORDER), torch.arange(ORDER), indexing="ij")
    return torch.argsort(torch.maximum(j, k).flatten(), stable=True)


@dataclass(frozen=True)
class LightBlocks:
    """Moments of a light.

    Attributes:
        texels: the faces with a border of one texel, (6, R + 2, R + 2, 3).
        tables: for each level from 0, the moments (6 4^l, Q^2, 3) of its blocks in the order of `shells`.
    """

    texels: Tensor
    tables: list[Tensor]

    @property
    def resolution(self) -> int:
        """R: texels along the edge of a face."""
        return self.texels.shape[1] - 2

    @property
    def finest_level(self) -> int:
        """From this level on a block lies between four texel centres, so that the light is bilinear over it."""
        return self.resolution.bit_length()

    def moments(self, level: int, block: Tensor) -> tuple[Tensor, Tensor]:
        """A table of moments (m, Q^2, 3), and its rows (n,) for blocks (n,) of a level below the finest."""
        if level < len(self.tables):
            return self.tables[level], block
        block, rows = block.unique(return_inverse=True)
        return self._compute(level, block), rows

    def _compute(self, level: int, block: Tensor) -> Tensor:
        n, size = 1 << level, self.resolution >> level
        face, row, column = block // (n * n), block // n % n, block % n
        step = torch.arange(size + 2, device=block.device)
        patch = self.texels[face[:, None, None], (row * size)[:, None, None] + step[:, None],
                            (column * size)[:, None, None] + step]  # fmt: skip
        hats = _integrate_hats(size).to(patch)
        found = torch.einsum("nyxc,yj,xk->njkc", patch, hats, hats)
        return found.flatten(1, 2)[:, shells().to(block.device)]

    def corners(self, level: int, block: Tensor) -> Tensor:
        """The light (n, 4, 3) at the corners of blocks of the finest level or beyond: (-, -), (-, +), (+, -), (+, +).

        The first sign is that of y.
        """
        n = 1 << level
        block, rows = block.unique(return_inverse=True)
        face, row, column = block // (n * n), block // n % n, block % n
        cell = n // self.resolution  # blocks along the edge of a texel
        found = []
        # In the bordered image, the centre of texel i lies at i + 1: the block begins at row / cell + 1/2.
        y0, x0 = ((2 * at + cell) // (2 * cell) for at in (row, column))
        fy, fx = (((2 * at + cell) % (2 * cell)).double() / (2 * cell) for at in (row, column))
        taps = [[self.texels[face, y0 + dy, x0 + dx].double() for dx in (0, 1)] for dy in (0, 1)]
        for down in (0, 1):
            for right in (0, 1):
                y, x = (fy + down / cell)[:, None], (fx + right / cell)[:, None]
                above = taps[0][0] * (1 - x) + taps[0][1] * x
                below = taps[1][0] * (1 - x) + taps[1][1] * x
                found.append(above * (1 - y) + below * y)
        return torch.stack(found, 1).to(self.texels)[rows]


def build_light_blocks(light: CubeMap) -> LightBlocks:
    """The blocks of a light: moments by texels at the finest level of the tables, coarser levels from four blocks."""
    texels = add_border(light.faces)
    r = light.resolution
    level = r.bit_length() - 1
    while level > 0 and 6 * 4**level * MOMENTS * 3 > LARGEST_TABLE:
        level -= 1
    size = r >> level
    hats = _integrate_hats(size).to(texels)
    rows = torch.einsum("fnxcy,yj->fnjxc", texels.unfold(1, size + 2, size), hats)
    found = torch.einsum("fnjmcx,xk->fnmjkc", rows.unfold(3, size + 2, size), hats)
    tables = [found]
    halves = _halve_polynomials().to(texels)
    while found.shape[1] > 1:
        n = found.shape[1] // 2
        found = found.view(6, n, 2, n, 2, ORDER, ORDER, 3)
        found = torch.einsum("fnamblic,ajl,bki->fnmjkc", found, halves, halves)
        tables.append(found)
    order = shells().to(texels.device)
    return LightBlocks(texels, [each.reshape(-1, MOMENTS, 3)[:, order].contiguous() for each in reversed(tables)])


def _evaluate_polynomials(x: np.ndarray) -> np.ndarray:
    """p_j(x), (n, Q)."""
    return legendre.legvander(x, ORDER - 1) * np.sqrt(2 * np.arange(ORDER) + 1)


@cache
def _integrate_hats(size: int) -> Tensor:
    """Mean over a block of `size` texels of each hat function times p_j, (size + 2, Q), float64.

    The hats belong to the texels of the block and to one beyond each end.
    """
    nodes, weights = legendre.leggauss(ORDER)
    found = np.zeros((size + 2, ORDER))
    # Half a texel at a time every hat is linear, so that the products are polynomials.
    for half in range(2 * size):
        u = half / 2 + (nodes + 1) / 4  # in texels from the begin of the block
        p = _evaluate_polynomials(2 * u / size - 1) * weights[:, None] / (4 * size)
        for i in range(size + 2):
            hat = np.clip(1 - np.abs(u - (i - 0.5)), 0, None)
            found[i] += hat @ p
    return torch.from_numpy(found)


@cache
def _halve_polynomials() -> Tensor:
    """(2, Q, Q), float64: coefficient l of half the p_j of a block in the p_l of its first and its second half."""
    nodes, weights = legendre.leggauss(ORDER)
    own = _evaluate_polynomials(nodes) * weights[:, None] / 2
    halves = [_evaluate_polynomials((nodes + side) / 2).T @ own / 2 for side in (-1, 1)]
    return torch.from_numpy(np.stack(halves))
