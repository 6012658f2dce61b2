"""Sampling a light: its density against quadrature, its samples against its density."""

from math import pi, sqrt

import numpy as np
import pytest
import torch
from scipy import stats

import glossbench as gb
from glossbench.channels import LUMINANCE
from glossbench.directions import Vec3, points_2d, stack, vec3
from glossbench.envmap.cubemap import CubeMap, texel_directions
from glossbench.envmap.importance import luminance_distribution
from glossbench.envmap.pyramid import finest, lookup


def random_light():
    return CubeMap(torch.randn(6, 8, 8, 3, generator=torch.Generator().manual_seed(0)).exp())


LIGHTS = {
    "random": random_light,
    "one texel": lambda: gb.light("texel", resolution=16),
    "a texel in a corner of the cube": lambda: gb.light("texel", face=1, row=0, column=15, resolution=16),
    "spots": lambda: gb.light("spots", resolution=32),
    "gradient": lambda: gb.light("gradient", resolution=8),
    "black": lambda: gb.light("constant", radiance=0.0, resolution=8),
}
DETAIL = 8


def quadrature(resolution):
    """Directions (6, n, n) of a fine grid over the faces, and the exact solid angle of each of its cells."""
    d = texel_directions(resolution, DETAIL)
    edge = np.linspace(-1, 1, resolution * DETAIL + 1)
    corner = np.arctan2(edge[None] * edge[:, None], np.sqrt(edge[None] ** 2 + edge[:, None] ** 2 + 1))
    return d, np.diff(np.diff(corner, axis=0), axis=1)


def flat(d):
    return Vec3(*(c.reshape(-1) for c in d))


def pdf_on_grid(pdf, resolution):
    d, solid_angle = quadrature(resolution)
    return pdf(flat(d)).double().numpy().reshape(6, *solid_angle.shape), solid_angle


@pytest.mark.parametrize("name", LIGHTS)
def test_the_density_integrates_to_one(name):
    light = LIGHTS[name]()

    pdf, solid_angle = pdf_on_grid(luminance_distribution(light).pdf, light.resolution)

    # Measured 6e-5 at most at 8 x 8 cells a texel: the midpoint rule on 1 / major^3, at 8 texels an edge.
    assert (pdf * solid_angle).sum() == pytest.approx(1, abs=2e-4)


def chi_square(light, sample, pdf, n=1 << 16):
    """p-value of samples against a density, in bins of 1/2 texel; 0 if samples fall where there is none."""
    resolution = light.resolution
    on_grid, solid_angle = pdf_on_grid(pdf, resolution)
    half = DETAIL // 2
    n_bins = 2 * resolution
    expected = (on_grid * solid_angle).reshape(6, n_bins, half, n_bins, half).sum((2, 4)).reshape(-1)
    d = stack(sample(points_2d(n, "random", seed=11))).double().numpy()
    # Which bin, by the nearest of the six normals and the projection onto the face's own axes.
    edges = np.linspace(-1, 1, n_bins + 1)
    normals = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    right = np.array([[0, 0, 1], [0, 0, -1], [1, 0, 0], [1, 0, 0], [-1, 0, 0], [1, 0, 0]])
    down = np.array([[0, -1, 0], [0, -1, 0], [0, 0, -1], [0, 0, 1], [0, -1, 0], [0, -1, 0]])
    face = (d @ normals.T).argmax(1)
    depth = np.einsum("ij,ij->i", d, normals[face])
    s, t = (np.einsum("ij,ij->i", d, axis[face]) / depth for axis in (right, down))
    column, row = (np.clip(np.searchsorted(edges, c) - 1, 0, n_bins - 1) for c in (s, t))
    observed = np.bincount((face * n_bins + row) * n_bins + column, minlength=6 * n_bins**2)
    expected = expected / expected.sum() * n
    if observed[expected == 0].sum() > 5:  # of 65536; float32 places a few on the other side of a rim
        return 0.0
    large = expected >= 10
    pooled = [np.append(c[large], c[~large & (expected > 0)].sum()) for c in (observed, expected)]
    keep = pooled[1] > 0
    observed, expected = (c[keep] for c in pooled)
    return stats.chisquare(observed, expected * observed.sum() / expected.sum()).pvalue


# Six lights: Šidák's level for 1 % over all of them.
LEVEL = 1 - 0.99 ** (1 / len(LIGHTS))


@pytest.mark.parametrize("name", LIGHTS)
def test_samples_follow_the_density(name):
    light = LIGHTS[name]()
    distribution = luminance_distribution(light)

    p = chi_square(light, lambda u: distribution.sample(u)[0], distribution.pdf)

    # Measured 0.22 to 0.89.
    assert p > LEVEL


@pytest.mark.parametrize("fault", ["uniform texels", "no place inside the texel", "transposed", "rows alone"])
def test_the_chi_square_notices(fault):
    light = LIGHTS["random"]()
    distribution = luminance_distribution(light)
    uniform = luminance_distribution(LIGHTS["black"]())

    def sample(u):
        if fault == "uniform texels":
            return uniform.sample(u)[0]
        if fault == "rows alone":
            return distribution.sample(torch.stack([u[:, 0], u[:, 0]], 1))[0]
        d = distribution.sample(u)[0]
        if fault == "transposed":
            return d._replace(x=d.y, y=d.x)
        centres = stack(texel_directions(light.resolution)).reshape(-1, 3)
        return vec3(centres[(stack(d) @ centres.T).argmax(1)])

    p = chi_square(light, sample, distribution.pdf)

    assert p < 1e-9


