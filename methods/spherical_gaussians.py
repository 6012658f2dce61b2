"""The light as a few spherical Gaussians, and their closed-form integrals with the lobe."""

from math import log, pi, sqrt
from typing import Annotated, Literal, NamedTuple

import numpy as np
import scipy
import torch
from pydantic import Field
from torch import Tensor

from glossbench.prefilter import (
    METHODS,
    Contract,
    CubeMap,
    Material,
    Method,
    Microfacet,
    Radiance,
    ShadingPoints,
    Vec3,
    ViewTable,
    albedos,
    cross,
    diffuse_radiance,
    dot,
    half_vector,
    halve,
    irradiance,
    kernel,
    merge_channels,
    normalize,
    over_points,
    spherical,
    stack,
    stage,
    texel_directions,
    texel_solid_angles,
    to_local,
)

Warp = Literal["wang2009", "asg", "ndf_filtering"]
FIT_EDGE = 32  # texels along the edge of a face to which the fit is made


class Gaussians(NamedTuple):
    """L(d) ~ sum of amplitude exp(sharpness (d . axis - 1)): axes (1, N), one sharpness, amplitudes (N, 3)."""

    axis: Vec3
    sharpness: Tensor
    amplitude: Tensor


@METHODS.register("spherical_gaussians")
class SphericalGaussians(Method):
    """Lo ~ sum over k < N of mu_k integral of G_k(wi) f cos_i dwi, with G_k = exp(lambda (wi . p_k - 1)).

    The axes p_k lie on a spiral; two neighbours have the value 0.65 halfway between them, and the amplitudes mu_k are
    the non-negative least-squares fit of the light. So the light loses all detail smaller than the distance of the
    axes, about 3.5 / sqrt(N) radians: it cannot show a sharp reflection, however smooth the material is. Three ways to
    integrate, with r the mirror direction, c = n . wo, s = 2 / alpha^2 and alpha^2 the product of both widths:

        wang2009: f cos_i ~ its value at r times exp(s / (4 max(c, 0.1)) (wi . r - 1)); round at every view.
        asg: f cos_i ~ its value at r times an anisotropic Gaussian about r, of sharpness s / 8 in the plane of
            incidence and s / (8 c^2) across it; it shows the stretch of a grazing view.
        ndf_filtering: the Gaussian widens the slopes of GGX: the lobe for a matrix A in place of alpha^2, at the half
            vector of wo and p_k, times the directional albedo and the share above the horizon; it shows anisotropy.

    Kurt and Ward take their slopes m as alpha. None of them has shadowing that varies over the lobe.

    Attributes:
        lobes: N.
        warp: how a Gaussian of the light is integrated with the lobe.

    Source: Wang et al. 2009; Xu et al. 2013; Tokuyoshi et al. 2024 eq. 12, with its supplement. The axes are those of
    a public program (BakingLab). Differs: its sharpness has a further factor N, which leaves holes between many lobes;
    ndf_filtering there has no albedo; the share above the horizon takes the mirror direction for the dominant one.
    """

    lobes: Annotated[int, Field(ge=12, le=512)] = 64
    warp: Warp = "ndf_filtering"

    equation = "L_o approx sum_k mu_k integral e^(lambda (omega_i dot p_k - 1)) f cos theta_i dif omega_i"
    # Measured: furnace 0.24 (asg 0.27), of rough lobes at grazing views; turns 0.22, because the spiral does not turn.
    # It is not linear, because amplitudes are not negative.
    contract = Contract(furnace=0.3, linear=False, turns=0.25, budget=("lobes", (16, 64)))

    irradiance, albedos = irradiance, albedos

    def supports(self, material: Material, scene: object) -> str | None:
        """The reason why a lobe cannot be warped, if it is not one of microfacets."""
        are_microfacets = all(isinstance(lobe, Microfacet) for lobe in material.as_lobes().lobes)
        return None if are_microfacets else "a lobe has no distribution of microfacets"

    @stage
    def gaussians(self, light: CubeMap) -> Gaussians:
        """The fit of the light."""
        return fit_light(light, self.lobes)

    def shade(
        self,
        points: ShadingPoints,
        material: Material,
        gaussians: Gaussians,
        albedos: tuple[ViewTable, ...],
        irradiance: Tensor,
    ) -> Radiance:
        """Radiance (P, 3)."""
        reflectance = material.as_lobes(points.device)
        radiance = diffuse_radiance(reflectance, irradiance, points.n)
        for lobe, albedo in zip(reflectance.lobes, albedos, strict=True):
            glossy = over_points(_sum_gaussians, points, self.lobes, lobe, gaussians, self.warp)
            if self.warp == "ndf_filtering":
                glossy = glossy * albedo.at(points.wo_local())
            radiance = radiance + glossy
        return radiance


