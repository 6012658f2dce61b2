"""Shadows of directional lights against closed forms: a disc over a plane, a half plane, and planted faults."""

from dataclasses import replace
from math import erf, pi, sqrt

import numpy as np
import pytest
import torch
import trimesh

import glossbench as gb
from glossbench.directions import Vec3, vec3
from glossbench.methods.many_lights import ManyLights
from glossbench.prefilter.light_shadows import NoShadows, RayShadows, build_variance_shadow_maps, cast
from glossbench.prefilter.median_cut import median_cut
from glossbench.scene.mesh import make_mesh
from glossbench.scene.points import Occluder, ShadingPoints, View
from glossbench.scene.shapes import bowl
from glossbench.scene.sphere import UnitSphere
from glossbench.shading.image import shade

CENTRE, RADIUS = np.array([0.25, 0.5, -0.1]), 0.4
TOWARD = np.array([[0.0, 1, 0], [0.3, 1, 0.1], [-0.2, 1, 0.5], [0.7, 1, -0.6]])
TOWARD /= np.linalg.norm(TOWARD, axis=1, keepdims=True)
LIGHTS = vec3(torch.tensor(TOWARD).float())
SMALL = torch.full((len(TOWARD),), 0.1)


def disc_over_plane():
    """A disc at height 1/2 over the square [-1, 1]^2 at -1/2; a far corner keeps the box where it is."""
    phi = np.arange(720) * 2 * pi / 720
    # A polygon of the disc's area.
    r = RADIUS * sqrt(2 * pi / 720 / np.sin(2 * pi / 720))
    rim = CENTRE + r * np.stack([np.cos(phi), 0 * phi, np.sin(phi)], axis=1)
    square = np.array([[-1, -0.5, -1], [-1, -0.5, 1], [1, -0.5, 1], [1, -0.5, -1]])
    k = np.arange(720)
    fan = np.stack([k * 0 + 724, (k + 1) % 720 + 4, k + 4], axis=1)
    return make_mesh(np.concatenate([square, rim, CENTRE[None]]), np.concatenate([[[0, 1, 2], [0, 2, 3]], fan]))


def on_plane(n=4000, height=-0.5, seed=0):
    x, z = np.random.default_rng(seed).uniform(-0.98, 0.98, (2, n))
    return points_at(np.stack([x, np.full(n, height), z], axis=1))


def points_at(position, n=(0.0, 1.0, 0.0)):
    """Points (P, 1) with one normal."""
    frame = [Vec3(*(torch.full((len(position), 1), float(v)) for v in c)) for c in ((1, 0, 0), (0, 0, -1), n, n)]
    place = vec3(torch.tensor(position).float()[:, None])
    return ShadingPoints(*frame, place, frame[2])


def distance_from_edge(points):
    """Of the ray to each light from the disc's edge, where it crosses the disc's plane, negative inside: (P, N)."""
    p = torch.cat(list(points.position), 1).double().numpy()
    crossing = p[:, None] + (0.5 - p[:, None, 1:2]) / TOWARD[None, :, 1:2] * TOWARD[None]
    return np.linalg.norm(crossing - CENTRE, axis=2) - RADIUS


def check_disc(visible, points, doubt):
    edge = distance_from_edge(points)
    clear = np.abs(edge) > doubt
    assert clear.mean() > 0.9
    assert 0.05 < (edge < 0).mean() < 0.3
    # Measured 2.4e-5: the least variance, of half a texel, against a gap of 1.
    np.testing.assert_allclose(visible.numpy()[clear], (edge > 0)[clear], atol=1e-4)


def maps_of(mesh, resolution=256, distance=0.0, bleeding=0.0):
    return build_variance_shadow_maps(mesh, LIGHTS, SMALL, resolution, distance, bleeding)


# Half planes of texels: bilinear moments blur over one texel on each side, the disc's edge slants by up to 1 / cos.
TEXEL = 2 * 1.5 / 256 * 1.5


def test_shadow_maps_of_a_disc_are_its_parallel_projection():
    points = on_plane()

    visible = maps_of(disc_over_plane()).visible(points)

    check_disc(visible, points, TEXEL)


@pytest.mark.parametrize("row", [0, 1])
def test_the_disc_check_notices_a_flipped_image(row):
    maps, points = maps_of(disc_over_plane()), on_plane()
    sign = torch.ones(3, 1, 1)
    sign[row] = -1

    visible = replace(maps, placing=sign * maps.placing).visible(points)

    with pytest.raises(AssertionError):
        check_disc(visible, points, TEXEL)


def test_rays_of_a_disc_are_its_parallel_projection():
    points = on_plane()

    visible = RayShadows(Vec3(*(c[None] for c in LIGHTS)), disc_over_plane()).visible(points)

    # The polygon of 720 corners is 4e-6 from the circle.
    check_disc(visible, points, 1e-5)


