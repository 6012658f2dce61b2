"""The light of one block that a point reflects: a sum over Q x Q nodes, with an estimate of its error.

For a point and a block with edge h in face coordinates (blocks.py), g = h^2 f(wo, wi) cos_i J is evaluated at
Gauss-Legendre nodes, where J = (1 + s^2 + t^2)^(-3/2) is the solid angle per area of the face. The integral over the
block is the sum of L_jk g_jk over the coefficients of both. The sum leaves out what these polynomials do not represent,
and the coefficients have errors themselves, because higher degrees look like lower ones at the nodes. The last two
shells, of degrees Q - 2 and Q - 1, show how much that may be. With rho, the ratio by which the coefficients of g fall
from one degree to the next, the error is about

    (rho E + rho^(Q / 2) L_00 G) / (1 - rho),

where E^2 is the sum over both shells of (sum of L_jk g_jk in the shell)^2, and G^2 that of g_jk^2. For a smooth g and
an even light the second term would fall as rho^Q; a lobe in a corner of the block, between the nodes, needs more.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from glossbench.brdf.material import Reflectance
from glossbench.directions import Vec3, to_local
from glossbench.envmap.cubemap import face_axes
from glossbench.scene.points import ShadingPoints
from glossbench.shading.kernels import kernel
from glossbench.truth.blocks import ORDER, gauss, shells

# Values that shells of a degree below some order take, in the order of `shells`.
_BELOW = [degree * degree for degree in range(ORDER + 1)]
_ALIASING = ORDER // 2
STEEPEST, FLATTEST = 0.2, 0.9  # bounds of rho: a kink has 0.6, a step 0.85; luck may make any smaller


class Nodes(NamedTuple):
    """Coordinates (1, Q^2) of the nodes in a block, and the matrix (Q^2, Q^2) from values there to coefficients."""

    x: Tensor
    y: Tensor
    coefficients: Tensor


def nodes(device: str) -> Nodes:
    """The nodes of every block."""
    x, matrix = gauss()
    both = torch.kron(matrix, matrix)[shells()].T.contiguous()
    found = x.repeat(ORDER)[None], x.repeat_interleave(ORDER)[None], both
    return Nodes(*(each.float().to(device) for each in found))


@kernel("sum_by_moments")
def sum_by_moments(
    points: ShadingPoints,
    reflectance: Reflectance,
    grid: Nodes,
    size: Tensor,
    block: Tensor,
    row: Tensor,
    table: Tensor,
) -> Tensor:
    """Integral, its estimated error and the signed sum of the last shells for each pair of point and block: (P, 9).

    Args:
        size: h.
        block: face, s and t of the corner with the smallest s and t, (P, 3).
        row: rows (P, 1) of the table of moments.
    """
    g = _expand(points, reflectance, grid, size, block)
    moments = table[row[:, 0]]
    terms = g * moments
    before, last = (terms[:, _BELOW[-3 + k] : _BELOW[-2 + k]].sum(1) for k in (0, 1))
    rho, rest = _measure_decay(g)
    error = (torch.sqrt(before * before + last * last) * rho + moments[:, 0] * rest * rho**_ALIASING) / (1 - rho)
    return torch.cat([terms[:, : _BELOW[-3]].sum(1) + before + last, error, before + last], 1)


@kernel("sum_by_corners")
def sum_by_corners(
    points: ShadingPoints, reflectance: Reflectance, grid: Nodes, size: Tensor, block: Tensor, corners: Tensor
) -> Tensor:
    """As `sum_by_moments`, for blocks over which the light is bilinear.

    Args:
        corners: the light at the corners (-, -), (-, +), (+, -), (+, +), the sign of y first, (P, 12).
    """
    g = _expand(points, reflectance, grid, size, block)
    a, b, c, d = corners.unflatten(1, (4, 3)).unbind(1)
    mean = (a + b + c + d) / 4
    # Moments of x are the slope over sqrt(3), because x = p_1(x) / sqrt(3).
    x, y = (b + d - a - c) / (4 * 3**0.5), (c + d - a - b) / (4 * 3**0.5)
    total = g[:, 0] * mean + g[:, 1] * x + g[:, 2] * y + g[:, 3] * (a + d - b - c) / 12
    rho, rest = _measure_decay(g)
    error = mean * rest * (rho**_ALIASING / (1 - rho))
    return torch.cat([total, error, torch.zeros_like(error)], 1)


def _expand(points: ShadingPoints, reflectance: Reflectance, grid: Nodes, size: Tensor, block: Tensor) -> Tensor:
    """g_jk in the order of `shells`, (P, Q^2, 1 or 3)."""
    axes = face_axes(str(block.device)).to(block.dtype)[block[:, 0].long()]
    # The axes of the face in the frame of the point: two products per component and node are left.
    local = [to_local(Vec3(*(axes[:, k, c, None] for c in range(3))), points.t, points.b, points.n) for k in range(3)]
    s = block[:, 1, None] + size / 2 * (1 + grid.x)
    t = block[:, 2, None] + size / 2 * (1 + grid.y)
    inverse = torch.rsqrt(1 + s * s + t * t)
    wi = Vec3(*((n + s * right + t * down) * inverse for n, right, down in zip(*local, strict=True)))
    weight = torch.where(wi.z > 0, wi.z * (size * size) * _compute_jacobian(inverse), 0.0)
    values = [f * weight for f in reflectance.f(points.wo_local(), wi)]
    return torch.stack([value @ grid.coefficients for value in values], 2)


def _compute_jacobian(inverse: Tensor) -> Tensor:
    """J, from 1 / sqrt(1 + s^2 + t^2)."""
    return inverse * inverse * inverse


def _measure_decay(g: Tensor) -> tuple[Tensor, Tensor]:
    """rho, and the length of the coefficients of the last two shells: (P, 1) each."""
    squares = g.square().sum(2)
    before, last = (squares[:, _BELOW[-5 + 2 * k] : _BELOW[-3 + 2 * k]].sum(1, keepdim=True) for k in (0, 1))
    ratio = torch.sqrt(torch.sqrt(last / before.clamp(min=1e-36)))
    return ratio.clamp(STEEPEST, FLATTEST), torch.sqrt(last)