def fit_light(light: CubeMap, n: int) -> Gaussians:
    """The Gaussians of a light; least squares over texels, weighted by their solid angles, for each channel."""
    faces = light.faces
    while faces.shape[1] > FIT_EDGE:
        faces = halve(faces, (1, 1))
    k = torch.arange(n, dtype=torch.float64)
    axis = spherical(torch.acos(1 - (2 * k + 1) / n), k * (pi * (3 - sqrt(5))))
    axes, resolution = stack(axis), faces.shape[1]
    nearest = float((axes @ axes.T).fill_diagonal_(-1).max())
    sharpness = log(0.65) / (sqrt((1 + nearest) / 2) - 1)  # 0.65 at the half vector of the two nearest
    d = stack(texel_directions(resolution)).reshape(-1, 3).double()
    weight = texel_solid_angles(resolution).sqrt().expand(6, -1, -1).reshape(-1, 1)
    q, r = np.linalg.qr((weight * torch.exp(sharpness * (d @ axes.T - 1))).numpy())
    wanted = q.T @ (weight * faces.reshape(-1, 3).cpu().double()).numpy()
    amplitude = np.stack([scipy.optimize.nnls(r, wanted[:, channel])[0] for channel in range(3)], axis=1)
    device = faces.device
    return Gaussians(
        Vec3(*(c.float()[None].to(device) for c in axis)),
        torch.tensor(sharpness, dtype=torch.float32, device=device),
        torch.from_numpy(amplitude).float().to(device),
    )


@kernel("spherical_gaussians")
def _sum_gaussians(points: ShadingPoints, lobe: Microfacet, gaussians: Gaussians, warp: str) -> Radiance:
    """Sum over the Gaussians of the light."""
    wo = points.wo_local()
    axis = to_local(gaussians.axis, points.t, points.b, points.n)
    if warp == "ndf_filtering":
        weight: tuple[Tensor, ...] = (filter_normals(lobe, wo, axis, gaussians.sharpness),)
    else:
        r = Vec3(-wo.x, -wo.y, wo.z)
        s = 2 / (lobe.widths[0] * lobe.widths[1])
        if warp == "asg":
            integral = integrate_asg(wo, s, axis, gaussians.sharpness)
        else:
            integral = integrate_product(r, s / (4 * wo.z.clamp(min=0.1)), axis, gaussians.sharpness)
        weight = tuple(f * wo.z * integral for f in lobe.f(wo, r))
    return merge_channels([w @ gaussians.amplitude for w in weight])


def integrate_product(p: Vec3, a: Tensor, q: Vec3, b: Tensor) -> Tensor:
    """Integral of exp(a (d . p - 1)) exp(b (d . q - 1)) = 2 pi e^(|u| - a - b) (1 - e^(-2 |u|)) / |u|, u = a p + b q.

    |u| - a - b = 2 a b (p . q - 1) / (|u| + a + b), without the cancellation of large sharpnesses.
    """
    chord = Vec3(p.x - q.x, p.y - q.y, p.z - q.z)
    apart = dot(chord, chord) / 2  # 1 - p . q
    length = torch.sqrt(((a + b) ** 2 - 2 * a * b * apart).clamp(min=1e-12))
    exponent = -2 * a * b * apart / (length + a + b)
    return 2 * pi * torch.exp(exponent) * -torch.expm1(-2 * length) / length


