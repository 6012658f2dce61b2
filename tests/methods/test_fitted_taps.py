"""Fitted taps: the stated residual is that of a sum over the sphere, and the map is near the sum over all texels."""

from math import pi

import pytest
import torch

from glossbench.brdf.ggx import GGX
from glossbench.directions import stack
from glossbench.envmap.lights.synthetic import Spots
from glossbench.methods.fitted_taps import RINGS, SPREAD, filter_by_taps, fit_taps
from glossbench.prefilter.pyramids import build_pyramid
from glossbench.prefilter.round_lobes import RoundGGX
from glossbench.prefilter.texel_sums import sum_over_tree

ALPHA = 0.4


def taps(alpha=ALPHA, n=16):
    return fit_taps(GGX(alpha=alpha).reflectance().lobes[0], RINGS[n])


def residual_by_hand(fit, alpha, n=40_000):
    """Over the sphere, in closed form: D(h) G2 / 4 of GGX and a sum of Gaussians, both of integral 1."""
    k = torch.arange(n, dtype=torch.float64) + 0.5
    z, phi = 1 - 2 * k / n, k * (pi * (3 - 5**0.5))
    d = torch.stack([torch.sqrt(1 - z * z) * phi.cos(), torch.sqrt(1 - z * z) * phi.sin(), z], dim=1)
    slope = (1 + z) / 2 * (alpha**2 - 1) + 1
    lobe = torch.where(z > 0, z / (z + torch.sqrt(alpha**2 + (1 - alpha**2) * z * z)) / slope**2, 0.0)
    kappa = fit.deviation.double() ** -2
    peak = fit.weight.double() * kappa / (2 * pi * -torch.expm1(-2 * kappa))
    model = (peak * torch.exp(kappa * (d @ stack(fit.direction)[0].double().T - 1))).sum(1)
    model = model * (model @ lobe) / (model @ model)
    return float((model - lobe).norm() / lobe.norm())


@pytest.mark.parametrize(("alpha", "n"), [(0.2, 16), (0.8, 8)])
def test_the_residual_is_that_of_a_sum_over_the_sphere(alpha, n):
    fit = taps(alpha, n)

    # Measured: 5e-4 apart; with half of alpha, 0.38 or more.
    assert abs(residual_by_hand(fit, alpha) - float(fit.residual)) < 2e-3
    assert residual_by_hand(fit, alpha / 2) > 0.1


def error_of_map(levels=0.0):
    """Of a map against the sum over all texels, relative, with taps that read other levels."""
    light = Spots(seed=7, resolution=64, contrast=30.0).cubemap()
    exact = sum_over_tree(light, build_pyramid(light, "box"), RoundGGX(torch.tensor(ALPHA), "g2"), 8)
    spread = SPREAD["gauss4"] * 2**-levels
    return float((filter_by_taps(taps(), build_pyramid(light, "gauss4"), 8, spread) - exact).norm() / exact.norm())


def test_the_map_is_near_the_sum_over_all_texels():
    # Measured: 0.0095.
    assert error_of_map() < 0.02


@pytest.mark.parametrize("levels", [-1.5, 1.0])
def test_taps_of_another_level_are_noticed(levels):
    # Measured: 0.038, 0.064.
    assert error_of_map(levels) > 0.02
