"""Rays against brute force, and references with visibility against closed forms."""

from functools import cache
from math import atan2, cos, pi, sin, sqrt

import numpy as np
import pytest
import torch
import trimesh

import glossbench as gb
from glossbench.directions import Vec3
from glossbench.scene import rays as rays_module
from glossbench.scene.mesh import make_mesh
from glossbench.scene.points import ShadingPoints, View
from glossbench.scene.rays import OFFSET, Rays
from glossbench.scene.shapes import bowl
from glossbench.truth import checkpoint as checkpoint_module
from glossbench.truth import sampling as ground_truth
from glossbench.truth.reference import compute_reference
from oracles.cube_by_hand import fine_light
from oracles.texel_sums import MATERIALS, lights
from oracles.z_scores import check_z

# Rays: brute force in float64, every ray against every triangle (Moeller and Trumbore 1997).


def soup(n=60, seed=0):
    rng = np.random.default_rng(seed)
    vertices = (rng.uniform(-0.7, 0.7, (n, 1, 3)) + rng.uniform(-0.3, 0.3, (n, 3, 3))).astype(np.float32)
    return vertices.reshape(-1, 3).astype(np.float64), np.arange(3 * n).reshape(-1, 3)


def random_rays(n=4000, seed=1):
    rng = np.random.default_rng(seed)
    origins, directions = rng.uniform(-1, 1, (n, 3)), rng.standard_normal((n, 3))
    return tuple(a.astype(np.float32).astype(np.float64) for a in (origins, directions))