def integrate_asg(wo: Vec3, s: Tensor, p: Vec3, sharpness: Tensor) -> Tensor:
    """Integral of the lobe's anisotropic Gaussian about r with a Gaussian about p, of sharpness 2 nu.

    pi / sqrt((nu + a) (nu + b)) exp(-nu a / (nu + a) (p . x)^2 - nu b / (nu + b) (p . y)^2) max(p . r, 0), with x
    across the plane of incidence, a = s / (8 c^2), b = s / 8.
    """
    r = Vec3(-wo.x, -wo.y, wo.z)
    is_pole = (wo.x * wo.x + wo.y * wo.y) < 1e-12
    x = normalize(Vec3(torch.where(is_pole, 1.0, -r.y), torch.where(is_pole, 0.0, r.x), torch.zeros_like(r.x)))
    y = cross(r, x)
    a, b, nu = s / (8 * wo.z * wo.z).clamp(min=1e-8), s / 8, sharpness / 2
    u, v = dot(p, x), dot(p, y)
    exponent = -nu * a / (nu + a) * u * u - nu * b / (nu + b) * v * v
    return pi * torch.rsqrt(nu + a) * torch.rsqrt(nu + b) * torch.exp(exponent) * dot(p, r).clamp(min=0)


def filter_normals(lobe: Microfacet, wo: Vec3, p: Vec3, sharpness: Tensor) -> Tensor:
    """Integral of f cos_i / albedo with a Gaussian about p: D_A(h) / (4 sqrt(wo A wo)) times its integral and share.

    B = diag(alpha^2 / (1 - alpha^2)) + 2 / lambda J J^T, J the Jacobian of half vectors by light directions at h = n;
    A = (B + det B) / (1 + tr B + det B), and 1 for the normal.
    """
    cos2 = (wo.z * wo.z).clamp(min=1e-8)
    length2 = wo.x * wo.x + wo.y * wo.y
    inverse = torch.rsqrt(length2.clamp(min=1e-20))
    is_pole = length2 < 1e-14
    cos, sin = torch.where(is_pole, 1.0, wo.x * inverse), torch.where(is_pole, 0.0, wo.y * inverse)
    variance = 2 / sharpness
    along, across = variance / 4, variance / (4 * cos2)  # in the plane of incidence, and at right angles to it
    j_xx, j_yy = along * cos * cos + across * sin * sin, along * sin * sin + across * cos * cos
    b_x, b_y = (w * w / (1 - w * w).clamp(min=1e-6) for w in lobe.widths)
    b_xy = (along - across) * cos * sin
    det = b_x * b_y + b_x * j_yy + b_y * j_xx + along * across
    total = 1 + b_x + j_xx + b_y + j_yy + det
    a_x, a_y, a_xy = (b_x + j_xx + det) / total, (b_y + j_yy + det) / total, b_xy / total
    det_a = det / total  # the determinant of (B + det B) is det B (1 + tr B + det B)
    h = half_vector(wo, p)
    slope = (a_y * h.x * h.x - 2 * a_xy * h.x * h.y + a_x * h.y * h.y) / det_a + h.z * h.z
    area = torch.sqrt(a_x * wo.x * wo.x + 2 * a_xy * wo.x * wo.y + a_y * wo.y * wo.y + wo.z * wo.z)
    value = 1 / (pi * torch.sqrt(det_a) * slope * slope * 4 * area)
    widest = torch.maximum(*lobe.widths) ** 2
    towards = (1 - widest) / (2 * widest)
    u = Vec3(sharpness * p.x - towards * wo.x, sharpness * p.y - towards * wo.y, sharpness * p.z + towards * wo.z)
    length = torch.sqrt(dot(u, u).clamp(min=1e-12))
    integral = 2 * pi * -torch.expm1(-2 * sharpness) / sharpness
    return value * integral * share_above(u.z / length, length)


def share_above(cos: Tensor, sharpness: Tensor) -> Tensor:
    """The share of a Gaussian above the horizon, its axis at cos from the normal; a fit of Tokuyoshi 2022."""
    steepness = sharpness * torch.sqrt(
        (0.5 * sharpness + 0.65173288) / ((sharpness + 1.34182800) * sharpness + 7.22166878)
    )
    at = 0.5 + 0.5 * torch.erf(steepness * cos) / torch.erf(steepness).clamp(min=1e-12)
    e = torch.exp(-sharpness)
    return (e + (1 - e) * at.clamp(0, 1)) / (1 + e)
