"""Openness: the share of a cosine-weighted hemisphere that a point of the scene sees."""

from typing import Any

import torch
from torch import Tensor

from glossbench.prefilter import Occluder, ShadingPoints, Vec3, cosine_hemisphere, points_2d, to_world


def openness(scene: Any, points: ShadingPoints, n_rays: int, seed: int) -> Tensor:
    """(1/N) sum of V(wi), wi of density cos_i / pi about n: (P,); 1 if the scene does not hide light.

    Its mean over seeds is the ambient visibility (1 / pi) integral of V cos_i dwi. Each point uses the N Hammersley
    points, shifted modulo 1 by a random vector of its own (Cranley and Patterson 1976), so that each ray has exactly
    this density. Directions below the triangle itself are hidden.

    Args:
        seed: seed of the shifts.
    """
    if not isinstance(scene, Occluder):
        return torch.ones(len(points), device=points.device)
    shift = torch.rand(len(points), 2, generator=torch.Generator().manual_seed(seed)).to(points.device)
    u = points_2d(n_rays).to(points.device)
    position, ng = points.position, points.ng
    assert position is not None
    assert ng is not None
    placed = (u[None] + shift[:, None]) % 1
    local = cosine_hemisphere(placed.flatten(0, 1))
    frame = [Vec3(*(c.repeat_interleave(n_rays) for c in v)) for v in (points.t, points.b, points.n, position, ng)]
    d = to_world(local, *frame[:3])
    return scene.visible(frame[3], frame[4], d).view(len(points), n_rays).float().mean(1)
