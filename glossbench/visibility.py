"""Visibility by shadow rays: which samples of a light the scene hides, and the diffuse part that is left of it."""

from math import pi
from typing import Any

import torch
from torch import Tensor

from glossbench.brdf.lobe import Channels
from glossbench.brdf.material import Reflectance
from glossbench.directions import Vec3, cosine_hemisphere, to_world
from glossbench.envmap.pyramid import Environment, weighted_radiance
from glossbench.fusion import over_points, untraced
from glossbench.scene.points import Occluder, ShadingPoints
from glossbench.stages import diffuse_radiance


def occluder_of(scene: Any) -> Occluder | None:
    """The scene where it hides light, else None."""
    return scene if isinstance(scene, Occluder) else None


def unhidden(weight: Channels, points: ShadingPoints, d: Vec3, occluder: Occluder | None) -> Channels:
    """The weights (P, N), zero where the scene hides the direction d; None hides nothing.

    Only of what has a weight a ray is cast. d is in the world's axes, its components (1, N) or (P, N).
    """
    return weight if occluder is None else _cast(weight, points, d, occluder)


@untraced
def _cast(weight: Channels, points: ShadingPoints, d: Vec3, occluder: Occluder) -> Channels:
    assert points.position is not None
    assert points.ng is not None
    seen = torch.stack(torch.broadcast_tensors(*weight, d.x)[:-1]).amax(0) > 0
    rows, columns = seen.nonzero(as_tuple=True)
    position, ng = (Vec3(*(c[rows, 0] for c in v)) for v in (points.position, points.ng))
    seen[rows, columns] = occluder.visible(position, ng, Vec3(*(c.expand_as(seen)[rows, columns] for c in d)))
    return tuple(channel * seen for channel in weight)


def visible_diffuse(
    points: ShadingPoints,
    reflectance: Reflectance,
    irradiance: Tensor,
    occluder: Occluder | None,
    environment: Environment,
    u: Tensor,
    level: Tensor | None = None,
) -> Tensor:
    """The diffuse part of the outgoing radiance, (P, 3).

    albedo E(n) / pi by nine spherical harmonics where nothing is hidden; else albedo (1/N) sum of L(wi) V(wi), wi of
    density cos_i / pi with a shadow ray each.

    Args:
        irradiance: the nine coefficients.
        occluder: what hides the light, or None.
        environment: what the samples read.
        u: points (N, 2) of the unit square.
        level: log4(K / N) and a bias: a sample reads the level whose texel covers K / (N p); None reads level 0.
    """
    if occluder is None or not reflectance.diffuse:
        return diffuse_radiance(reflectance, irradiance, points.n)
    wi = Vec3(*(c[None] for c in cosine_hemisphere(u)))
    mean = over_points(_visible_light, points, len(u), wi, environment, occluder, level) / len(u)
    return mean * torch.stack(reflectance.diffuse)


def _visible_light(
    points: ShadingPoints, wi: Vec3, environment: Environment, occluder: Occluder, level: Tensor | None
) -> Tensor:
    """Sum over samples of L V."""
    d = to_world(wi, points.t, points.b, points.n)
    lod = None if level is None else level + 0.5 * (environment.log2_texels_per_sr(d) - torch.log2(wi.z / pi))
    return weighted_radiance(environment, d, lod, unhidden((torch.ones_like(d.x),), points, d, occluder))