@pytest.mark.parametrize("name", LIGHTS)
def test_a_sample_carries_the_density_of_its_direction(name):
    distribution = luminance_distribution(LIGHTS[name]())

    d, pdf = distribution.sample(points_2d(1 << 14, "random", seed=3))

    again = distribution.pdf(d)
    on_a_rim = (pdf / again - 1).abs() > 1e-5
    assert on_a_rim.double().mean().item() < 1e-3
    assert stack(d).norm(dim=1).sub(1).abs().max().item() < 1e-6


def check_no_sample_lacks_density(distribution, pdf_of):
    ends = torch.tensor([2.0**-24, 1 - 2.0**-24])
    inner = torch.linspace(0.01, 0.99, 500)
    u = torch.cat([torch.cartesian_prod(ends, inner), torch.cartesian_prod(inner, ends)])
    d, pdf = distribution.sample(u)
    assert (pdf_of(d, pdf) > 0).all()


@pytest.mark.parametrize("resolution", [16, 1024])
def test_a_sample_on_the_rim_of_the_light_has_a_density(resolution):
    distribution = luminance_distribution(gb.light("texel", resolution=resolution))

    check_no_sample_lacks_density(distribution, lambda d, pdf: pdf)


def test_the_rim_check_notices_a_density_read_at_the_rounded_direction():
    distribution = luminance_distribution(gb.light("texel", resolution=1024))

    with pytest.raises(AssertionError):
        check_no_sample_lacks_density(distribution, lambda d, pdf: distribution.pdf(d))


def estimate(light, distribution, n=1 << 16):
    """Mean of L / pdf a channel, and its standard error."""
    d, pdf = distribution.sample(points_2d(n, "random", seed=5))
    ratio = (lookup(finest(light), d) / pdf[:, None]).double().numpy()
    return ratio.mean(0), ratio.std(0) / sqrt(n)


def integral_of_interpolant(light):
    d, solid_angle = quadrature(light.resolution)
    radiance = lookup(finest(light), flat(d)).double().numpy().reshape(6, *solid_angle.shape, 3)
    return (radiance * solid_angle[None, ..., None]).sum((0, 1, 2))


@pytest.mark.parametrize("name", LIGHTS)
def test_radiance_over_density_is_the_integral_of_the_light(name):
    light = LIGHTS[name]()

    mean, error = estimate(light, luminance_distribution(light))

    exact = integral_of_interpolant(light)
    # Four standard errors, 6e-5 for each of 18 numbers (measured 2.3); and the quadrature's own, up to 3e-4.
    assert (np.abs(mean - exact) <= 4 * error + 5e-4 * exact).all()


def test_the_integral_notices_a_density_without_the_cube_of_the_distance():
    light = LIGHTS["gradient"]()
    distribution = luminance_distribution(light)
    d, pdf = distribution.sample(points_2d(1 << 16, "random", seed=5))
    major = stack(d).abs().amax(1)

    ratio = (lookup(finest(light), d) / (pdf * major)[:, None]).double().numpy()

    exact = integral_of_interpolant(light)
    assert (np.abs(ratio.mean(0) - exact) > 40 * ratio.std(0) / 256).all()


def check_positive_wherever_light_is(light, pdf):
    d = flat(quadrature(light.resolution)[0])
    lit = lookup(finest(light), d).amax(1) > 0
    assert lit.any()
    assert (pdf(d)[lit] > 0).all()


@pytest.mark.parametrize("name", ["one texel", "a texel in a corner of the cube", "spots", "random"])
def test_the_density_is_positive_wherever_the_interpolant_is(name):
    light = LIGHTS[name]()

    check_positive_wherever_light_is(light, luminance_distribution(light).pdf)


def test_the_check_notices_a_density_of_the_texels_alone():
    light = LIGHTS["one texel"]()

    with pytest.raises(AssertionError):
        check_positive_wherever_light_is(light, lambda d: (lookup(finest(light), d).amax(1) > 900).float())


def test_a_black_light_is_sampled_uniformly():
    light = LIGHTS["black"]()

    pdf, solid_angle = pdf_on_grid(luminance_distribution(light).pdf, light.resolution)

    of_texel = (pdf * solid_angle).reshape(6, 8, DETAIL, 8, DETAIL).sum((2, 4))
    expected = solid_angle.reshape(8, DETAIL, 8, DETAIL).sum((1, 3)) / (4 * pi)
    # Measured 2e-4, the midpoint rule.
    np.testing.assert_allclose(of_texel, np.broadcast_to(expected, of_texel.shape), rtol=6e-4)


@pytest.mark.parametrize("channel", range(3))
def test_a_texel_is_weighed_by_its_luminance(channel):
    faces = torch.zeros(6, 8, 8, 3)
    faces[4, 4, 4, channel] = 1
    faces[5, 4, 4] = 1
    distribution = luminance_distribution(CubeMap(faces))

    colored, white = distribution.pdf(vec3(torch.tensor([[-0.05, -0.05, 1.0], [0.05, -0.05, -1.0]])))

    # Rec. 709.
    assert (colored / white).item() == pytest.approx([0.2126, 0.7152, 0.0722][channel], rel=1e-5)
    assert sum(LUMINANCE) == pytest.approx(1)
