"""Factors of the lighting function: Lo(v, n) ~ product of cube maps t_j, each read in a direction made of v and n.

    normal t(n), reflection t(2 (n . v) n - v), view t(v); half t(h), difference t(d): with the dominant direction
    l of the light, h is (l + v) / |l + v| and d is l, both in the frame (t(n), b, n) of the surface.

Source: Latta and Kolb 2002, sections 3.1, 3.2 and 4, eq. 6 to 8.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from glossbench.prefilter import (
    LUMINANCE,
    CubeMap,
    FactorMap,
    Floats,
    LightingSamples,
    Solver,
    Vec3,
    average_start,
    cross,
    factorize,
    normalize,
    pair_points,
    reflect,
    stack,
    tangent,
    texel_directions,
    texel_solid_angles,
    to_local,
)

from .cube_rows import cube_laplacian, cube_rows

Parameters = Literal["NR", "NRV", "NRHD"]
# Factors that depend on one index of a pair, 0 normal or 1 view: all samples with this normal or view share a row.
_SHARED = {"normal": 0, "difference": 0, "view": 1}
PARAMETERS: dict[str, tuple[str, ...]] = {
    "NR": ("normal", "reflection"),
    "NRV": ("normal", "reflection", "view"),
    "NRHD": ("normal", "reflection", "half", "difference"),
}


@dataclass(frozen=True)
class LightFactors:
    """The result of a factorization.

    Attributes:
        logs: log t_j (6, R, R, 3), float32, for each edge of the maps, coarse to fine, and each factor.
        lit: 1 for each channel that has light, otherwise 0, (3,).
        dominant: dominant direction of the light (3,), for "half" and "difference".
        iterations: number of iterations of the solver for each edge.
    """

    logs: tuple[tuple[Tensor, ...], ...]
    lit: Tensor
    dominant: Tensor
    iterations: tuple[int, ...]


def dominant_direction(light: CubeMap) -> Tensor:
    """The mean direction of the light, weighted by luminance and solid angle, (3,); +y if it does not have one."""
    weight = (light.faces.double() @ torch.tensor(LUMINANCE, dtype=torch.float64, device=light.faces.device)).cpu()
    weight = weight * texel_solid_angles(light.resolution)
    mean = torch.einsum("fij,fijc->c", weight, stack(texel_directions(light.resolution)).double())
    if mean.norm() < 1e-6 * weight.sum() or not weight.sum() > 0:
        return torch.tensor([0.0, 1.0, 0.0])
    return (mean / mean.norm()).float()


def factor_direction(factor: str, n: Vec3, v: Vec3, dominant: Tensor) -> Vec3:
    """The direction in which a factor is read."""
    if factor == "normal":
        return n
    if factor == "view":
        return v
    if factor == "reflection":
        return reflect(v, n)
    t = tangent(n)
    frame = (t, cross(n, t), n)
    l = Vec3(*(torch.full_like(n.x, float(c)) for c in dominant))  # noqa: E741
    if factor == "difference":
        return to_local(l, *frame)
    # If v is opposite to the light, there is no half vector, and any direction can be used.
    h = normalize(Vec3(l.x + v.x, l.y + v.y, l.z + v.z + 1e-9))
    return to_local(h, *frame)


def factor_lighting(
    samples: LightingSamples,
    parameters: Parameters,
    dominant: Tensor,
    edges: Sequence[int],
    smoothness: float,
    floor: float,
    ceiling: float,
    solver: Solver,
    tolerance: float,
    max_iterations: int,
) -> LightFactors:
    """Factors of samples of the lighting function: one solve for each edge, which starts from the coarser result.

    Args:
        edges: texels along the edge of the maps, coarse to fine.
        floor: samples below this times the mean of their channel are raised to it.
        ceiling: samples above this are lowered to it.
    """
    names = PARAMETERS[parameters]
    clamped = samples.radiance.cpu().clamp(max=ceiling)
    mean = clamped.mean(0)
    log_f = np.log(torch.maximum(clamped, (floor * mean).clamp(min=1e-30)).numpy())
    logs: list[tuple[Tensor, ...]] = []
    iterations = []
    start: list[Floats] | None = None
    for edge in edges:
        maps = [_make_factor_map(name, samples, dominant, edge) for name in names]
        if start is None:
            start = average_start(log_f, maps)
        else:
            finer = cube_rows(_list_texels(edge), logs[-1][0].shape[1])
            start = [finer @ one for one in start]
        found = factorize(log_f, maps, smoothness, solver, tolerance, max_iterations, start)
        start = list(found.logs)
        iterations.append(found.iterations)
        logs.append(tuple(torch.from_numpy(one).float().view(6, edge, edge, 3) for one in found.logs))
    return LightFactors(tuple(logs), (mean > 0).float(), dominant, tuple(iterations))


def _list_texels(edge: int) -> Vec3:
    return Vec3(*(c.reshape(-1).double() for c in texel_directions(edge)))


def _make_factor_map(factor: str, samples: LightingSamples, dominant: Tensor, edge: int) -> FactorMap:
    laplacian = cube_laplacian(edge)
    if factor in _SHARED:
        d = _list_texels(samples.edge)
        rows = cube_rows(factor_direction(factor, d, d, dominant), edge)
        return FactorMap(rows, laplacian, samples.pairs[:, _SHARED[factor]].numpy())
    points = pair_points(samples.edge, samples.pairs).map(lambda c: c.double())
    return FactorMap(cube_rows(factor_direction(factor, points.n, points.wo, dominant), edge), laplacian)
