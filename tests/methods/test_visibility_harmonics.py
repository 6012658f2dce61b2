"""Visibility in spherical harmonics: closed forms of half-spaces, least squares, smoothing, and images."""

from functools import cache
from math import exp, pi, sqrt

import numpy as np
import pytest
import torch
from scipy.special import sph_harm_y

import glossbench as gb
from glossbench.directions import Vec3, points_2d, spherical
from glossbench.methods.filtered_importance_sampling import visibility_harmonics as harmonics
from glossbench.methods.filtered_importance_sampling.visibility_harmonics import (
    evaluate_visibility,
    fit_visibility,
    smooth,
)
from glossbench.scene.mesh import make_mesh
from glossbench.scene.points import Occluder, ShadingPoints, View
from glossbench.shading.image import shade
from glossbench.shading.kernels import chunks
from glossbench.truth.reference import compute_reference


class Open(Occluder):
    """Hides nothing."""

    def visible(self, position, ng, direction):
        return torch.ones_like(position.x, dtype=torch.bool)


class HalfOpen(Occluder):
    """Hides x < 0."""

    def visible(self, position, ng, direction):
        return direction.x > 0


def point(n=(0.0, 0.0, 1.0)):
    """A point with a normal n, seen along it."""
    n = torch.tensor(n) / torch.tensor(n).norm()
    t = torch.linalg.cross(n, torch.tensor([0.3, -0.5, 0.8]))
    t = t / t.norm()
    frame = (t, torch.linalg.cross(n, t), n, n, torch.zeros(3), n)
    return ShadingPoints(*(Vec3(*(c[None] for c in v)) for v in frame))


def uniform(n):
    u = points_2d(n)
    return spherical(torch.acos(1 - 2 * u[:, 0]), 2 * pi * u[:, 1])


def Y(order, d):
    """Real spherical harmonics (N, order^2) by scipy's complex ones; positive m along x."""
    theta, phi = np.arccos(np.clip(d[:, 2], -1, 1)), np.arctan2(d[:, 1], d[:, 0])
    columns = []
    for band in range(order):
        for m in range(-band, band + 1):
            y = sph_harm_y(band, abs(m), theta, phi) * (-1) ** m * (1 if m == 0 else sqrt(2))
            columns.append(y.imag if m < 0 else y.real)
    return np.stack(columns, axis=1)


# Closed forms: many uniform directions make the fit the projection.


@pytest.mark.parametrize("n", [(0.0, 0.0, 1.0), (0.6, -0.7, 0.2)])
def test_what_nothing_hides_is_the_clamped_cosine(n):
    """A_l Y_lm(n), A = pi, 2 pi / 3, pi / 4, 0: Ramamoorthi and Hanrahan 2001 eq. 8."""
    d = np.array(n)[None] / np.linalg.norm(n)
    expected = np.repeat([pi, 2 * pi / 3, pi / 4, 0], [1, 3, 5, 7]) * Y(4, d)[0]

    c = fit_visibility(point(n), Open(), uniform(1 << 14), 4)[0].numpy()

    np.testing.assert_allclose(c, expected, atol=4e-5)  # measured 8.1e-6


HALF = np.array([pi / 2 / sqrt(4 * pi), 0, sqrt(3 / (4 * pi)) * pi / 3, sqrt(3 / (4 * pi)) * 2 / 3])


def half_space():
    """Bands 0 and 1, in the order 1, y, z, x, of max(z, 0) where x > 0."""
    return fit_visibility(point(), HalfOpen(), uniform(1 << 14), 4)[0, :4].numpy()


def test_a_half_space_has_its_closed_form():
    np.testing.assert_allclose(half_space(), HALF, atol=5e-4)  # measured 1.7e-4, at the plane's edge


def test_a_wall_is_that_half_space():
    wall = np.array([[0.0, -1, -1], [0, -1, 1], [0, 1, 1], [0, 1, -1]])
    points = point()
    vars(points)["position"] = Vec3(*(torch.tensor([c]) for c in (1e-5, 0.0, 0.0)))

    c = fit_visibility(points, make_mesh(wall, [[0, 1, 2], [0, 2, 3]]), uniform(1 << 14), 4)[0, :4].numpy()

    np.testing.assert_allclose(c, HALF, atol=5e-4)  # measured 3.8e-4


