"""The diffuse part of the radiance, with and without shadows."""

from math import pi

import torch
from torch import Tensor

from glossbench.brdf.material import Reflectance
from glossbench.directions import Vec3, cosine_hemisphere, to_world
from glossbench.envmap.harmonics import irradiance as irradiance_at
from glossbench.envmap.pyramid import Environment, weighted_radiance
from glossbench.scene.points import Occluder, ShadingPoints
from glossbench.shading.kernels import over_points
from glossbench.shading.visibility import unhidden


def diffuse_radiance(reflectance: Reflectance, coefficients: Tensor, n: Vec3) -> Tensor:
    """The diffuse part of the outgoing radiance, albedo E(n) / pi: (P, 3)."""
    if not reflectance.diffuse:
        return coefficients.new_zeros(n.x.shape[0], 3)
    return irradiance_at(coefficients, n) * torch.stack(reflectance.diffuse) / pi


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

    Without an occluder: albedo E(n) / pi by nine spherical harmonics. With one: albedo (1/N) sum of L(wi) V(wi), with
    wi of density cos_i / pi, and one shadow ray for each wi.

    Args:
        irradiance: the nine coefficients.
        occluder: the scene that hides light, or None.
        environment: the light that the samples read.
        u: points (N, 2) of the unit square.
        level: log4(K / N) plus a bias: a sample reads the level whose texel covers K / (N p); None reads level 0.
    """
    if occluder is None or not reflectance.diffuse:
        return diffuse_radiance(reflectance, irradiance, points.n)
    wi = Vec3(*(c[None] for c in cosine_hemisphere(u)))
    mean = over_points(_sum_visible_light, points, len(u), wi, environment, occluder, level) / len(u)
    return mean * torch.stack(reflectance.diffuse)


def _sum_visible_light(
    points: ShadingPoints, wi: Vec3, environment: Environment, occluder: Occluder, level: Tensor | None
) -> Tensor:
    """Sum over samples of L V."""
    d = to_world(wi, points.t, points.b, points.n)
    lod = None if level is None else level + 0.5 * (environment.log2_texels_per_sr(d) - torch.log2(wi.z / pi))
    return weighted_radiance(environment, d, lod, unhidden((torch.ones_like(d.x),), points, d, occluder))
