"""A BRDF as a product of maps, f(wo, wi) ~ p(wi) q(h) p(wo), each a paraboloid of the hemisphere."""

from dataclasses import dataclass

import numpy as np
import torch
from scipy.sparse import csr_array
from torch import Tensor

from glossbench.prefilter import (
    FactorMap,
    Material,
    Solver,
    Vec3,
    bilinear,
    factorize,
    grid_laplacian,
    grid_rows,
    half_vector,
    points_2d,
    reflect,
    spherical,
    widen,
)

# Smaller cosines are not sampled: in models with a factor 1 / cos they would outweigh all other samples.
LEAST_COSINE = 0.02


@dataclass(frozen=True)
class BRDFFactors:
    """Maps p and q (E, E, 3), float32; texel centres at s = d_x / (1 + d_z), t = -d_y / (1 + d_z) in [-1, 1]."""

    p: Tensor
    q: Tensor

    def f(self, wo: Vec3, wi: Vec3) -> Tensor:
        """p(wi) q(h) p(wo), (P, 3), of directions (P,); zero where one is below the surface."""
        above = ((wo.z > 0) & (wi.z > 0))[:, None]
        return torch.where(above, _read(self.p, wi) * _read(self.q, half_vector(wo, wi)) * _read(self.p, wo), 0.0)


def factor_brdf(
    material: Material, edge: int, n_pairs: int, smoothness: float, floor: float, solver: Solver, tolerance: float
) -> BRDFFactors:
    """Factors of a material's f at n pairs of directions.

    In half of the pairs, both directions are uniform in cosine and azimuth. In the other half, wi is the reflection of
    wo at a half vector drawn from the first lobe, so that highlights have samples.

    Args:
        floor: values of f below this times the maximum are raised to it.

    Source: McCool et al. 2001, sections 3 to 5.
    """
    reflectance = material.reflectance()
    u = [points_2d(n_pairs, "r2"), points_2d(n_pairs, "random", 1)]
    wo, wi = (spherical(torch.acos(LEAST_COSINE + (1 - LEAST_COSINE) * v[:, 0]), 2 * np.pi * v[:, 1]) for v in u)
    if reflectance.lobes:
        lobe = reflectance.lobes[0]
        points = lobe.sample_points(u[1][: n_pairs // 2])
        zero = torch.zeros(1)
        drawn = lobe.sample(Vec3(zero, zero, zero + 1), points).wi
        h = half_vector(Vec3(zero, zero, zero + 1), Vec3(*(c.reshape(-1) for c in drawn)))
        mirrored = reflect(Vec3(*(c[: n_pairs // 2] for c in wo)), h)
        wi = Vec3(*(torch.cat([a, b[n_pairs // 2 :]]) for a, b in zip(mirrored, wi, strict=True)))
    keep = (wi.z > LEAST_COSINE) & (wo.z > LEAST_COSINE)
    wo, wi = (Vec3(*(c[keep] for c in d)) for d in (wo, wi))
    f = torch.stack(widen(reflectance.f(wo, wi), 3), 1).double()
    f = torch.maximum(f, (floor * f.max(0).values).clamp(min=1e-30))
    rows = [grid_rows(*_find_places(d, edge), (edge, edge)) for d in (wo, wi, half_vector(wo, wi))]
    laplacian = grid_laplacian((edge, edge))
    maps = [FactorMap(csr_array(rows[0] + rows[1]), laplacian), FactorMap(rows[2], laplacian)]
    # Both directions read p, so its weights sum to 2, and `average_start` would give a wrong level.
    level = np.log(f.numpy()).mean(0) / 3
    start = [np.tile(level, (edge * edge, 1)) for _ in maps]
    found = factorize(np.log(f.numpy()), maps, smoothness, solver, tolerance, start=start)
    return BRDFFactors(*(torch.exp(torch.from_numpy(one)).float().view(edge, edge, 3) for one in found.logs))


def _find_places(d: Vec3, edge: int) -> tuple[np.ndarray, np.ndarray]:
    """Row and column in texels of directions (P,) on a paraboloid of the hemisphere."""
    row, column = ((0.5 - d.y / (2 * (1 + d.z))) * edge, (0.5 + d.x / (2 * (1 + d.z))) * edge)
    return row.double().numpy(), column.double().numpy()


def _read(texels: Tensor, d: Vec3) -> Tensor:
    """Bilinear lookups of a map in directions (P,) above the surface: (P, 3)."""
    edge = texels.shape[0]
    z = 1 + d.z.clamp(min=0)
    column, row = (0.5 + d.x / (2 * z)) * edge, (0.5 - d.y / (2 * z)) * edge
    return bilinear(texels[None], column[None, None], row[None, None])[0, 0]
