"""A cube map as unknowns of linear equations: the rows that read its texels, and the Laplacian of its neighbours."""

import numpy as np
import torch
from scipy.sparse import csr_array
from torch import Tensor

from glossbench.prefilter import Vec3, add_border, face_coordinates, neighbour_laplacian, weight_rows


def cube_rows(d: Vec3, edge: int) -> csr_array:
    """Rows (S, 6 edge^2) of the seamless bilinear lookup in S directions, texels in the order (face, row, column).

    At a corner of the cube, the mean of the three texels stands for the fourth, as in `add_border`.
    """
    face, s, t, _ = face_coordinates(Vec3(*(c.double() for c in d)))
    # The border shifts texels by 1, their centres by 1/2.
    x, y = ((c * 0.5 + 0.5) * edge + 0.5 for c in (s, t))
    i, j = (c.long().clamp(0, edge) for c in (x, y))
    fx, fy = x - i, y - j
    stride = edge + 2
    first = (face.long() * stride + j) * stride + i
    taps = torch.stack([first, first + 1, first + stride, first + stride + 1], dim=1)
    weights = torch.stack([(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy], dim=1)
    rows = weight_rows(taps.numpy(), weights.numpy(), 6 * stride**2) @ _make_border_rows(edge)
    return csr_array(rows)


def cube_laplacian(edge: int) -> csr_array:
    """Laplacian (6 edge^2, 6 edge^2): 4 texel - sum of its four neighbours, also across the edges of the cube.

    Source: Latta and Kolb 2002, figure 1.
    """
    index = _index_border(edge)
    inner = index[:, 1:-1, 1:-1]
    beside = torch.stack([index[:, 1:-1, 2:], index[:, 2:, 1:-1], index[:, 1:-1, :-2], index[:, :-2, 1:-1]])
    pairs = torch.stack([inner.expand_as(beside).reshape(-1), beside.reshape(-1)], dim=1).numpy()
    return neighbour_laplacian(np.unique(np.sort(pairs, axis=1), axis=0), 6 * edge**2)


def _index_border(edge: int) -> Tensor:
    """The texel at each place of the bordered faces, (6, edge + 2, edge + 2); -1 outside a corner of the cube."""
    index = torch.arange(6 * edge * edge, dtype=torch.float64).view(6, edge, edge, 1)
    places = add_border(index)[..., 0].round().long()
    ends = torch.tensor([0, edge + 1])
    places[:, ends[:, None], ends[None, :]] = -1
    return places


def _make_border_rows(edge: int) -> csr_array:
    """Texels of the bordered faces from those of the cube, (6 (edge + 2)^2, 6 edge^2)."""
    index = _index_border(edge)
    taps, weights = index.reshape(-1, 1).repeat(1, 3), torch.tensor([1.0, 0, 0]).double().repeat(index.numel(), 1)
    last, stride = edge + 1, edge + 2
    for face in range(6):
        for row, inner_row in ((0, 1), (last, edge)):
            for column, inner_column in ((0, 1), (last, edge)):
                meeting = [(inner_row, inner_column), (row, inner_column), (inner_row, column)]
                place = (face * stride + row) * stride + column
                taps[place] = torch.stack([index[face, r, c] for r, c in meeting])
                weights[place] = 1 / 3
    return weight_rows(taps.numpy(), weights.numpy(), 6 * edge**2)
