"""Stages that several methods share: because it is one object, one value serves them all."""

from math import pi
from typing import Any

import torch
from torch import Tensor

from glossbench.brdf.material import Material, Reflectance
from glossbench.directions import Vec3
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.harmonics import irradiance as irradiance_at
from glossbench.envmap.harmonics import irradiance_coefficients
from glossbench.envmap.paraboloid import Paraboloid, build_paraboloid
from glossbench.envmap.pyramid import Pyramid, build_pyramid
from glossbench.prefilter.cosine_lobes.lobe_sum import LobeSum, fit_lobe_sum
from glossbench.prefilter.median_cut import Partition
from glossbench.prefilter.shadows import Shadows, cast
from glossbench.shading.method import stage


@stage
def pyramid(self: Any, light: CubeMap) -> Pyramid | Paraboloid:
    """The filtered light, by the method's `mip_filter`; a cube, or a dual paraboloid where its `projection` says so."""
    if getattr(self, "projection", "cube") == "dual_paraboloid":
        return build_paraboloid(light, self.mip_filter)
    return build_pyramid(light, self.mip_filter)


@stage
def irradiance(self: Any, light: CubeMap) -> Tensor:
    """Nine spherical-harmonic coefficients of the irradiance, for the diffuse part."""
    return irradiance_coefficients(light)


def diffuse_radiance(reflectance: Reflectance, coefficients: Tensor, n: Vec3) -> Tensor:
    """The diffuse part of the outgoing radiance, albedo E(n) / pi: (P, 3)."""
    if not reflectance.diffuse:
        return coefficients.new_zeros(n.x.shape[0], 3)
    return irradiance_at(coefficients, n) * torch.stack(reflectance.diffuse) / pi


@stage
def lobe_sums(self: Any, material: Material) -> tuple[LobeSum, ...]:
    """Cosine lobes of each glossy lobe, at most the method's `lobes`."""
    return tuple(fit_lobe_sum(lobe, self.lobes) for lobe in material.as_lobes().lobes)


@stage
def shadows(self: Any, partition: Partition, scene: Any) -> Shadows:
    """What hides the regions of the light, by the method's `visibility`."""
    return cast(
        self.visibility, scene, partition.direction, partition.solid_angle,
        self.shadow_resolution, self.blocker_distance, self.light_bleeding,
    )  # fmt: skip
