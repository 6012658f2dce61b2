"""Spherical harmonics: zonal coefficients in closed form, and lights of few bands, which the series shows exactly."""

from math import cos, pi

import pytest
import torch
from scipy.integrate import quad
from scipy.special import eval_legendre

import glossbench as gb
from glossbench.brdf.ggx import GGX
from glossbench.brdf.phong import Phong
from glossbench.directions import reflect
from glossbench.envmap.cubemap import CubeMap, texel_directions
from glossbench.methods import spherical_harmonics
from glossbench.methods.spherical_harmonics import SphericalHarmonics, compute_bands
from glossbench.scene.sphere import Sphere
from glossbench.shading.image import shade

VIEW = Sphere(resolution=8)


def bands_of_a_cosine_power(s, order):
    """A_l = A_(l - 2) (s - l + 2) / (s + l + 1), A_0 = 1, A_1 = (s + 1) / (s + 2): moments of cos^s."""
    bands = [1.0, (s + 1) / (s + 2)]
    for band in range(2, order):
        bands.append(bands[band - 2] * (s - band + 2) / (s + band + 1))
    return torch.tensor(bands[:order], dtype=torch.float64)


@pytest.mark.parametrize("s", [1.0, 20.0, 400.0])
def test_bands_of_a_phong_lobe_are_those_of_its_cosine_power(s):
    material = Phong(s=s, foreshortening=False)

    bands = compute_bands(material.reflectance().lobes[0], 20)

    # Measured: 5.9e-7, of float32.
    torch.testing.assert_close(bands, bands_of_a_cosine_power(s, 20), rtol=0, atol=5e-6)


def test_bands_of_ggx_are_those_of_an_adaptive_quadrature():
    alpha = 0.3

    bands = compute_bands(GGX(alpha=alpha).reflectance().lobes[0], 12)

    def K(theta, band):
        cos_h, cos_i = cos(theta / 2), cos(theta)
        D = alpha**2 / (pi * (cos_h**2 * (alpha**2 - 1) + 1) ** 2)
        G2 = 2 * cos_i / (cos_i + (alpha**2 + (1 - alpha**2) * cos_i**2) ** 0.5)
        return D * G2 / 4 * eval_legendre(band, cos_i) * (1 - cos_i**2) ** 0.5

    expected = [quad(K, 0, pi / 2, args=(band,), epsabs=1e-10)[0] for band in range(12)]
    # Measured: 4e-7.
    torch.testing.assert_close(bands, torch.tensor(expected).double() / expected[0], rtol=0, atol=5e-6)


# A light of three bands: 2 + x + y z / 2.


def smooth_light():
    d = texel_directions(64)
    radiance = 2 + d.x + d.y * d.z / 2
    return CubeMap(radiance[..., None].expand(-1, -1, -1, 3).contiguous(), "of three bands")


def error_of_smooth_light(order=6):
    """Largest error of the image, over the mean, with A_l in closed form."""
    s = 8.0
    material = Phong(s=s, foreshortening=False)

    image = shade(SphericalHarmonics(order=order), smooth_light(), material, VIEW, time_it=False)

    points, a = VIEW.points(), bands_of_a_cosine_power(s, 3)
    r = reflect(points.wo, points.n)
    series = 2 + a[1] * r.x + a[2] * r.y * r.z / 2
    expected = material.albedo(points.wo_local()) * series[:, None]
    return float((image.radiance[image.mask] - expected).abs().max() / expected.mean())


# Measured: 9.9e-4, of the table of the albedo near the rim.
LIMIT = 2e-3


def test_a_light_of_three_bands_is_shown_exactly():
    assert error_of_smooth_light() < LIMIT


def test_bands_that_are_shifted_by_one_are_noticed(monkeypatch):
    right = compute_bands
    monkeypatch.setattr(spherical_harmonics, "compute_bands", lambda lobe, order: right(lobe, order + 1)[1:])

    assert error_of_smooth_light() > LIMIT


def test_a_mirror_direction_of_the_other_side_is_noticed(monkeypatch):
    monkeypatch.setattr(spherical_harmonics, "reflect", lambda wo, n: reflect(n, wo))

    assert error_of_smooth_light() > LIMIT


@pytest.mark.parametrize(("window", "low", "high"), [("none", -4, -1), ("lanczos", -0.1, 0), ("hann", 0, 0.1)])
def test_a_series_that_ends_rings_and_a_window_damps_it(window, low, high):
    light, view = gb.light("spots", seed=7, resolution=32, contrast=1e4), Sphere(resolution=32)

    image = shade(SphericalHarmonics(order=16, window=window), light, GGX(alpha=0.05), view, time_it=False)

    # Measured, least radiance over the mean: -2.45, -0.017, 0.031.
    values = image.radiance[image.mask]
    assert low < values.min() / values.mean() < high
