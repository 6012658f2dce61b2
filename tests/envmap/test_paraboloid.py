"""Dual paraboloids: directions, solid angles and the lookup of a smooth light."""

import numpy as np
import pytest
import torch

import glossbench as gb
from glossbench.directions import Vec3, stack, vec3
from glossbench.envmap.paraboloid import SCALE, paraboloid_directions
from glossbench.envmap.pyramid import lookup
from glossbench.prefilter.pyramids import build_paraboloid


def random_directions(n, seed=0):
    v = np.random.default_rng(seed).normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def on_the_paraboloid(image, s, t):
    """By the optics: the paraboloid (1 - x^2 - y^2) / 2 mirrors a ray along its axis into d."""
    x, y = 1.2 * s, -1.2 * t
    normal = np.stack([x, y, np.ones_like(x)], -1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    axis = np.array([0.0, 0.0, 1.0])
    d = 2 * (normal @ axis)[..., None] * normal - axis
    return d * np.array([1, 1, 1 if image == 1 else -1])


def gradient(d):
    return (1 + d) / 2


def test_texels_show_what_a_parabolic_mirror_shows():
    resolution = 16

    d = stack(paraboloid_directions(resolution)).numpy()

    at = (np.arange(resolution) * 2 + 1) / resolution - 1
    t, s = np.meshgrid(at, at, indexing="ij")
    for image in (0, 1):
        # Measured 3e-8: float32.
        np.testing.assert_allclose(d[image], on_the_paraboloid(image, s, t), atol=2e-7)


def test_a_texel_of_each_hemisphere_is_found_again_by_its_direction():
    resolution = 32
    paraboloid = build_paraboloid(gb.light("constant", resolution=resolution // 2), "box")
    d = paraboloid_directions(resolution)
    own = (d.z >= 0) == torch.tensor([False, True])[:, None, None]

    taps = paraboloid.taps(Vec3(*(c[own][:, None] for c in d)), None)

    rows, weights = (torch.stack(list(c), dim=1)[..., 0] for c in taps)
    image, row, column = torch.nonzero(own, as_tuple=True)
    expected = (image * (resolution + 2) + row + 1) * (resolution + 2) + column + 1
    # In float32 a texel's centre may be a hair to either side: the texel is the one with all the weight.
    largest = weights.argmax(1, keepdim=True)
    assert torch.equal(rows.gather(1, largest)[:, 0].long(), expected)
    # Measured 5e-6.
    assert weights.max(1).values.min().item() > 1 - 5e-5
    assert own.sum().item() > 2 * 0.5 * resolution**2


def check_jacobian(steradians_of):
    """Solid angle of a small square of the image by finite differences, |z| from 0 to 1."""
    rng = np.random.default_rng(0)
    radius, phi, e = np.sqrt(rng.uniform(0, 1, 100)) / 1.2, rng.uniform(0, 2 * np.pi, 100), 1e-5
    s, t = radius * np.cos(phi), radius * np.sin(phi)
    for image in (0, 1):
        along_s = on_the_paraboloid(image, s + e, t) - on_the_paraboloid(image, s - e, t)
        along_t = on_the_paraboloid(image, s, t + e) - on_the_paraboloid(image, s, t - e)
        # The image [-1, 1]^2 has four times the area of the unit square.
        expected = 4 * np.linalg.norm(np.cross(along_s, along_t), axis=1) / (2 * e) ** 2
        d = on_the_paraboloid(image, s, t)
        # Measured 4e-7: log2 in float32.
        np.testing.assert_allclose(steradians_of(d), expected, rtol=2e-6)


def test_the_density_of_texels_is_that_of_finite_differences():
    paraboloid = build_paraboloid(gb.light("constant", resolution=16), "box")

    def steradians_of(d):
        log2_count = paraboloid.log2_texels_per_sr(vec3(torch.tensor(d).float())).double().numpy()
        return 32**2 / 2**log2_count

    check_jacobian(steradians_of)


@pytest.mark.parametrize("fault", ["no square", "no scale"])
def test_the_jacobian_check_notices(fault):
    def steradians_of(d):
        z = np.abs(d[:, 2])
        return 4 * 1.44 * (z + 1) if fault == "no square" else 4 * (z + 1) ** 2

    with pytest.raises(AssertionError):
        check_jacobian(steradians_of)


def rim(n, z):
    phi = np.linspace(0, 2 * np.pi, n, endpoint=False)
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), np.full(n, z)], 1)


DIRECTIONS = np.concatenate([random_directions(500), *(rim(64, z) for z in (-1e-6, 0.0, 1e-6)), np.eye(3), -np.eye(3)])


def check_lookup(radiance_at):
    radiance = radiance_at(vec3(torch.tensor(DIRECTIONS).float()))

    # Measured 4e-4 at 64 texels an edge of the cube, twice interpolated; falls with its square.
    np.testing.assert_allclose(radiance.numpy(), gradient(DIRECTIONS), atol=1e-3)


@pytest.mark.parametrize("mip_filter", ["box", "gauss6"])
def test_a_smooth_light_is_found_in_all_directions_and_on_the_rim(mip_filter):
    paraboloid = build_paraboloid(gb.light("gradient", resolution=64), mip_filter)

    check_lookup(lambda d: lookup(paraboloid, d, torch.zeros_like(d.x)))


@pytest.mark.parametrize("flipped", ["x", "y", "z"])
def test_the_lookup_check_notices_a_flipped_axis(flipped):
    paraboloid = build_paraboloid(gb.light("gradient", resolution=64), "box")

    with pytest.raises(AssertionError):
        check_lookup(lambda d: lookup(paraboloid, d._replace(**{flipped: -getattr(d, flipped)})))


def test_the_error_of_the_lookup_falls_with_the_square_of_the_resolution():
    errors = []
    for resolution in (16, 64):
        paraboloid = build_paraboloid(gb.light("gradient", resolution=resolution), "box")
        radiance = lookup(paraboloid, vec3(torch.tensor(DIRECTIONS).float())).numpy()
        errors.append(np.abs(radiance - gradient(DIRECTIONS)).max())

    order = np.log(errors[0] / errors[1]) / np.log(4)

    # Measured 5.0e-3 and 3.7e-4: 1.87.
    assert order == pytest.approx(2, abs=0.2)


@pytest.mark.parametrize("mip_filter", ["box", "gauss4", "gauss6"])
def test_a_constant_light_stays_constant_at_every_level(mip_filter):
    paraboloid = build_paraboloid(gb.light("constant", radiance=[0.1, 2.5, 1e4], resolution=16), mip_filter)
    d = vec3(torch.tensor(DIRECTIONS).float())

    for level in range(6):
        radiance = lookup(paraboloid, d, torch.full_like(d.x, float(level)))
        # Measured 2e-7: float32.
        torch.testing.assert_close(radiance, torch.tensor([0.1, 2.5, 1e4]).expand_as(radiance), rtol=2e-6, atol=0)


def test_both_images_have_twice_the_edge_of_a_cube_face():
    paraboloid = build_paraboloid(gb.light("constant", resolution=16), "box")

    assert paraboloid.sizes.tolist() == [32, 16, 8, 4, 2, 1]
    assert pytest.approx(1.2) == SCALE
