"""Spherical Gaussians: integrals with lobes against a sum over the sphere, and the fit of a light of few of them."""

from math import pi

import pytest
import torch

from glossbench.brdf.ggx import GGX
from glossbench.directions import Vec3, dot, spherical, stack
from glossbench.envmap.cubemap import CubeMap, texel_directions
from glossbench.methods import spherical_gaussians as module
from glossbench.methods.spherical_gaussians import filter_normals, fit_light, integrate_asg, integrate_product

N = 40_000  # directions of the sum


def sphere():
    k = torch.arange(N, dtype=torch.float64) + 0.5
    return spherical(torch.acos(1 - 2 * k / N), k * (pi * (3 - 5**0.5)))


def direction(theta, phi):
    return spherical(*(torch.tensor([v], dtype=torch.float64) for v in (theta, phi)))


def gaussian(d, axis, sharpness):
    return torch.exp(sharpness * (dot(d, axis) - 1))


@pytest.mark.parametrize(("a", "b", "apart"), [(5.0, 20.0, 0.3), (80.0, 20.0, 0.8), (300.0, 17.0, 0.1)])
def test_the_product_of_two_gaussians_integrates_as_stated(a, b, apart):
    p, q, d = direction(0.7, 0.2), direction(0.7 + apart, 0.2), sphere()

    found = integrate_product(p, torch.tensor(a).double(), q, torch.tensor(b).double())

    expected = (gaussian(d, p, a) * gaussian(d, q, b)).mean() * 4 * pi
    # Measured: at most 2e-7.
    torch.testing.assert_close(found[0], expected, rtol=1e-5, atol=0)


# The lobe of GGX without shadowing, 1 / (4 wo A wo) D, as a sum.


def lobe_of(alpha, wo, wi):
    """D(h) / (4 sqrt(a_x^2 o_x^2 + a_y^2 o_y^2 + o_z^2)), with the half vectors below the surface."""
    h = torch.stack(torch.broadcast_tensors(*(o + i for o, i in zip(wo, wi, strict=True))))
    h = h / h.norm(dim=0)
    a_x, a_y = alpha
    D = 1 / (pi * a_x * a_y * ((h[0] / a_x) ** 2 + (h[1] / a_y) ** 2 + h[2] ** 2) ** 2)
    return D / (4 * torch.sqrt((a_x * wo.x) ** 2 + (a_y * wo.y) ** 2 + wo.z**2))


def error_of_filtering(alpha, theta, away, sharpness=60.0):
    """Relative error against the sum, without the horizon."""
    wo, d = direction(theta, 0.4), sphere()
    p = direction(theta + away, 0.4 + pi)
    lobe = GGX(alpha=alpha).reflectance().lobes[0]

    found = filter_normals(lobe, wo, p, torch.tensor(sharpness).double())

    expected = (lobe_of(alpha, wo, d) * gaussian(d, p, sharpness)).mean() * 4 * pi
    return float((found / expected - 1).abs().max())


CASES = [((0.3, 0.3), 0.2, 0.0), ((0.4, 0.1), 0.5, 0.0), ((0.1, 0.4), 0.5, 0.1), ((0.2, 0.2), 0.9, 0.0)]


@pytest.fixture
def everything_above(monkeypatch):
    monkeypatch.setattr(module, "share_above", lambda cos, sharpness: torch.ones_like(cos))


@pytest.mark.usefixtures("everything_above")
@pytest.mark.parametrize("case", CASES)
def test_a_lobe_that_is_widened_is_near_the_sum(case):
    # Measured: 0.077, 0.165, 0.055, 0.178: the Jacobian is that at the normal, the lobe's is not constant.
    assert error_of_filtering(*case) < 0.2


@pytest.mark.usefixtures("everything_above")
def test_exchanged_widths_are_noticed():
    right = error_of_filtering((0.4, 0.1), 0.5, 0.0)
    wo, p = direction(0.5, 0.4), direction(0.5, 0.4 + pi)
    lobe = GGX(alpha=(0.1, 0.4)).reflectance().lobes[0]

    found = filter_normals(lobe, wo, p, torch.tensor(60.0).double())

    expected = (lobe_of((0.4, 0.1), wo, sphere()) * gaussian(sphere(), p, 60.0)).mean() * 4 * pi
    assert (found / expected - 1).abs() > 0.2 > right


@pytest.mark.usefixtures("everything_above")
def test_a_light_as_narrow_as_a_point_leaves_the_lobe_as_it_is():
    wo, p = direction(0.6, 0.4), direction(0.5, 3.3)
    sharpness = torch.tensor(1e6).double()
    lobe = GGX(alpha=(0.3, 0.1)).reflectance().lobes[0]

    found = filter_normals(lobe, wo, p, sharpness)

    # Measured: 1.4e-5.
    torch.testing.assert_close(found, lobe_of((0.3, 0.1), wo, p) * 2 * pi / sharpness, rtol=1e-4, atol=0)


def error_of_asg(theta):
    """Relative error of the anisotropic Gaussian against a sum of D at half vectors as a Gaussian."""
    wo, d, s, sharpness = direction(theta, 0.4), sphere(), 2 / 0.15**2, 100.0
    r = Vec3(-wo.x, -wo.y, wo.z)
    h = torch.stack(torch.broadcast_tensors(*(o + i for o, i in zip(wo, d, strict=True))))
    lobe = torch.exp(s * (h[2] / h.norm(dim=0) - 1))

    found = integrate_asg(wo, torch.tensor(s).double(), r, torch.tensor(sharpness).double())

    return float((found / ((lobe * gaussian(d, r, sharpness)).mean() * 4 * pi) - 1).abs()[0])


@pytest.mark.parametrize("theta", [0.0, 0.6, 1.0])
def test_an_anisotropic_gaussian_is_near_the_lobe(theta):
    # Measured: 3.8e-4, 5.2e-4, 1.2e-3.
    assert error_of_asg(theta) < 0.004


def test_an_anisotropic_gaussian_that_is_turned_is_noticed(monkeypatch):
    monkeypatch.setattr(module, "cross", lambda a, b: a)

    assert error_of_asg(1.0) > 0.004


def test_a_light_of_few_gaussians_is_fitted_exactly():
    d, n = texel_directions(32), 24
    axes = fit_light(CubeMap(torch.ones(6, 32, 32, 3), "flat"), n)
    true = torch.rand(n, 3, generator=torch.Generator().manual_seed(2))
    value = torch.exp(axes.sharpness * (stack(d) @ stack(axes.axis)[0].T - 1)) @ true

    fit = fit_light(CubeMap(value, "few"), n)

    # Measured: 2e-5.
    torch.testing.assert_close(fit.amplitude, true, rtol=0, atol=2e-4)
    assert (axes.amplitude >= 0).all()