def crossings(vertices, faces, origins, directions):
    """Distance along each ray to each triangle (N, F), infinite without an intersection, and u, v."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    e1, e2 = b - a, c - a
    p = np.cross(directions[:, None], e2)
    det = (p * e1).sum(2)
    s = origins[:, None] - a
    u = (s * p).sum(2) / det
    q = np.cross(s, e1)
    v = (q * directions[:, None]).sum(2) / det
    t = (q * e2).sum(2) / det
    return np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, np.inf), u, v


def test_first_hits_are_those_of_brute_force():
    vertices, faces = soup()
    origins, directions = random_rays()

    hits = Rays(vertices, faces).first_hit(origins, directions)

    t, u, v = crossings(vertices, faces, origins, directions)
    nearest = t.argmin(1)
    distance = t[np.arange(len(t)), nearest]
    hit = np.isfinite(distance)
    assert 0.1 < hit.mean() < 0.9
    np.testing.assert_array_equal(hits.face, np.where(hit, nearest, -1))
    # Measured 1.7e-5 and 4.3e-6.
    np.testing.assert_allclose(hits.distance[hit], distance[hit], rtol=8e-5, atol=0)
    rows = np.flatnonzero(hit)
    expected = np.stack([u[rows, nearest[hit]], v[rows, nearest[hit]]], axis=1)
    np.testing.assert_allclose(hits.barycentric[hit][:, 1:], expected, rtol=0, atol=2e-5)
    np.testing.assert_allclose(hits.barycentric.sum(1), 1, rtol=0, atol=1e-15)  # measured 0
    assert np.isinf(hits.distance[~hit]).all()


def test_visible_is_what_no_triangle_crosses():
    vertices, faces = soup()
    points, directions = random_rays(seed=2)
    normals = directions / np.linalg.norm(directions, axis=1, keepdims=True)

    free = Rays(vertices, faces).visible(points, normals, directions)

    t, _, _ = crossings(vertices, faces, points + OFFSET * normals, directions)
    np.testing.assert_array_equal(free, np.isinf(t).all(1))


def test_nothing_behind_a_surface_is_visible_and_no_ray_is_cast_for_it():
    rays = Rays(*soup())
    up = np.tile([0.0, 0, 1], (3, 1))

    free = rays.visible(np.full((3, 3), 5.0), up, np.array([[1.0, 0, -1e-9], [0, 0, -1], [1, 0, 0]]))

    assert not free.any()


# Balls: convex and closed.

BALLS = [(2, 1.0, 0.0), (4, 1e-6, 0.0), (4, 1e3, 1e5), (6, 1.0, 0.0)]


def of_ball(subdivisions, scale, shift, n=100_000):
    """Float32 points on a flattened ball, near its edges and corners too, and directions above them, grazing too."""
    rng = np.random.default_rng(0)
    sphere = trimesh.creation.icosphere(subdivisions)
    mesh = make_mesh(sphere.vertices * scale * [1, 0.5, 0.3] + shift, sphere.faces)
    faces = rng.integers(0, len(mesh.faces), n)
    weights = np.where(np.arange(n)[:, None] < n // 4, rng.dirichlet([0.05] * 3, n), rng.dirichlet([1.0] * 3, n))
    points = np.einsum("nk,nkc->nc", weights, mesh.vertices[mesh.faces[faces]])
    normals = mesh.face_normals(faces)
    directions = rng.standard_normal((n, 3))
    height = (directions * normals).sum(1, keepdims=True)
    grazing = rng.random((n, 1)) < 0.5
    directions += normals * (np.where(grazing, 1e-3, 1) * np.abs(height) - height)
    return mesh, *(a.astype(np.float32) for a in (points, normals, directions))


def stopped(mesh, points, normals, directions):
    above = np.einsum("nk,nk->n", normals, directions) > 0
    return int((above & ~mesh.rays.visible(points, normals, directions)).sum())


@pytest.mark.parametrize("ball", BALLS)
def test_a_convex_mesh_never_shadows_itself(ball):
    assert stopped(*of_ball(*ball)) == 0


@pytest.mark.parametrize("offset", [0.0, 3e-8])
def test_convex_mesh_notices_an_offset_that_rounding_swallows(offset, monkeypatch):
    monkeypatch.setattr(rays_module, "OFFSET", offset)

    assert stopped(*of_ball(4, 1.0, 0.0)) > 100


@pytest.mark.parametrize("ball", BALLS)
def test_no_ray_slips_out_of_a_closed_mesh_not_even_through_its_edges(ball):
    mesh, *_ = of_ball(*ball, n=1)
    middles = mesh.vertices[mesh.faces[:, [0, 1]]].mean(1)
    directions = np.concatenate([middles, np.random.default_rng(1).standard_normal((100_000, 3))])

    hits = mesh.rays.first_hit(np.zeros_like(directions), directions)

    assert (hits.face >= 0).all()


def below_a_lid(gap):
    """A square under another, and what the middle of the lower one sees within 45 degrees of straight up."""
    square = np.array([[-1.0, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]])
    mesh = make_mesh(
        np.concatenate([square, square + np.array([0, gap, 0])]), [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]
    )
    rng = np.random.default_rng(0)
    n = 1000
    points = np.stack([rng.uniform(-0.5, 0.5, n), np.full(n, mesh.vertices[0, 1]), rng.uniform(-0.5, 0.5, n)], axis=1)
    directions = np.stack([rng.uniform(-0.7, 0.7, n), np.ones(n), rng.uniform(-0.7, 0.7, n)], axis=1)
    return mesh.rays.visible(points, np.tile([0.0, 1, 0], (n, 1)), directions)


def test_a_lid_just_above_hides_all():
    assert not below_a_lid(1e-4).any()


def test_lid_notices_an_offset_that_leaps_over_it(monkeypatch):
    monkeypatch.setattr(rays_module, "OFFSET", 1e-3)

    assert below_a_lid(1e-4).all()


# References: single points of a floor, n = ng = +y, seen from straight above or aslant.


class Floor(View):
    """Points of the plane y = height with their normal up, in a scene that hides their light."""

    def __init__(self, mesh, places, wo=(0.0, 1.0, 0.0), ng=(0.0, 1.0, 0.0)):
        vars(self).update(mesh=mesh, places=np.atleast_2d(places), wo=wo, ng=ng)

    def mask(self):
        return torch.ones(1, len(self.places), dtype=torch.bool)

    def points(self):
        n = len(self.places)
        vectors = [(1.0, 0, 0), (0, 0, -1.0), (0, 1.0, 0), self.wo]
        t, b, up, wo, ng = (Vec3(*(torch.full((n,), float(c)) for c in v)) for v in [*vectors, self.ng])
        return ShadingPoints(t, b, up, wo, Vec3(*torch.from_numpy(self.places.T.copy()).float()), ng)

    def scene(self):
        return self.mesh


def image(view, light=None, material=None, relative_error=2e-3, **options):
    light = gb.light("constant", radiance=2.0, resolution=8) if light is None else light
    truth = compute_reference(
        light,
        material or gb.material("kurt", ks=0.0, kd=(0.8, 0.5, 0.2)),
        view,
        relative_error=relative_error,
        **options,
    )
    return truth.radiance[0].numpy(), truth.standard_error[0].numpy()


def form_factor(polygon, place):
    """Share of a white sky's irradiance on a floor that a polygon above it hides: Lambert 1760.

    sum over edges of the angle of the edge times the height of its plane's normal, over 2 pi.
    """
    v = polygon - place
    v = v / np.linalg.norm(v, axis=1, keepdims=True)
    w = np.roll(v, -1, axis=0)
    normals = np.cross(v, w)
    angles = np.arccos(np.clip((v * w).sum(1), -1, 1))
    return abs((angles * normals[:, 1] / np.linalg.norm(normals, axis=1)).sum()) / (2 * pi)


ALBEDO = np.array([0.8, 0.5, 0.2])
PLACES = np.array([[0.0, 0, 0], [0.4, 0, 0.1], [1.5, 0, -0.7]])


def disc(n, height=0.75):
    """A disc of radius 1 above the floor; its mesh is in the middle of itself, so the floor is at -height."""
    phi = np.arange(n) * 2 * pi / n
    rim = np.stack([np.cos(phi), np.zeros(n), np.sin(phi)], axis=1)
    faces = [[0, i, i + 1] for i in range(1, n - 1)]
    return rim, make_mesh(rim, faces), height


def under_disc(n=256, places=PLACES, **options):
    rim, mesh, height = disc(n)
    places = places - [0, height, 0]
    expected = [2 * ALBEDO * (1 - form_factor(rim, place)) for place in places]
    return Floor(mesh, places, **options), np.array(expected)


def test_a_disc_hides_its_form_factor():
    """Straight below its middle, sin^2 of the half angle under which it is seen."""
    view, expected = under_disc()

    radiance, standard_error = image(view)

    closed = 2 * ALBEDO * (1 - 1 / (1 + 0.75**2))
    np.testing.assert_allclose(expected[0], closed, rtol=3e-4)  # measured 6.4e-5: a polygon of 256 edges
    check_z(radiance, standard_error, expected)


def test_a_square_hides_its_form_factor():
    view, expected = under_disc(4)

    check_z(*image(view), expected)


@pytest.mark.parametrize("fault", ["no shadow rays", "in the light's technique only", "in the surface's only", "moved"])
def test_disc_notices(fault, monkeypatch):
    right = ground_truth.unhidden

    def wrong(weight, points, d, occluder):
        of_light = d.x.shape[0] == 1
        if fault == "no shadow rays" or of_light == (fault == "in the surface's only"):
            return weight
        return right(weight, points, d, occluder)

    def moved(weight, points, d, occluder):
        """By 2 % of the disc's radius."""
        shifted = Vec3(points.position.x, points.position.y + 0.02, points.position.z)
        vars(points)["position"] = shifted
        return right(weight, points, d, occluder)

    monkeypatch.setattr(ground_truth, "unhidden", moved if fault == "moved" else wrong)
    view, expected = under_disc()

    radiance, standard_error = image(view)

    with pytest.raises(AssertionError):
        check_z(radiance, standard_error, expected, n_tests=1)