def test_rays_are_those_of_the_mesh_for_each_light():
    mesh, view = bowl(), gb.view("mesh", shape="bowl", resolution=24)
    points = view.points()

    visible = RayShadows(Vec3(*(c[None] for c in LIGHTS)), mesh).visible(points.columns(0, len(points)))

    for light, toward in enumerate(TOWARD):
        direction = Vec3(*(torch.full((len(points),), v) for v in toward))
        expected = mesh.visible(points.position, points.ng, direction)
        assert torch.equal(visible[:, light], expected.float())
    assert 0.1 < visible.mean() < 0.9


# A half plane above a plane: moments of two heights, of which Chebyshev's bound is an equality.


GAP = 0.7  # not 1, whose square is itself


def half_plane_over_plane():
    square = np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]])
    half = np.array([[-1, GAP, -1], [-1, GAP, 1], [0, GAP, 1], [0, GAP, -1]])
    return make_mesh(np.concatenate([square, half]), np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]))


def check_penumbra(visible, x, deviation):
    expected = [(1 + erf(v / deviation / sqrt(2))) / 2 for v in x]
    # Measured 4.7e-3.
    np.testing.assert_allclose(visible[:, 0], expected, atol=0.01)


def penumbra(distance, of_moments=(0, 1)):
    x = np.linspace(-0.6, 0.6, 201)
    points = points_at(np.stack([x, np.full(201, -GAP / 2), 0 * x], axis=1))
    up = Vec3(*(torch.tensor([v]) for v in (0.0, 1.0, 0.0)))
    solid_angle = torch.tensor([2 * pi * (1 - np.cos(0.3))]).float()
    maps = build_variance_shadow_maps(half_plane_over_plane(), up, solid_angle, 256, distance)
    return replace(maps, moments=maps.moments[:, of_moments]).visible(points), x


@pytest.mark.parametrize("distance", [0.5, 1.0])
def test_a_penumbra_is_the_edge_under_a_gaussian_as_wide_as_the_light(distance):
    visible, x = penumbra(distance)

    check_penumbra(visible, x, distance * np.tan(0.3) / 2)


def test_the_penumbra_check_notices_a_gaussian_of_the_whole_radius():
    visible, x = penumbra(2.0)

    with pytest.raises(AssertionError):
        check_penumbra(visible, x, np.tan(0.3) / 2)


def test_the_penumbra_check_notices_a_blur_that_is_left_out():
    visible, x = penumbra(0.0)

    with pytest.raises(AssertionError):
        check_penumbra(visible, x, np.tan(0.3) / 2)


def test_the_penumbra_check_notices_a_second_moment_that_is_not_squared():
    visible, x = penumbra(1.0, of_moments=(0, 0))

    with pytest.raises(AssertionError):
        check_penumbra(visible, x, np.tan(0.3) / 2)


def test_light_bleeding_darkens_what_is_below_it_and_leaves_what_is_lit():
    mesh, points = bowl(), gb.view("mesh", shape="bowl", resolution=24).points()
    points = points.columns(0, len(points))
    plain = maps_of(mesh, distance=0.5).visible(points)

    darkened = maps_of(mesh, distance=0.5, bleeding=0.25).visible(points)

    torch.testing.assert_close(darkened, ((plain - 0.25) / 0.75).clamp(min=0), rtol=0, atol=1e-7)  # measured 0
    assert ((plain > 0.01) & (plain < 0.25)).float().mean() > 0.02


def test_a_ball_is_not_in_shadow_where_it_faces_the_light():
    ball = trimesh.creation.icosphere(5)
    mesh = make_mesh(ball.vertices, ball.faces)
    points = points_at(mesh.vertices)
    cosine = mesh.vertices @ TOWARD.T

    visible = maps_of(mesh, distance=0.0).visible(points).numpy()

    # Measured 1 and 4.8e-4.
    assert (visible[cosine > 0.3] == 1).all()
    assert (visible[cosine < -0.3] < 2e-3).all()


# What asks for shadows


class HidesAll(Occluder):
    def visible(self, position, ng, direction):
        return torch.zeros_like(position.x, dtype=torch.bool)


@pytest.mark.parametrize("visibility", ["none", "shadow_maps", "rays"])
def test_on_a_scene_that_hides_nothing_all_is_visible(visibility):
    shadows = cast(visibility, UnitSphere(), LIGHTS, SMALL, 64, 0.5, 0.0)

    assert shadows == NoShadows(len(TOWARD))
    assert torch.equal(shadows.visible(on_plane(5)), torch.ones(5, len(TOWARD)))


@pytest.mark.parametrize("method", ["partial_environment_maps", "many_lights"])
def test_an_occluder_that_is_not_a_mesh_has_rays_but_no_shadow_maps(method):
    material = gb.material("phong", s=20)

    reason = gb.method(method, visibility="shadow_maps").supports(material, HidesAll())

    assert reason == "its shadow maps need a mesh"
    assert gb.method(method, visibility="rays").supports(material, HidesAll()) is None
    assert gb.method(method, visibility="shadow_maps").supports(material, bowl()) is None


