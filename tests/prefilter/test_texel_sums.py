"""Round lobes, and a light under them as a sum over texels: densities, the BRDF they stand for, float64 sums."""

from math import pi

import numpy as np
import pytest
import torch

from glossbench.brdf.ggx import GGX
from glossbench.directions import Vec3, spherical, stack
from glossbench.envmap.cubemap import texel_directions, texel_solid_angles
from glossbench.envmap.lights.synthetic import Constant, Spots
from glossbench.prefilter.pyramids import build_pyramid
from glossbench.prefilter.round_lobes import ROUND_LOBES, RoundCosine, RoundGGX
from glossbench.prefilter.texel_sums import sum_over_level, sum_over_tree

ALPHAS = (0.05, 0.3, 1.0)


def alpha(value):
    return torch.tensor(value, dtype=torch.float64)


@pytest.mark.parametrize("shape", ROUND_LOBES)
@pytest.mark.parametrize("width", ALPHAS)
def test_density_is_that_of_the_samples(shape, width):
    lobe, u = ROUND_LOBES[shape](alpha(width)), torch.linspace(1e-3, 0.99, 2001, dtype=torch.float64)

    away, pdf = lobe.sample(u)

    # A ring has the solid angle 2 pi d(away), and holds the share du of all samples. Measured 1e-5 at most.
    share = 2 * pi * ((pdf[1:] + pdf[:-1]) / 2 * away.diff()).cumsum(0)
    assert torch.allclose(share, u[1:] - u[0], rtol=1e-4)


@pytest.mark.parametrize("shape", ROUND_LOBES)
def test_density_is_that_of_the_samples_notices_a_width_that_is_off_by_2_percent(shape):
    u = torch.linspace(1e-3, 0.99, 2001, dtype=torch.float64)

    away, _ = ROUND_LOBES[shape](alpha(0.3)).sample(u)
    pdf = ROUND_LOBES[shape](alpha(0.306)).sample(u)[1]

    share = 2 * pi * ((pdf[1:] + pdf[:-1]) / 2 * away.diff()).cumsum(0)
    assert not torch.allclose(share, u[1:] - u[0], rtol=1e-4)


def brdf_times_cosine(width, theta):
    """GGX seen along the normal, F = 1, relative to its peak."""
    wo = Vec3(*(torch.tensor([c]) for c in (0.0, 0.0, 1.0)))
    wi = spherical(theta, torch.zeros_like(theta))
    material = GGX(alpha=(width, width), f0=(1.0, 1.0, 1.0))
    value = material.f(wo, wi)[0] * wi.z
    return value / (material.f(wo, wo)[0])


@pytest.mark.parametrize("width", ALPHAS)
def test_ggx_with_g2_is_the_brdf_times_cosine_for_a_view_along_the_normal(width):
    theta = torch.linspace(0.01, 1.55, 50)

    value = RoundGGX(torch.tensor(width), "g2").value(1 - theta.cos())

    assert torch.allclose(value, brdf_times_cosine(width, theta), rtol=1e-4)  # measured 1e-5
    assert not torch.allclose(
        RoundGGX(torch.tensor(width), "cos").value(1 - theta.cos()), brdf_times_cosine(width, theta), rtol=1e-4
    )


def test_cosine_power_is_the_power_of_the_cosine():
    lobe = RoundCosine(torch.tensor(0.2))

    assert float(lobe.p) == pytest.approx(12.0, rel=1e-6)
    assert float(lobe.value(torch.tensor(0.25))) == pytest.approx(0.75**12, rel=1e-5)
    assert float(lobe.value(torch.tensor(1.1))) == 0


# Sums over texels


def spots(resolution=32):
    return Spots(seed=7, resolution=resolution).cubemap()


def summed_by_hand(light, width, r):
    """In float64 and numpy: D(h) G2(l) at n = wo = R, Walter et al. 2007 eq. 33 and Heitz 2014 eq. 99."""
    w = np.broadcast_to(texel_solid_angles(light.resolution).numpy(), light.faces.shape[:3]).reshape(-1)
    d = stack(Vec3(*(c.double() for c in texel_directions(light.resolution)))).reshape(-1, 3).numpy()
    L = light.faces.double().numpy().reshape(-1, 3)
    found = []
    for axis in r.double().numpy():
        c = d @ axis
        h2 = ((d + axis) / np.linalg.norm(d + axis, axis=1, keepdims=True) @ axis) ** 2
        D = width**2 / (np.pi * (h2 * (width**2 - 1) + 1) ** 2)
        big_lambda = (np.sqrt(1 + width**2 * (1 - c**2) / np.maximum(c, 1e-9) ** 2) - 1) / 2
        k = np.where(c > 0, D / (1 + big_lambda), 0) * w
        found.append(k @ L / k.sum())
    return torch.tensor(np.array(found))


@pytest.mark.parametrize("width", [0.1, 0.4])
def test_sum_over_a_level_is_the_float64_sum_over_its_texels(width):
    light = spots()
    r = stack(texel_directions(4)).reshape(-1, 3)

    found = sum_over_level(build_pyramid(light, "box"), RoundGGX(torch.tensor(width), "g2"), 4, 32).reshape(-1, 3)

    expected = summed_by_hand(light, width, r)
    assert torch.allclose(found.double(), expected, rtol=2e-5)  # measured 4e-6
    assert not torch.allclose(found.double(), summed_by_hand(light, 1.001 * width, r), rtol=2e-5)


@pytest.mark.parametrize("width", [0.05, 0.2, 0.8])
def test_sum_over_the_tree_is_near_the_sum_over_all_texels(width):
    light = spots(64)
    lobe, source = RoundGGX(torch.tensor(width), "g2"), build_pyramid(light, "box")

    tree = sum_over_tree(light, source, lobe, 16)

    every = sum_over_level(source, lobe, 16, 64)
    coarse = sum_over_level(source, lobe, 16, 16)
    assert relative_rms(tree, every) < 2e-3  # measured 2e-4, 1.2e-3, 8e-4; texels of 16^2: 0.21, 0.019, 0.005
    assert relative_rms(coarse, every) > 4e-3


def relative_rms(a, b):
    return float((a - b).square().mean().sqrt() / b.mean())


@pytest.mark.parametrize("shape", ROUND_LOBES)
@pytest.mark.parametrize("width", [1e-3, 0.1, 1.0])
def test_constant_light_gives_constant_sums(shape, width):
    light = Constant(radiance=(1.0, 2.0, 3.0), resolution=16).cubemap()
    lobe, source = ROUND_LOBES[shape](torch.tensor(width), "cos"), build_pyramid(light, "box")

    for found in (sum_over_tree(light, source, lobe, 8), sum_over_level(source, lobe, 8, 16)):
        assert torch.allclose(found, torch.tensor([1.0, 2.0, 3.0]).expand(6, 8, 8, 3), rtol=1e-5)
