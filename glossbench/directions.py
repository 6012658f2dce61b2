"""Directions in components: unit vectors, frames, reflection, spherical coordinates, point sets.

A direction is three tensors of one shape, never one tensor with a last axis of three: so kernels stay element-wise and
can be fused, and a direction that depends only on the sample keeps its shape (1, N) until it is combined with pixels.
Axes of the world: +x right, +y up, right-handed, so that forward is -z. Angles in radians.
"""

from math import pi
from typing import Literal, NamedTuple

import torch
from jaxtyping import Float, Float32, Int
from torch import Tensor

PointSet = Literal["hammersley", "hammersley_swapped", "r2", "halton", "sobol", "random"]
SEEDED: tuple[PointSet, ...] = ("sobol", "random")  # the point sets that a seed changes


class Vec3(NamedTuple):
    """A vector field: components x, y, z of one shape (or shapes that broadcast)."""

    x: Tensor
    y: Tensor
    z: Tensor

    @property
    def shape(self) -> torch.Size:
        """The shape of all components, broadcast."""
        if self.x.shape == self.y.shape == self.z.shape:
            return self.x.shape
        return torch.Size(torch.broadcast_shapes(*(c.shape for c in self)))

    @property
    def dtype(self) -> torch.dtype:
        """The type of the components' numbers."""
        return self.x.dtype


def vec3(v: Float[Tensor, "*batch 3"]) -> Vec3:
    """Components of a tensor."""
    return Vec3(v[..., 0], v[..., 1], v[..., 2])


def stack(v: Float[Vec3, "*batch"]) -> Float[Tensor, "*batch 3"]:
    """The components as one tensor, after broadcasting."""
    return torch.stack(torch.broadcast_tensors(*v), dim=-1)


def dot(a: Vec3, b: Vec3) -> Tensor:
    """a . b"""
    return a.x * b.x + a.y * b.y + a.z * b.z


def cross(a: Vec3, b: Vec3) -> Vec3:
    """a x b"""
    return Vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


def scale(v: Vec3, s: Tensor) -> Vec3:
    """s v"""
    return Vec3(v.x * s, v.y * s, v.z * s)


def lerp(a: Vec3, b: Vec3, share: Tensor | float) -> Vec3:
    """(1 - share) a + share b"""
    return Vec3(*(u + share * (v - u) for u, v in zip(a, b, strict=True)))


def normalize(v: Vec3) -> Vec3:
    """v / |v|; a vector of length zero stays zero."""
    return scale(v, torch.rsqrt(dot(v, v).clamp(min=1e-30)))


def half_vector(wo: Vec3, wi: Vec3) -> Vec3:
    """(wo + wi) / |wo + wi|"""
    return normalize(Vec3(wo.x + wi.x, wo.y + wi.y, wo.z + wi.z))


def reflect(wo: Vec3, h: Vec3) -> Vec3:
    """2 (wo . h) h - wo: the mirror direction of wo at the facet h.

    >>> up, wo = vec3(torch.tensor([0.0, 0.0, 1.0])), vec3(torch.tensor([0.6, 0.0, 0.8]))
    >>> stack(reflect(wo, up)).round(decimals=4)
    tensor([-0.6000,  0.0000,  0.8000])
    """
    c = 2 * dot(wo, h)
    return Vec3(c * h.x - wo.x, c * h.y - wo.y, c * h.z - wo.z)


def to_world(v: Vec3, t: Vec3, b: Vec3, n: Vec3) -> Vec3:
    """v.x t + v.y b + v.z n"""
    return Vec3(
        v.x * t.x + v.y * b.x + v.z * n.x,
        v.x * t.y + v.y * b.y + v.z * n.y,
        v.x * t.z + v.y * b.z + v.z * n.z,
    )


def to_local(v: Vec3, t: Vec3, b: Vec3, n: Vec3) -> Vec3:
    """(v . t, v . b, v . n)"""
    return Vec3(dot(v, t), dot(v, b), dot(v, n))


def spherical(theta: Tensor, phi: Tensor) -> Vec3:
    """The direction at angle theta from +z and azimuth phi from +x towards +y."""
    sin = torch.sin(theta)
    return Vec3(sin * torch.cos(phi), sin * torch.sin(phi), torch.cos(theta))


def points_2d(n: int, kind: PointSet = "hammersley", seed: int = 0) -> Float32[Tensor, "{n} 2"]:
    """n points of the open unit square.

    hammersley: ((i + 1/2) / n, radical inverse of i in base 2, plus 1 / (2 n)). hammersley_swapped: the same points
    with their coordinates exchanged. r2: the additive recurrence of the plastic number (Roberts 2018), shifted by 1/2.
    halton: radical inverses of i + 1 in bases 2 and 3. sobol: Sobol's sequence with Owen's scrambling, seeded by seed
    and n. random: independent uniform numbers, seeded in the same way.

    >>> points_2d(4)
    tensor([[0.1250, 0.1250],
            [0.3750, 0.6250],
            [0.6250, 0.3750],
            [0.8750, 0.8750]])
    """
    i = torch.arange(n)
    match kind:
        case "hammersley" | "hammersley_swapped":
            u = torch.stack([(i.double() + 0.5) / n, _radical_inverse(i, 2) + 0.5 / n], dim=1)
            u = u if kind == "hammersley" else u.flip(1)
        case "r2":
            plastic = 1.32471795724474602596
            u = torch.stack([(0.5 + (i.double() + 1) / plastic) % 1, (0.5 + (i.double() + 1) / plastic**2) % 1], dim=1)
        case "halton":
            u = torch.stack([_radical_inverse(i + 1, 2), _radical_inverse(i + 1, 3)], dim=1)
        case "sobol":
            engine = torch.quasirandom.SobolEngine(2, scramble=True, seed=seed * 2**21 + n)
            u = engine.draw(n, dtype=torch.float64)
        case "random":
            u = torch.rand(n, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(seed * 2**21 + n))
    # The interval is open at both ends, because callers compute log(u) and tan(2 pi u).
    return u.float().clamp(2.0**-24, 1 - 2.0**-24)


def _radical_inverse(i: Int[Tensor, "n"], base: int) -> Float[Tensor, "n"]:
    """The digits of i in a base, mirrored at the point."""
    value, place = torch.zeros(len(i), dtype=torch.float64), 1 / base
    while (i > 0).any():
        value += (i % base) * place
        i, place = i // base, place / base
    return value


def cosine_hemisphere(u: Float[Tensor, "n 2"]) -> Float[Vec3, "n"]:
    """Directions about +z with density cos / pi, from points of the unit square."""
    r, phi = torch.sqrt(u[:, 0]), 2 * pi * u[:, 1]
    return Vec3(r * torch.cos(phi), r * torch.sin(phi), torch.sqrt(1 - u[:, 0]))