def test_disc_notices_a_flipped_normal():
    view, expected = under_disc(ng=(0.0, -1.0, 0.0))

    radiance, _ = image(view)

    assert (radiance == 0).all()
    assert (expected > 0).all()


WALL = np.array([[0.0, -1, -1], [0, -1, 1], [0, 1, 1], [0, 1, -1]])
HALVES = [[0, 1, 2], [0, 2, 3]]


@pytest.mark.parametrize("distance", [1e-4, 0.1, 1.0])
def test_a_wall_hides_its_form_factor(distance):
    standing = np.where(WALL[:, 1:2] < 0, WALL * [1, 0, 1], WALL)  # the part above the horizon
    view = Floor(make_mesh(WALL, HALVES), [distance, 0, 0])

    radiance, standard_error = image(view)

    expected = 2 * ALBEDO * (1 - form_factor(standing, [distance, 0, 0]))
    if distance == 1e-4:
        np.testing.assert_allclose(expected, ALBEDO, rtol=2e-4)  # half of the sky; measured 1.1e-4 off
    check_z(radiance, standard_error, expected[None])


@pytest.mark.parametrize("light", ["rough", "spot"])
@pytest.mark.parametrize("material", ["ggx_diffuse", "kurt_anisotropic"])
def test_at_a_wall_the_texels_of_half_the_sky_are_summed(light, material):
    """The wall's plane falls between texels, so that the sum is as exact as without it."""
    wo = np.array([sin(0.6) * cos(0.5), cos(0.6), sin(0.6) * sin(0.5)])
    view = Floor(make_mesh(WALL, HALVES), [1e-4, 0, 0], wo=tuple(wo))
    glossy, frame = MATERIALS[material], np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])

    radiance, standard_error = image(view, lights()[light], glossy.material())

    def half(k):
        d, lit, solid_angle = fine_light(lights()[light].faces.double().numpy(), k)
        wi = d @ frame.T
        seen = (wi[:, 2] > 0) & (d[:, 0] > 0)
        weight = (wi[seen, 2] * solid_angle[seen])[:, None]
        return (glossy.f(frame @ wo, wi[seen]) * weight * lit[seen]).sum(0)

    check_z(radiance, standard_error, ((4 * half(8) - half(4)) / 3)[None])


