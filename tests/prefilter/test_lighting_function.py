from math import pi

import numpy as np
import pytest
import torch

from glossbench.brdf.cook_torrance import CookTorrance
from glossbench.brdf.kurt import Kurt
from glossbench.brdf.lafortune import Lafortune
from glossbench.brdf.phong import Phong
from glossbench.brdf.ward import Ward
from glossbench.directions import Vec3
from glossbench.envmap.cubemap import CubeMap, texel_directions, texel_solid_angles
from glossbench.envmap.lights.synthetic import Constant, Spots
from glossbench.errors import InputError
from glossbench.methods.lighting_factorization.monte_carlo import estimate_lighting_function
from glossbench.prefilter.lighting_function import anisotropy, sample_lighting_function, texel_weights
from glossbench.scene.virtual_cube import pair_points, tangent, valid_pairs, virtual_directions

COPPER = CookTorrance(m=(0.3, 0.3), f0=(0.95, 0.64, 0.54), kd=(0.1, 0.2, 0.3))


def random_light(resolution=4, seed=0):
    faces = torch.rand(6, resolution, resolution, 3, generator=torch.Generator().manual_seed(seed))
    return CubeMap(faces**4, f"random {seed}")


def cook_torrance(wo, wi, m=0.3, f0=(0.95, 0.64, 0.54), kd=(0.1, 0.2, 0.3)):
    """The model of the test, in plain numpy: one pair of directions of the local frame."""
    h = (wo + wi) / np.linalg.norm(wo + wi)
    c, cos2 = wo @ h, h[2] ** 2
    D = np.exp(-(1 - cos2) / cos2 / m**2) / (np.pi * m**2 * cos2**2)
    G = min(1, 2 * h[2] * wo[2] / c, 2 * h[2] * wi[2] / c)
    F = np.array(f0) + (1 - np.array(f0)) * (1 - c) ** 5
    return np.array(kd) / np.pi + F * D * G / (4 * wo[2] * wi[2])


def summed(light, n, v, weight, dropped_cosine=False):
    """Eq. 9's numerator texel by texel, in plain Python."""
    resolution, total = light.resolution, np.zeros(3)
    t = np.cross([0.3, 0.5, -0.8], n)
    t /= np.linalg.norm(t)
    frame = np.stack([t, np.cross(n, t), n])
    for face in range(6):
        d = np.stack([c[face].double().numpy() for c in texel_directions(resolution)], -1)
        for row in range(resolution):
            for column in range(resolution):
                wi = frame @ d[row, column]
                if wi[2] > 0:
                    cosine = 1.0 if dropped_cosine else wi[2]
                    value = cook_torrance(frame @ v, wi) * cosine * weight(face, row, column, resolution)
                    total += value * light.faces[face, row, column].double().numpy()
    return total


def exact(face, row, column, resolution):
    return float(texel_solid_angles(resolution)[row, column])


def eq_11(face, row, column, resolution):
    x, y = ((2 * i + 1) / resolution - 1 for i in (column, row))
    return (2 / resolution) ** 2 / (x * x + y * y + 1) ** 1.5


def largest_error(edge, weight, texel_weight, **fault):
    """Relative, over some pairs of all parts of the cube."""
    light = random_light()
    samples = sample_lighting_function(light, COPPER, edge, 4, texel_weight)
    d = virtual_directions(edge).numpy()
    errors = []
    for i in range(0, len(samples.pairs), 97):
        n, v = d[samples.pairs[i]]
        expected = summed(light, n, v, weight, **fault)
        errors.append(np.abs(samples.radiance[i].numpy() / expected - 1).max())
    return max(errors)


@pytest.mark.parametrize("edge", [3, 4])
def test_samples_are_the_sum_over_the_texels(edge):
    # Float32 values and directions: measured 1.3e-6.
    assert largest_error(edge, exact, "exact") < 1e-5
    assert largest_error(edge, eq_11, "differential") < 1e-5


def test_the_sum_notices_a_dropped_cosine_and_the_other_weight():
    assert largest_error(3, exact, "exact", dropped_cosine=True) > 0.1
    assert largest_error(3, eq_11, "exact") > 1e-3


@pytest.mark.parametrize("edge", [2, 5])
def test_pairs_are_all_those_above_the_horizon(edge):
    d = torch.stack([c.reshape(-1) for c in texel_directions(edge)], 1).double()

    pairs = valid_pairs(edge)

    expected = [(i, j) for i in range(len(d)) for j in range(len(d)) if float(d[i] @ d[j]) > 1e-6]
    assert pairs.tolist() == [list(pair) for pair in expected]


def test_a_virtual_cube_of_16_has_the_papers_number_of_samples():
    # "Several hundred thousand to a million": half of the squared number of texels, less what is at right angles.
    for edge in (12, 16):
        n_pairs = (6 * edge**2) ** 2 / 2
        assert 0.999 * n_pairs < len(valid_pairs(edge)) <= n_pairs


