"""Samples of a linearly transformed cosine, all of the same weight, that read a filtered light."""

from math import log2, pi
from typing import Annotated, NamedTuple

import numpy as np
import scipy
import torch
from pydantic import Field
from torch import Tensor

from glossbench.prefilter import (
    METHODS,
    Contract,
    Environment,
    Finite,
    Floats,
    Lobe,
    Material,
    Method,
    MipFilter,
    Radiance,
    ShadingPoints,
    Vec3,
    ViewTable,
    albedos,
    cosine_hemisphere,
    diffuse_radiance,
    irradiance,
    kernel,
    over_points,
    points_2d,
    pyramid,
    spherical,
    stack,
    stage,
    to_world,
    weighted_radiance,
)

VIEWS = 32  # entries of the table, evenly spaced in the angle to the normal, which is the first
FIT_SAMPLES = 1024  # of the lobe, for each entry


class Transforms(NamedTuple):
    """M of each view, in the plane of incidence: entries xx, xz, yy, zx and zz, each (VIEWS,), of determinant 1."""

    xx: Tensor
    xz: Tensor
    yy: Tensor
    zx: Tensor
    zz: Tensor


@METHODS.register("ltc_sampling")
class LTCSampling(Method):
    """Lo ~ A(wo) (1/N) sum of L(wi, l), wi = M o / |M o|, o with density cos / pi.

    l is the level of filtered importance sampling, and A is the directional albedo. M(theta_o) transforms the cosine so
    that f cos_i ~ A p, p = (o_z / pi) |M o|^3 / det M. So all samples have one weight, also at grazing views. M is
    fitted to each round lobe by maximum likelihood of samples of the lobe; it depends on no light. Samples below the
    horizon are black. It cannot show a lobe that is not such a transformed cosine: the tail of GGX is longer.
    Anisotropic lobes are not supported.

    Attributes:
        samples: N, divided among the lobes.
        mip_bias: number of levels to add to l; 1 is K = 4 of filtered importance sampling.
        mip_filter: filter of the pyramid.

    Source: ours; the distribution of Heitz et al. 2016, with levels after Krivanek and Colbert 2008.
    """

    samples: Annotated[int, Field(ge=1, le=1 << 16)] = 40
    mip_bias: Annotated[Finite, Field(ge=-4, le=4)] = 1.0
    mip_filter: MipFilter = "box"

    equation = "L_o approx A(omega_o) 1/N sum_(i=1)^N L((M o_i)/abs(M o_i), l), quad p = o_z/pi thin abs(M o)^3/(det M)"
    # Measured: furnace 0.068, of samples below the horizon at grazing views of rough lobes.
    contract = Contract(furnace=0.1, budget=("samples", (16, 64, 256)))

    pyramid, irradiance, albedos = pyramid, irradiance, albedos

    def supports(self, material: Material, scene: object) -> str | None:
        """The reason why a material has no such fit, if it is not round."""
        round_ = all(float(lobe.widths[0]) == float(lobe.widths[1]) for lobe in material.as_lobes().lobes)
        return None if round_ else "its transforms are those of a round lobe"

    def n_samples(self, material: Material) -> int:
        """Number of samples of all lobes, at least one for each."""
        return sum(material.as_lobes().share(self.samples))

    @stage
    def transforms(self, material: Material) -> tuple[Transforms, ...]:
        """M of each lobe."""
        return tuple(map(fit_transforms, material.as_lobes().lobes))

    def shade(
        self,
        points: ShadingPoints,
        material: Material,
        pyramid: Environment,
        transforms: tuple[Transforms, ...],
        albedos: tuple[ViewTable, ...],
        irradiance: Tensor,
    ) -> Radiance:
        """Radiance (P, 3)."""
        reflectance = material.as_lobes(points.device)
        radiance = diffuse_radiance(reflectance, irradiance, points.n)
        for M, albedo, n in zip(transforms, albedos, reflectance.share(self.samples), strict=True):
            o = Vec3(*(c[None] for c in cosine_hemisphere(points_2d(n).to(points.device))))
            level = torch.tensor(self.mip_bias - log2(n) / 2, device=points.device)
            placed = Transforms(*(m.to(points.device) for m in M))
            mean = over_points(_sum_samples, points, n, o, placed, pyramid, level) / n
            radiance = radiance + albedo.at(points.wo_local()) * mean
        return radiance


