"""Ambient occlusion: openness against closed forms within confidence bounds, and the method against its parts."""

import sys
from math import pi, sqrt

import numpy as np
import pytest
import torch
from scipy.stats import t as student

import glossbench as gb
from glossbench.directions import Vec3, normalize, stack, vec3
from glossbench.methods.ambient_occlusion import AmbientOcclusion
from glossbench.methods.ambient_occlusion.openness import openness
from glossbench.scene.mesh import make_mesh
from glossbench.scene.points import ShadingPoints
from glossbench.scene.sphere import UnitSphere
from glossbench.shading.image import shade

SEEDS = 40
N_POINTS = 12
N_RAYS = 50  # of 64 strata nearly a whole number sees past the disc, and seeds would agree


def facing(position, n):
    """Points (P,) with normals n, their tangents any."""
    n = normalize(vec3(torch.tensor(n).float()))
    side = torch.tensor([0.36, 0.48, 0.8]).expand(len(position), 3)
    t = normalize(vec3(torch.linalg.cross(side, stack(n))))
    b = vec3(torch.linalg.cross(stack(n), stack(t)))
    return ShadingPoints(t, b, n, n, vec3(torch.tensor(position).float()), n)


def half_ball():
    """The lower half of the unit sphere, its middle moved to (0, 1/2, 0)."""
    theta, phi = np.linspace(pi / 2, pi, 97)[:, None], np.arange(384) * 2 * pi / 384
    vertices = np.stack(np.broadcast_arrays(np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)), 2)
    i, j = (k.reshape(-1) for k in np.meshgrid(np.arange(96), np.arange(384), indexing="ij"))
    a, b, c, d = (r * 384 + k % 384 for r, k in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)[i < 95]])
    return make_mesh(vertices.reshape(-1, 3), faces)


def disc_over_plane():
    """A disc of radius 0.6 at height 1/2, its middle over that of the square [-1, 1]^2 at -1/2."""
    phi = np.arange(720) * 2 * pi / 720
    rim = np.stack([0.6 * np.cos(phi), 0 * phi + 0.5, 0.6 * np.sin(phi)], axis=1)
    square = np.array([[-1, -0.5, -1], [-1, -0.5, 1], [1, -0.5, 1], [1, -0.5, -1]])
    k = np.arange(720)
    fan = np.stack([k * 0 + 724, (k + 1) % 720 + 4, k + 4], axis=1)
    vertices = np.concatenate([square, rim, [[0, 0.5, 0]]])
    return make_mesh(vertices, np.concatenate([[[0, 1, 2], [0, 2, 3]], fan]))


def worst_t(mesh, points, expected):
    """Largest |mean over seeds - expected| over its standard error."""
    found = torch.stack([openness(mesh, points, N_RAYS, seed) for seed in range(SEEDS)]).double()
    error = found.std(0) / sqrt(SEEDS)
    return float(((found.mean(0) - expected).abs() / error).max())


# Passed by 12 points together with 99 %.
LIMIT = student.isf((1 - 0.99 ** (1 / N_POINTS)) / 2, SEEDS - 1)


def disc_case():
    """On the axis a disc of radius R at distance h takes R^2 / (R^2 + h^2)."""
    mesh = disc_over_plane()
    points = facing(np.tile([0.0, -0.5, 0.0], (N_POINTS, 1)), np.tile([0.0, 1, 0], (N_POINTS, 1)))
    return mesh, points, 1 - 0.36 / (0.36 + 1)


def half_ball_case():
    """From anywhere on a sphere each part of it is seen by its share of the area: the missing half of it, by 1/2."""
    rng = np.random.default_rng(3)
    phi, height = rng.uniform(0, 2 * pi, N_POINTS), rng.uniform(-0.95, -0.1, N_POINTS)
    out = np.stack([np.sqrt(1 - height**2) * np.cos(phi), height, np.sqrt(1 - height**2) * np.sin(phi)], axis=1)
    # The polyhedron lies up to 1e-4 within the sphere.
    return half_ball(), facing(0.9997 * out + [0, 0.5, 0], -out), 0.5


@pytest.mark.parametrize("case", [disc_case, half_ball_case])
def test_openness_is_the_closed_form(case):
    mesh, points, expected = case()

    assert worst_t(mesh, points, expected) < LIMIT


@pytest.mark.parametrize("case", [disc_case, half_ball_case])
def test_the_openness_check_notices_rays_without_the_cosine(case, monkeypatch):
    def uniform(u):
        r, phi = torch.sqrt(1 - u[:, 0] ** 2), 2 * pi * u[:, 1]
        return Vec3(r * torch.cos(phi), r * torch.sin(phi), u[:, 0])

    monkeypatch.setattr(sys.modules[openness.__module__], "cosine_hemisphere", uniform)
    mesh, points, expected = case()

    assert worst_t(mesh, points, expected) > LIMIT


def test_the_openness_check_notices_another_scene():
    _, points, expected = half_ball_case()

    assert worst_t(disc_over_plane(), points, expected) > LIMIT


def test_openness_is_one_where_nothing_hides():
    points = gb.view("sphere", resolution=8).points()

    assert torch.equal(openness(UnitSphere(), points, 16, 0), torch.ones(len(points)))


def test_openness_is_the_same_for_the_same_seed_and_another_for_another():
    mesh, points, _ = disc_case()

    first, again, other = (openness(mesh, points, 64, seed) for seed in (1, 1, 2))

    assert torch.equal(first, again)
    assert not torch.equal(first, other)


VIEW = gb.view("mesh", shape="bowl", resolution=16)
MATERIAL = gb.material("phong", s=20, kd=0.3, ks=0.5)


def test_ambient_occlusion_is_the_open_scene_times_openness():
    light = gb.light("spots", seed=7, resolution=16)
    unhidden = shade(gb.method("partial_environment_maps"), light, MATERIAL, VIEW, time_it=False).radiance

    image = shade(AmbientOcclusion(rays=32, seed=5), light, MATERIAL, VIEW, time_it=False)

    factor = openness(VIEW.scene(), VIEW.points(), 32, 5)
    # Measured 0.
    torch.testing.assert_close(image.radiance[image.mask], factor[:, None] * unhidden[image.mask], rtol=2e-7, atol=0)
    assert 0.2 < factor.mean() < 0.9


def test_shadow_only_is_grey_and_of_the_mean_luminance():
    light = gb.light("spots", seed=7, resolution=16)
    material = gb.material("phong", ks=0.0, kd=1.0)

    image = shade(AmbientOcclusion(lighting="constant", rays=32), light, material, VIEW, time_it=False)

    mean = light.mean() @ torch.tensor([0.2126, 0.7152, 0.0722]).double()
    expected = openness(VIEW.scene(), VIEW.points(), 32, 0)[:, None] * mean.float()
    # Measured 1.5e-7.
    torch.testing.assert_close(image.radiance[image.mask], expected.expand(-1, 3), rtol=7e-7, atol=0)


def test_on_the_sphere_ambient_occlusion_is_the_open_scene():
    light, view = gb.light("spots", seed=7, resolution=16), gb.view("sphere", resolution=12)

    image, unhidden = (
        shade(gb.method(m), light, MATERIAL, view, time_it=False).radiance
        for m in ("ambient_occlusion", "partial_environment_maps")
    )

    assert torch.equal(image, unhidden)
