"""A filter that is an ellipse: the image of a sample's square under the Jacobian of u -> wi, by finite differences."""

from typing import Any, NamedTuple

import torch
from torch import Tensor

from glossbench.prefilter import (
    Environment,
    Lobe,
    Occluder,
    Radiance,
    ShadingPoints,
    Vec3,
    dot,
    kernel,
    normalize,
    scale,
    to_world,
    weighted_radiance,
)

from .visibility_harmonics import attenuate

STEP = 1e-3  # with float32, differences of directions then keep three to four digits


class SteppedPoints(NamedTuple):
    """Sample points moved by STEP along u1 and along u2, and the product of the signs of both steps, (1, N)."""

    first: Any
    second: Any
    sign: Tensor


def make_steps(lobe: Lobe, u: Tensor) -> SteppedPoints:
    """Steps towards the middle of the unit square, so that no point leaves it."""
    signs = torch.where(u < 0.5, 1.0, -1.0)
    first, second = u + STEP * signs * u.new_tensor([1, 0]), u + STEP * signs * u.new_tensor([0, 1])
    return SteppedPoints(lobe.sample_points(first), lobe.sample_points(second), (signs[:, 0] * signs[:, 1])[None])


@kernel("affine_footprint")
def sum_affine(
    points: ShadingPoints,
    lobe: Lobe,
    samples: Any,
    stepped: SteppedPoints,
    pyramid: Environment,
    level: Tensor,
    places: Tensor,
    hidden: Occluder | Tensor | None = None,
) -> Radiance:
    """Sum over samples of one lobe; `places` are those of the probes along the major axis, in half axes."""
    wo = points.wo_local()
    wi, _, weight = lobe.sample(wo, samples)
    weight = attenuate(weight, points, to_world(wi, points.t, points.b, points.n), wi, hidden)
    side = torch.exp2(level) / STEP
    a, b = (
        scale(Vec3(end.x - wi.x, end.y - wi.y, end.z - wi.z), side)
        for end in (lobe.sample(wo, stepped.first).wi, lobe.sample(wo, stepped.second).wi)
    )
    # The squares of the singular values of (a b) are the eigenvalues of its Gram matrix. The signs of the steps change
    # the sign of ab.
    aa, bb, ab = dot(a, a), dot(b, b), dot(a, b) * stepped.sign
    mean, spread = (aa + bb) / 2, torch.sqrt(((aa - bb) / 2) ** 2 + ab * ab)
    angle = 0.5 * torch.atan2(2 * ab, aa - bb)
    cos, sin = torch.cos(angle), torch.sin(angle) * stepped.sign
    axis = Vec3(cos * a.x + sin * b.x, cos * a.y + sin * b.y, cos * a.z + sin * b.z)
    major2 = mean + spread
    minor2 = torch.maximum((mean - spread).clamp(min=0), major2 / len(places) ** 2).clamp(min=1e-16)
    # The probes span the part of the major axis that a texel as wide as the minor axis does not cover.
    reach = 0.5 * (1 - torch.sqrt(minor2 / major2.clamp(min=1e-16))).clamp(min=0)
    share = torch.exp(-2 * places * places)
    share = share / share.sum()
    total = torch.zeros_like(points.n.x).expand(-1, 3).clone()
    for k in range(len(places)):
        at = reach * places[k]
        probe = normalize(Vec3(wi.x + at * axis.x, wi.y + at * axis.y, wi.z + at * axis.z))
        d = to_world(probe, points.t, points.b, points.n)
        lod = 0.5 * (pyramid.log2_texels_per_sr(d) + torch.log2(minor2))
        total = total + weighted_radiance(pyramid, d, lod, tuple(w * share[k] for w in weight))
    return total