@kernel("ltc_sampling")
def _sum_samples(
    points: ShadingPoints, o: Vec3, transforms: Transforms, pyramid: Environment, level: Tensor
) -> Radiance:
    """Sum over samples; level = log4(1 / N) plus the bias."""
    wi, pdf = transform(points.wo_local(), o, transforms)
    d = to_world(wi, points.t, points.b, points.n)
    lod = level + 0.5 * (pyramid.log2_texels_per_sr(d) - torch.log2(pdf))
    return weighted_radiance(pyramid, d, lod, ((wi.z > 0).float(),))


def transform(wo: Vec3, o: Vec3, transforms: Transforms) -> tuple[Vec3, Tensor]:
    """Directions M o / |M o| in the local frame, and their density [1/sr]."""
    at = (torch.acos(wo.z.clamp(max=1)) * (VIEWS / (pi / 2))).clamp(0, VIEWS - 1)
    i = at.long().clamp(max=VIEWS - 2)
    xx, xz, yy, zx, zz = (torch.lerp(m[i], m[i + 1], at - i) for m in transforms)
    x, y, z = xx * o.x + xz * o.z, yy * o.y, zx * o.x + zz * o.z
    length2 = x * x + y * y + z * z
    inverse = torch.rsqrt(length2)
    pdf = o.z / pi * length2 / inverse / (yy * (xx * zz - xz * zx))
    # The plane of incidence: x points away from the viewer.
    across = torch.sqrt((wo.x * wo.x + wo.y * wo.y).clamp(min=1e-20))
    is_pole = across < 1e-7
    cos, sin = torch.where(is_pole, 1.0, -wo.x / across), torch.where(is_pole, 0.0, -wo.y / across)
    return Vec3((x * cos - y * sin) * inverse, (x * sin + y * cos) * inverse, z * inverse), pdf


def fit_transforms(lobe: Lobe) -> Transforms:
    """M of each view: the frame about the mean direction, times the matrix (a 0 b; 0 c 0; 0 0 1) that fits best."""
    found, start = [], np.array([-1.0, -1.0, 0.0])
    u = points_2d(FIT_SAMPLES).to(lobe.widths[0].device)
    for k in range(VIEWS):  # each fit starts at that of the view before
        theta = torch.full((1, 1), k / VIEWS * (pi / 2), device=u.device)
        wo = spherical(theta, torch.full_like(theta, pi))
        sample = lobe.sample(wo, lobe.sample_points(u))
        wi = stack(sample.wi)[0].double().cpu().numpy()
        weight = torch.stack(torch.broadcast_tensors(*sample.weight)).mean(0)[0].double().cpu().numpy()
        mean = (weight @ wi)[[0, 2]]
        sin_a, cos_a = mean / np.linalg.norm(mean)
        local = np.stack([cos_a * wi[:, 0] - sin_a * wi[:, 2], wi[:, 1], sin_a * wi[:, 0] + cos_a * wi[:, 2]], 1)
        fit = scipy.optimize.minimize(_compute_loss, start, (local, weight / weight.sum()), method="Nelder-Mead",
                       options={"xatol": 1e-3, "fatol": 1e-5})  # fmt: skip
        start = fit.x
        a, c, b = np.exp(fit.x[0]), np.exp(fit.x[1]), fit.x[2]
        entries = [cos_a * a, cos_a * b + sin_a, c, -sin_a * a, -sin_a * b + cos_a]
        found.append(np.array(entries) / (a * c) ** (1 / 3))
    table = torch.from_numpy(np.stack(found, axis=1)).float().to(u.device)
    return Transforms(*table.contiguous())


def _compute_loss(x: Floats, wi: Floats, weight: Floats) -> float:
    """- sum of w log p(wi), p = max(o_z, 0) / pi det M^-1 / |M^-1 wi|^3; o_z has the sign of wi_z in its frame."""
    a, c, b = np.exp(x[0]), np.exp(x[1]), x[2]
    o_x, o_y, o_z = (wi[:, 0] - b * wi[:, 2]) / a, wi[:, 1] / c, wi[:, 2]
    log_p = np.log(np.maximum(o_z, 1e-4)) - np.log(a * c) - 2 * np.log(o_x**2 + o_y**2 + o_z**2)
    return float(-weight @ log_p)