def test_constant_light_gives_the_directional_albedo():
    material = Phong(s=5.0, ks=(0.5, 0.5, 0.5), kd=(0.3, 0.3, 0.3))
    samples = sample_lighting_function(Constant(radiance=(2.0, 2.0, 2.0), resolution=64).cubemap(), material, 4)
    points = pair_points(4, samples.pairs)

    expected = 2 * material.albedo(points.wo_local())

    # The sum of 24576 texels against Hammersley points: measured 1e-4.
    assert float((samples.radiance / expected - 1).abs().max()) < 5e-4


def test_weights_of_eq_11_miss_the_sphere_by_what_they_approximate():
    assert float(texel_weights(64, "exact").sum()) == pytest.approx(4 * pi, rel=1e-12)
    missed = [abs(float(texel_weights(edge, "differential").sum()) / (4 * pi) - 1) for edge in (8, 16, 32)]
    # The midpoint rule: a quarter of the error at twice the edge.
    assert missed[0] / missed[1] == pytest.approx(4, rel=0.05)
    assert missed[1] / missed[2] == pytest.approx(4, rel=0.05)


def test_values_of_f_are_a_24th_of_the_sums_terms():
    samples = sample_lighting_function(random_light(8), COPPER, 4, 8)

    terms = len(samples.pairs) * 6 * 8**2 / 2

    assert samples.n_values == pytest.approx(terms / 24, rel=0.02)


def test_a_turned_light_gives_turned_samples_to_the_last_digits():
    light = random_light(4)
    # A half turn about +y: x and z change sign. Faces +x and -x, +z and -z trade places; +y and -y turn by 180 degrees.
    faces = light.faces[[1, 0, 2, 3, 5, 4]].clone()
    faces[2:4] = faces[2:4].flip(1, 2)
    d = virtual_directions(4)
    turned_d = d * torch.tensor([-1.0, 1.0, -1.0])
    index = (turned_d @ d.T).argmax(1)

    lo, turned_lo = (torch.zeros(96, 96, 3, dtype=torch.float64) for _ in range(2))
    for target, cube in ((lo, light), (turned_lo, CubeMap(faces, "turned"))):
        samples = sample_lighting_function(cube, COPPER, 4, 4)
        target[tuple(samples.pairs.T)] = samples.radiance

    torch.testing.assert_close(turned_lo[index][:, index], lo, rtol=1e-5, atol=1e-9)


def test_a_finer_light_is_averaged_without_losing_energy():
    light = Spots(resolution=32, contrast=100).cubemap()
    white = Phong(s=0.0, ks=(0.0, 0.0, 0.0), kd=(1.0, 1.0, 1.0))

    samples = [sample_lighting_function(light, white, 2, edge).radiance.mean(0) for edge in (32, 16, 10)]

    # Irradiance over all normals is the light's energy: measured 8e-5 (16), 9e-5 (10).
    for coarse in samples[1:]:
        torch.testing.assert_close(coarse, samples[0], rtol=5e-4, atol=0)


@pytest.mark.parametrize("material", [Kurt(m=(0.3, 0.1)), Ward(m=(0.1, 0.3)), Lafortune(C=(-1.0, -0.5, 1.0), s=10.0)])
def test_anisotropic_materials_have_a_reason(material):
    assert "anisotropic" in anisotropy(material)
    with pytest.raises(InputError, match="anisotropic"):
        sample_lighting_function(random_light(), material, 2)


@pytest.mark.parametrize("material", [COPPER, Kurt(m=(0.01, 0.01)), Ward(m=(0.2, 0.2)), Phong(s=400.0)])
def test_isotropic_materials_have_none(material):
    assert anisotropy(material) is None


def test_the_tangent_is_that_of_eq_6_and_singular_only_at_x():
    generator = torch.Generator().manual_seed(0)
    d = torch.nn.functional.normalize(torch.randn(100, 3, generator=generator, dtype=torch.float64), dim=1)
    x = torch.tensor([1.0, 0.0, 0.0]).double()

    t = torch.stack(tangent(Vec3(*d.T)), 1)

    expected = x - (d @ x)[:, None] * d
    torch.testing.assert_close(t, expected / expected.norm(dim=1, keepdim=True))
    for sign in (1.0, -1.0):
        at = tangent(Vec3(*(torch.tensor([v]).double() for v in (sign, 0.0, 0.0))))
        assert [float(c) for c in at] == [0.0, 1.0, 0.0]


def test_monte_carlo_agrees_within_its_error():
    light = Spots(resolution=16, contrast=20).cubemap()
    material = CookTorrance(m=(0.5, 0.5), f0=(0.9, 0.6, 0.5))

    estimated = estimate_lighting_function(light, material, 2, 64, seed=1)
    more = estimate_lighting_function(light, material, 2, 2048, seed=2)

    off = (estimated.radiance - more.radiance) / estimated.standard_error.clamp(min=1e-9)
    # Student's t of three degrees of freedom: its median is 0.76.
    assert 0.4 < float(off.abs().median()) < 1.2
    assert float(estimated.standard_error.mean()) > 2 * float(more.standard_error.mean())