def test_the_bottom_of_a_bowl_sees_a_cone():
    """Of the half angle under which the inner side of its rim, a half circle of radius w about m, ends the sky."""
    mesh, inner = bowl(), 0.9
    m, w = (1 + inner) / 2, (1 - inner) / 2
    bottom = mesh.vertices[:, 1].min() + (1 - inner)

    radiance, standard_error = image(Floor(mesh, [0.0, bottom, 0]))

    alpha = atan2(m, inner) - np.arcsin(w / sqrt(m * m + inner * inner))
    check_z(radiance, standard_error, 2 * ALBEDO[None] * sin(alpha) ** 2)


def test_inside_a_closed_mesh_it_is_exactly_dark():
    ball = trimesh.creation.icosphere(3)

    radiance, standard_error = image(Floor(make_mesh(ball.vertices, ball.faces), [[0.0, 0, 0], [0.3, -0.5, 0.2]]))

    assert (radiance == 0).all()
    assert (standard_error == 0).all()


def test_a_convex_mesh_is_lit_as_if_nothing_were_hidden(tmp_path, monkeypatch):
    trimesh.creation.icosphere(6).export(tmp_path / "ball.ply")
    view = gb.view("mesh", shape=str(tmp_path / "ball.ply"), resolution=16)
    light, material = lights()["rough"], MATERIALS["ggx_diffuse"].material()

    shadowed = compute_reference(light, material, view, relative_error=2e-2)
    monkeypatch.setattr(ground_truth, "unhidden", lambda weight, points, d, occluder: weight)
    plain = compute_reference(light, material, view, relative_error=2e-2)

    # The same samples. Measured 2e-4: light between the horizons of n and of the triangle.
    assert (plain.radiance - shadowed.radiance).abs().max() < 1e-3 * plain.mean
    assert (plain.radiance >= shadowed.radiance).all()


# Checkpoints.


class Killed(Exception):
    """Stands for the end of the process."""


def run(folder, seed=0, **options):
    rough, material = lights()["rough"], MATERIALS["ggx_diffuse"].material()
    view, _ = under_disc(16)
    return compute_reference(rough, material, view, 1e-9, max_samples=4096, seed=seed, checkpoint=folder, **options)


@cache
def unbroken(seed=0):
    return run(None, seed)


def killed_after(n_saves, folder, monkeypatch, **options):
    right, saved = checkpoint_module.Checkpoint.save, []

    def save(self, sums, done):
        right(self, sums, done)
        saved.append(done)
        if len(saved) == n_saves:
            raise Killed

    with monkeypatch.context() as patch:
        patch.setattr(checkpoint_module, "INTERVAL", 0.0)
        patch.setattr(checkpoint_module.Checkpoint, "save", save)
        with pytest.raises(Killed):
            run(folder, **options)


@pytest.mark.parametrize("n_saves", [1, 16, 23, 47, 48])
def test_a_killed_reference_continues_to_the_same_bytes(n_saves, tmp_path, monkeypatch):
    whole = unbroken()
    killed_after(n_saves, tmp_path, monkeypatch)
    rounds, right = [], ground_truth._round
    monkeypatch.setattr(ground_truth, "_round", lambda *a: rounds.append(1) or right(*a))

    resumed = run(tmp_path)

    assert len(rounds) == 3 * 16 - n_saves
    assert (resumed.radiance == whole.radiance).all()
    assert (resumed.standard_error == whole.standard_error).all()
    assert (resumed.deviates == whole.deviates).all()
    assert resumed.n_samples == whole.n_samples
    assert list(tmp_path.iterdir()) == []


def test_sums_of_another_seed_scene_or_source_are_not_taken_up(tmp_path, monkeypatch):
    killed_after(20, tmp_path, monkeypatch)

    other = run(tmp_path, seed=1)

    assert (other.radiance == unbroken(1).radiance).all()
    assert len(list(tmp_path.iterdir())) == 1
    monkeypatch.setattr(checkpoint_module, "compute_code_hash", lambda *modules: "another version")
    assert (run(tmp_path).radiance == unbroken().radiance).all()
    assert len(list(tmp_path.iterdir())) == 1


def test_a_broken_checkpoint_is_started_again(tmp_path, monkeypatch):
    killed_after(20, tmp_path, monkeypatch)
    (path,) = tmp_path.iterdir()
    path.write_bytes(path.read_bytes()[:100])

    assert (run(tmp_path).radiance == unbroken().radiance).all()


def test_resuming_test_notices_sums_that_are_lost(tmp_path, monkeypatch):
    killed_after(20, tmp_path, monkeypatch)
    (path,) = tmp_path.iterdir()
    with np.load(path) as stored:
        done, sums = stored["done"], stored["sums"] * 0
    np.savez(path, sums=sums, done=done)

    assert (run(tmp_path).radiance != unbroken().radiance).any()
