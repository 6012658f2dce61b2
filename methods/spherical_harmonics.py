"""Spherical harmonics of the light, filtered by the lobe: an irradiance map for glossy materials."""

from math import pi
from typing import Annotated, Literal

import torch
from pydantic import Field
from torch import Tensor

from glossbench.prefilter import (
    METHODS,
    Contract,
    CubeMap,
    Lobe,
    Material,
    Method,
    Radiance,
    ShadingPoints,
    Vec3,
    ViewTable,
    albedos,
    diffuse_radiance,
    irradiance,
    over_points,
    project,
    reflect,
    sh_basis,
    spherical,
    stage,
)

Window = Literal["none", "hann", "lanczos"]


@METHODS.register("spherical_harmonics")
class SphericalHarmonics(Method):
    """Lo ~ A(wo) sum over l < order of w_l A_l sum over m of L_lm Y_lm(r), r the mirror direction.

    A is the directional albedo of a lobe, and A_l the zonal coefficients of the lobe f cos_i at wo = n about its axis,
    divided by the first: A_l = integral of K P_l / integral of K. So the lobe is round, whatever the view: it cannot
    show the stretched highlight of a grazing view, nor anisotropy (K is the mean over azimuths). A series that ends
    rings: small bright lights get dark rings, where the radiance may be negative, and a lobe that is narrower than
    about 1 / order is blurred. A window reduces the rings and blurs more. Nothing is clamped.

    Attributes:
        order: number of bands of the light; n bands have n^2 coefficients.
        window: w_l. "none": 1; "hann": (1 + cos(pi l / order)) / 2; "lanczos": sin(x) / x, x = pi l / order.

    Source: Ramamoorthi and Hanrahan 2002; windows, Sloan 2008.
    """

    order: Annotated[int, Field(ge=1, le=32)] = 16
    window: Window = "none"

    equation = 'L_o approx A(omega_o) sum_(l < "order") w_l A_l sum_m L_(l m) Y_(l m)(r)'
    # Measured: furnace 2.5e-3, of bands above 0: the coefficients are sums over texels.
    contract = Contract(furnace=5e-3, budget=("order", (4, 8, 16, 32)))

    irradiance, albedos = irradiance, albedos

    def n_samples(self, material: Material) -> int:
        """Number of coefficients."""
        return self.order**2

    @stage
    def coefficients(self, light: CubeMap) -> Tensor:
        """L_lm of the light, (order^2, 3), float64."""
        return project(light, self.order)

    @stage
    def bands(self, material: Material) -> Tensor:
        """A_l of each lobe, (lobes, order), float64."""
        return torch.stack([compute_bands(lobe, self.order) for lobe in material.as_lobes().lobes])

    def shade(
        self,
        points: ShadingPoints,
        material: Material,
        coefficients: Tensor,
        bands: Tensor,
        albedos: tuple[ViewTable, ...],
        irradiance: Tensor,
    ) -> Radiance:
        """Radiance (P, 3)."""
        wo, band = points.wo_local(), torch.arange(self.order, dtype=torch.float64)
        weight = (bands * make_window(self.window, band / self.order)).to(points.device)
        radiance = diffuse_radiance(material.as_lobes(points.device), irradiance, points.n)
        of_coefficient = weight.repeat_interleave(2 * band.long().to(points.device) + 1, dim=1)
        filtered = coefficients[:, None] * of_coefficient.T[:, :, None]  # (order^2, lobes, 3)
        # Wider chunks than those of other methods: the recurrences take some 3 order^2 calls for each of them.
        series = over_points(_sum_series, points, 4 * self.order, filtered.flatten(1), self.order)
        for i, albedo in enumerate(albedos):
            radiance = radiance + albedo.at(wo) * series[:, 3 * i : 3 * i + 3]
        return radiance


def _sum_series(points: ShadingPoints, coefficients: Tensor, order: int) -> Tensor:
    """Sum of coefficients times Y_lm(r), in float64: float32 does not hold (2 m - 1)!! of high bands."""
    r = reflect(points.wo, points.n)
    basis = sh_basis(Vec3(*(c.double() for c in r)), order)
    return (torch.cat(basis, dim=1) @ coefficients).float()


def make_window(window: Window, x: Tensor) -> Tensor:
    """w_l at x = l / order."""
    if window == "hann":
        return (1 + torch.cos(pi * x)) / 2
    return torch.sinc(x) if window == "lanczos" else torch.ones_like(x)


def compute_bands(lobe: Lobe, order: int, n_angles: int = 2048, n_azimuths: int = 32) -> Tensor:
    """A_l = integral of K P_l(cos theta) dwi / integral of K dwi, K = f(n, wi) cos_i, (order,), float64.

    The midpoint rule in u with theta = pi / 2 u^4, so that narrow lobes are resolved, too.
    """
    device = str(lobe.widths[0].device)
    u = (torch.arange(n_angles, dtype=torch.float64, device=device) + 0.5) / n_angles
    phi = (torch.arange(n_azimuths, dtype=torch.float64, device=device) + 0.5) * (2 * pi / n_azimuths)
    theta, azimuth = torch.meshgrid(pi / 2 * u**4, phi, indexing="ij")
    wi = Vec3(*(c.float() for c in spherical(theta, azimuth)))
    zero = torch.zeros_like(wi.z)
    f = torch.stack(lobe.f(Vec3(zero, zero, zero + 1), wi)).double().mean(0).mean(1)
    cos, sin = torch.cos(theta[:, 0]), torch.sin(theta[:, 0])
    weight = f * cos * sin * u**3
    bands, previous, current = [], torch.zeros_like(cos), torch.ones_like(cos)
    for band in range(order):
        bands.append((weight * current).sum())
        previous, current = current, ((2 * band + 1) * cos * current - band * previous) / (band + 1)
    return torch.stack(bands) / bands[0]