RIGHT = harmonics.unhidden
FAULTS = {
    "a dropped cosine": ("unhidden", lambda w, p, d, o: tuple((v > 0).float() for v in RIGHT(w, p, d, o))),
    "no shadow": ("unhidden", lambda w, p, d, o: w),
    "a flipped axis": ("unhidden", lambda w, p, d, o: RIGHT(w, p, Vec3(-d.x, d.y, d.z), o)),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_half_space_notices(fault, monkeypatch):
    name, wrong = FAULTS[fault]
    monkeypatch.setattr(harmonics, name, wrong)

    assert np.abs(half_space() - HALF).max() > 0.1


# Least squares, by numpy's own.


@pytest.mark.parametrize("n_directions", [4, 16, 40, 200])
@pytest.mark.parametrize("crowded", [False, True])
def test_coefficients_are_those_of_least_squares(n_directions, crowded):
    rng = np.random.default_rng(n_directions)
    d = rng.standard_normal((n_directions, 3)) + np.array([0, 0, 3 if crowded else 0])
    d = (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)
    v = np.maximum(d[:, 2], 0) * (d[:, 0] > 0)

    c = fit_visibility(point(), HalfOpen(), Vec3(*torch.from_numpy(d.T.copy())), 4)[0].numpy()

    # Singular values of B are roots of those of its Gram matrix. Measured 1.9e-6.
    expected = np.linalg.lstsq(Y(4, d.astype(np.float64)), v, rcond=sqrt(harmonics.LEAST_EIGENVALUE))[0]
    np.testing.assert_allclose(c, expected, atol=1e-5)


def test_visibility_of_an_open_point_is_one_but_for_the_lost_bands():
    c = fit_visibility(point(), Open(), uniform(1 << 14), 4)
    theta = torch.linspace(0, 1.2, 13)
    d = spherical(theta, torch.full_like(theta, 0.7))

    V = evaluate_visibility(c, Vec3(*(x[None] for x in d)), d.z[None])[0].numpy()

    # Bands 0 to 2 of the clamped cosine, 1/4 + cos / 2 + 5 / 32 (3 cos^2 - 1), over cos. Measured 1.7e-6.
    cosine = np.cos(theta.numpy())
    np.testing.assert_allclose(V, np.clip((3 / 32 + cosine / 2 + 15 / 32 * cosine**2) / cosine, 0, 1), atol=8e-6)
    assert V.min() > 0.9


def test_visibility_stays_within_0_and_1():
    c = 10 * torch.randn(5, 16, generator=torch.Generator().manual_seed(0))
    d = Vec3(*(x[None] for x in uniform(200)))

    V = evaluate_visibility(c, d, d.z.clamp(min=0))

    assert V.shape == (5, 200)
    assert V.min() == 0
    assert V.max() == 1


# Smoothing.


def test_smoothing_leaves_a_constant_as_it_is_up_to_the_outline():
    mask = torch.rand(20, 30, generator=torch.Generator().manual_seed(0)) < 0.5

    smoothed = smooth(torch.full((int(mask.sum()), 4), 2.5), mask, 2.0)

    torch.testing.assert_close(smoothed, torch.full_like(smoothed, 2.5), rtol=5e-7, atol=0)  # measured 9.5e-8


def test_smoothing_spreads_one_pixel_as_a_gaussian():
    mask, values = torch.ones(31, 31, dtype=torch.bool), torch.zeros(31, 31)
    values[15, 15] = 1

    smoothed = smooth(values.reshape(-1, 1), mask, 1.5).reshape(31, 31)

    reach = range(-5, 6)  # 3 sigma, rounded
    total = sum(exp(-(x * x) / 4.5) for x in reach)
    for x, y in ((0, 0), (1, 0), (2, 3), (5, -5), (6, 0)):
        expected = exp(-(x * x + y * y) / 4.5) / total**2 if max(abs(x), abs(y)) <= 5 else 0.0
        assert float(smoothed[15 + y, 15 + x]) == pytest.approx(expected, abs=3e-8)  # measured 5.8e-9


def test_no_smoothing_changes_nothing():
    values = torch.rand(9, 4)

    assert smooth(values, torch.ones(3, 3, dtype=torch.bool), 0.0) is values


# Images.


class Beside(View):
    """A point in front of a half-space, with its normal along z."""

    def mask(self):
        return torch.ones(1, 1, dtype=torch.bool)

    def points(self):
        return point()

    def scene(self):
        return HalfOpen()


def method(**options):
    return gb.method("filtered_importance_sampling", visibility="spherical_harmonics", **options)


def test_half_of_a_constant_sky_is_visible():
    light, material = gb.light("constant", radiance=2.0, resolution=8), gb.material("kurt", ks=0.0, kd=(0.8, 0.5, 0.2))
    options = {"visibility_samples": 4096, "visibility_directions": "uniform", "visibility_smoothing": 0.0}

    image = shade(method(**options), light, material, Beside(), time_it=False)

    np.testing.assert_allclose(image.radiance[0, 0].numpy(), [0.8, 0.5, 0.2], rtol=3e-4)  # measured 6.2e-5


@cache
def scene():
    light = gb.light("spots", seed=7, resolution=32)
    view, material = gb.view("mesh", shape="torus_knot", resolution=24), gb.material("kurt", m=0.3, kd=0.3)
    return light, material, view, compute_reference(light, material, view, relative_error=2e-2, max_samples=1 << 13)


def error(**options):
    light, material, view, truth = scene()
    method = gb.method("filtered_importance_sampling", samples=64, **options)
    difference = shade(method, light, material, view, time_it=False).radiance - truth.radiance
    return float(difference[truth.mask].square().mean().sqrt() / truth.mean)


SH = {"visibility": "spherical_harmonics"}


def test_harmonics_are_nearer_to_the_reference_the_more_directions_are_tested():
    none, few, many = error(), error(**SH), error(**SH, visibility_samples=64)

    # Measured 0.43, 0.187 and 0.162, of which 0.13 is the filter's: 256 directions 0.153.
    assert few < 0.5 * none
    assert many < 0.9 * few


def test_images_notice_coefficients_of_other_points(monkeypatch):
    monkeypatch.setattr(chunks.PerPoint, "rows", lambda self, start, stop: self.values.flip(0)[start:stop])

    assert error(**SH, visibility_samples=64) > 0.7 * error()


def test_images_notice_a_cosine_that_counts_twice(monkeypatch):
    monkeypatch.setattr(
        harmonics, "evaluate_visibility", lambda c, d, cos_i: evaluate_visibility(c, d, torch.ones_like(cos_i))
    )

    assert error(**SH, visibility_samples=64) > 1.2 * 0.162


def test_chunks_take_their_own_points_coefficients(monkeypatch):
    light, material, view, _ = scene()
    whole = shade(method(), light, material, view, time_it=False).radiance
    monkeypatch.setattr(chunks, "CHUNK", 300)

    chunked = shade(method(), light, material, view, time_it=False).radiance

    torch.testing.assert_close(chunked, whole, rtol=2e-7, atol=0)  # measured 0


@pytest.mark.parametrize("footprint", ["isotropic", "affine"])
def test_on_a_sphere_harmonics_change_not_a_bit(footprint):
    light, material, _, _ = scene()
    sphere = gb.view("sphere", resolution=16)
    none = gb.method("filtered_importance_sampling", footprint=footprint)

    images = [shade(m, light, material, sphere, time_it=False).radiance for m in (none, method(footprint=footprint))]

    assert torch.equal(*images)
    assert images[0].any()


def test_a_new_view_or_shape_or_light_redoes_the_visibility_and_a_new_material_does_not():
    light, material, view, _ = scene()

    costs = shade(method(), light, material, view, time_it=False).costs

    spent = costs.stage_seconds["visibility_coefficients"]
    assert spent > 0
    assert all(costs.update_seconds[c] >= spent for c in ("light", "geometry", "view"))
    assert costs.update_seconds["material"] == 0