class Given(View):
    """A row of points of a scene."""

    def __init__(self, mesh, given):
        object.__setattr__(self, "held", (mesh, given))

    def __eq__(self, other):
        return self is other

    def __hash__(self):
        return id(self)

    def mask(self):
        return torch.ones(1, len(self.points()), dtype=torch.bool)

    def points(self):
        return self.held[1].map(lambda c: c[:, 0])

    def scene(self):
        return self.held[0]


@pytest.mark.parametrize("visibility", ["shadow_maps", "rays"])
@pytest.mark.parametrize("method", ["partial_environment_maps", "many_lights"])
def test_under_one_lit_texel_the_shadow_of_a_disc_is_black_and_the_rest_as_without(method, visibility):
    light = gb.light("texel", resolution=16, face=2, row=4, column=9)
    points, material = on_plane(500), gb.material("phong", s=2, kd=0.3)
    view, options = Given(disc_over_plane(), points), {"regions": 24, "blocker_distance": 0.0}

    plain, hidden = (
        shade(gb.method(method, visibility=v, **options), light, material, view, time_it=False).radiance[0]
        for v in ("none", visibility)
    )

    lit = median_cut(light, 24).power.sum(1).argmax()
    toward = np.array([float(c[lit]) for c in median_cut(light, 24).direction])
    p = torch.cat(list(points.position), 1).double().numpy()
    crossing = p + toward / toward[1]
    edge = np.linalg.norm(crossing - CENTRE, axis=1) - RADIUS
    clear = np.abs(edge) > TEXEL
    expected = torch.tensor(edge > 0)[:, None] * plain
    # Measured 2.4e-5 of the brightest.
    torch.testing.assert_close(hidden[clear], expected[clear].float(), rtol=0, atol=1e-4 * float(plain.max()))
    assert float(plain.min()) > 0
    assert 0.05 < (edge < 0).mean() < 0.3


def test_shadows_bring_partial_maps_nearer_to_the_truth():
    light, material = gb.light("gradient", resolution=32), gb.material("phong", s=4)
    view = gb.view("mesh", shape="torus_knot", resolution=24)
    truth = gb.reference(light, material, view, relative_error=0.05)

    error = {
        v: gb.metric("relative_rms")(
            gb.shade(gb.method("partial_environment_maps", visibility=v), light, material, view, time_it=False), truth
        )
        for v in ("none", "shadow_maps", "rays")
    }

    # Measured 0.58, 0.31 and 0.25; what is left is the lobe's shape.
    assert error["shadow_maps"] < 0.6 * error["none"]
    assert error["rays"] < 0.5 * error["none"]


# Many lights


def check_many_lights(method, light, view, material):
    image = shade(method, light, material, view, time_it=False)

    lights, points = median_cut(light, method.regions), view.points()
    n = torch.stack(list(points.n), 1).double()
    expected = torch.zeros(len(points), 3, dtype=torch.float64)
    for k in range(len(lights)):
        d = Vec3(*(c[k].expand(len(points)) for c in lights.direction))
        free = view.scene().visible(points.position, points.ng, d)
        cosine = (n @ torch.stack([c[0] for c in d]).double()).clamp(min=0)
        expected += (free * cosine)[:, None] * lights.power[k].double() * 0.5 / pi
    # Measured 1.7e-7.
    torch.testing.assert_close(image.radiance[image.mask].double(), expected, rtol=8e-7, atol=0)


def test_a_diffuse_bowl_under_many_lights_is_their_sum():
    check_many_lights(
        ManyLights(regions=30, visibility="rays"),
        gb.light("spots", seed=7, resolution=32),
        gb.view("mesh", shape="bowl", resolution=16),
        gb.material("phong", ks=0.0, kd=0.5),
    )


def test_the_sum_check_notices_shadows_that_are_left_out():
    with pytest.raises(AssertionError):
        check_many_lights(
            ManyLights(regions=30),
            gb.light("spots", seed=7, resolution=32),
            gb.view("mesh", shape="bowl", resolution=16),
            gb.material("phong", ks=0.0, kd=0.5),
        )


def test_many_lights_come_to_the_reference_as_they_grow():
    light, material = gb.light("spots", seed=7, resolution=32), gb.material("phong", s=4, kd=0.2)
    view = gb.view("mesh", shape="bowl", resolution=12)
    truth = gb.reference(light, material, view, relative_error=0.01)

    few, many = (
        gb.metric("relative_rms")(
            gb.shade(gb.method("many_lights", regions=n, visibility="rays"), light, material, view, time_it=False),
            truth,
        )
        for n in (24, 1536)
    )

    # Measured 0.189 and 0.011.
    assert many < 0.12 * few
    assert many < 0.017
