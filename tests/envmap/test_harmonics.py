"""Spherical harmonics: the basis against scipy's, irradiance against closed forms."""

from math import pi, sqrt

import numpy as np
import pytest
import torch
from scipy.special import sph_harm_y

import glossbench as gb
from glossbench.directions import stack, vec3
from glossbench.envmap.cubemap import CubeMap, texel_directions
from glossbench.envmap.harmonics import irradiance, irradiance_coefficients, project, sh_basis

ORDER = 6  # bands 0 to 5


def random_directions(n, seed=0):
    v = np.random.default_rng(seed).normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def check_basis(basis, d):
    """Against scipy's complex harmonics in their real form, the Condon-Shortley phase taken out."""
    theta, phi = np.arccos(d[:, 2]), np.arctan2(d[:, 1], d[:, 0])
    for l in range(ORDER):  # noqa: E741
        for m in range(-l, l + 1):
            y = sph_harm_y(l, abs(m), theta, phi) * (-1) ** m
            expected = y.real if m == 0 else sqrt(2) * (y.real if m > 0 else y.imag)
            # Measured 1.3e-15 in float64.
            np.testing.assert_allclose(basis[l * l + l + m].numpy(), expected, atol=1e-14)


def test_the_basis_is_that_of_scipy_in_its_real_form():
    d = random_directions(200)

    basis = sh_basis(vec3(torch.tensor(d)), ORDER)

    assert len(basis) == ORDER**2
    check_basis(basis, d)


@pytest.mark.parametrize("fault", ["phase", "order of m", "flipped z"])
def test_the_check_of_the_basis_notices(fault):
    d = random_directions(50)
    basis = sh_basis(vec3(torch.tensor(d * [1, 1, -1 if fault == "flipped z" else 1])), ORDER)
    if fault == "phase":
        basis[3] = -basis[3]
    elif fault == "order of m":
        basis[4], basis[8] = basis[8], basis[4]

    with pytest.raises(AssertionError):
        check_basis(basis, d)


def test_the_basis_is_orthonormal():
    # Gauss-Legendre in z times the trapezoid in azimuth: exact for polynomials of this degree.
    z, weight = np.polynomial.legendre.leggauss(ORDER + 1)
    phi = np.arange(2 * ORDER) * pi / ORDER
    z, phi = (c.ravel() for c in np.meshgrid(z, phi, indexing="ij"))
    weight = np.repeat(weight, 2 * ORDER) * pi / ORDER
    d = np.stack([np.sqrt(1 - z * z) * np.cos(phi), np.sqrt(1 - z * z) * np.sin(phi), z], 1)

    basis = torch.stack(sh_basis(vec3(torch.tensor(d)), ORDER)).numpy()

    # Measured 3e-15.
    np.testing.assert_allclose((basis * weight) @ basis.T, np.eye(ORDER**2), atol=3e-14)


def test_projection_gives_back_the_coefficients_of_a_light_made_of_the_basis():
    expected = np.random.default_rng(0).uniform(-0.1, 0.1, (16, 3))
    expected[0] = 4
    d = texel_directions(64)
    basis = torch.stack(sh_basis(d, 4), dim=-1).double()
    light = CubeMap((basis @ torch.tensor(expected)).float())

    coefficients = project(light, 4)

    # Measured 1.2e-5: a texel's centre represents the texel.
    np.testing.assert_allclose(coefficients.numpy(), expected, atol=5e-5)


def test_the_irradiance_of_a_constant_is_pi_times_it():
    n = vec3(torch.tensor(random_directions(50)).float())
    light = gb.light("constant", radiance=[1.0, 2.0, 3.0], resolution=32)

    e = irradiance(irradiance_coefficients(light), n)

    # Measured 1e-7: float32.
    np.testing.assert_allclose(e.numpy(), pi * np.array([[1, 2, 3]]).repeat(50, 0), rtol=1e-6)


def check_gradient(coefficients_of):
    """Of L_c = radiance (1 + d_c) / 2: E_c = radiance pi / 2 (1 + 2 n_c / 3)."""
    normals = random_directions(50)
    light = gb.light("gradient", radiance=2.0, resolution=32)

    e = irradiance(coefficients_of(light), vec3(torch.tensor(normals).float()))

    # Measured 6e-7: float32.
    np.testing.assert_allclose(e.numpy(), pi * (1 + 2 * normals / 3), atol=3e-6)


def test_the_irradiance_of_a_gradient_is_the_closed_form():
    check_gradient(irradiance_coefficients)


@pytest.mark.parametrize("fault", ["no cosine", "flipped axis"])
def test_the_gradient_check_notices(fault):
    def wrong(light):
        if fault == "no cosine":
            return (pi * project(light, 3)).float()
        return irradiance_coefficients(CubeMap(light.faces[[1, 0, 2, 3, 4, 5]]))

    with pytest.raises(AssertionError):
        check_gradient(wrong)


def test_the_irradiance_of_a_cosine_lobe_is_the_closed_form_of_its_first_three_bands():
    a = np.array([2.0, -1.0, 2.0]) / 3
    normals = np.concatenate([a[None], -a[None], random_directions(50)])
    lobe = (stack(texel_directions(64)) @ torch.tensor(a).float()).clamp(min=0)[..., None].repeat(1, 1, 1, 3)

    e = irradiance(irradiance_coefficients(CubeMap(lobe)), vec3(torch.tensor(normals).float())).numpy()

    cos = normals @ a
    # sum of A_l^2 (2 l + 1) / (4 pi) P_l(cos), A = pi, 2 pi / 3, pi / 4.
    bands = pi / 4 + pi / 3 * cos + 5 * pi / 64 * (3 * cos**2 - 1) / 2
    # Measured 4e-5: the sum over texel centres.
    np.testing.assert_allclose(e, bands[:, None].repeat(3, 1), atol=1.5e-4)
    # Lost against (2/3) (sin g + (pi - g) cos g) are the bands above 2: A_4^2 9 / (4 pi) = 0.012 first.
    angle = np.arccos(np.clip(cos, -1, 1))
    lost = 2 / 3 * (np.sin(angle) + (pi - angle) * np.cos(angle)) - e[:, 0]
    assert 0.01 < np.abs(lost).max() < 0.02
