"""Meshes: what is repaired and what is refused, normals, tangents, files, shapes."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

import glossbench as gb
from glossbench.errors import InputError
from glossbench.scene import mesh as mesh_module
from glossbench.scene.mesh import make_mesh
from glossbench.scene.mesh_files import load_mesh, make_named_mesh
from glossbench.scene.shapes import SHAPES, bowl, cloth, torus_knot
from glossbench.scene.winding import find_reversed_faces

SQUARE = [[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
HALVES = [[0, 1, 2], [0, 2, 3]]
NAN = float("nan")


def ball(subdivisions=3):
    sphere = trimesh.creation.icosphere(subdivisions)
    return np.array(sphere.vertices), np.array(sphere.faces)


def volume(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return np.einsum("nk,nk->", a, np.cross(b, c)) / 6


# What cannot be repaired.


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (SQUARE, np.zeros((0, 3), int), "^mesh has no faces$"),
        ([], [], "^mesh has no faces$"),
        (SQUARE, [[0, 1, 2, 3]], r"^mesh needs vertices \(V, 3\) and triangles \(F, 3\), got \(4, 3\) and \(1, 4\)$"),
        (SQUARE, [[0, 1, 4]], r"^mesh has 4 vertices, but face 0 has \[0, 1, 4\]$"),
        (SQUARE, [[0, 1, 2], [-1, 2, 3]], r"^mesh has 4 vertices, but face 1 has \[-1, 2, 3\]$"),
        ([*SQUARE[:2], [1, NAN, 0]], [[0, 1, 2]], r"finite everywhere, but vertex 2 is at \[1.0, nan, 0.0\]$"),
        ([*SQUARE[:2], [1, float("inf"), 0]], [[0, 1, 2]], "finite everywhere, but vertex 2"),
        ([[2.0, 3, 4]] * 3, [[0, 1, 2]], "^mesh has no size: all vertices of its 1 faces are at one place$"),
        ([[0.0, 0, 0], [1, 1, 1], [3, 3, 3]], [[0, 1, 2]], "^mesh has no face with an area, of 1$"),
    ],
)
def test_a_mesh_that_cannot_be_repaired_is_refused_in_one_line(vertices, faces, message):
    with pytest.raises(InputError, match=message):
        make_mesh(vertices, faces)


def test_too_many_faces_are_refused(monkeypatch):
    monkeypatch.setattr(mesh_module, "MAX_FACES", 1)

    with pytest.raises(InputError, match=r"^mesh has 2 faces, more than 1; reduce it first$"):
        make_mesh(SQUARE, HALVES)


# What is repaired, and what needs no repair.


def test_faces_without_area_are_left_out_with_a_note():
    mesh = make_mesh(SQUARE, [*HALVES, [0, 0, 1], [0, 1, 0]])

    assert len(mesh.faces) == 2
    assert mesh.repairs == ("left out 2 of 4 faces, which have no area",)


def test_vertices_that_no_face_uses_may_be_anything():
    mesh = make_mesh([*SQUARE, [NAN, NAN, NAN]], HALVES)

    assert len(mesh.vertices) == 4
    assert mesh.repairs == ()


def test_faces_that_wind_against_their_neighbours_are_turned():
    vertices, faces = ball()
    wrong = np.random.default_rng(0).random(len(faces)) < 0.3
    mixed = np.where(wrong[:, None], faces[:, ::-1], faces)

    mesh = make_mesh(vertices, mixed)

    assert mesh.repairs == (
        f"turned {wrong.sum()} of {len(faces)} faces, whose winding was opposite to that of their neighbours",
    )
    right = make_mesh(vertices, faces)
    assert volume(mesh) == pytest.approx(volume(right), rel=1e-12)  # measured 0
    np.testing.assert_allclose(mesh.normals, right.normals, atol=1e-15)  # measured 0


def test_normals_of_mixed_winding_would_be_wrong(monkeypatch):
    vertices, faces = ball()
    mixed = np.where((np.random.default_rng(0).random(len(faces)) < 0.3)[:, None], faces[:, ::-1], faces)
    monkeypatch.setattr(mesh_module, "find_reversed_faces", lambda f: np.zeros(len(f), dtype=bool))

    mesh = make_mesh(vertices, mixed)

    assert (mesh.normals * make_mesh(vertices, faces).normals).sum(1).min() < 0


def test_two_bodies_are_wound_each_for_itself():
    vertices, faces = ball(1)
    both = np.concatenate([faces, faces[:, ::-1] + len(vertices)])

    assert not find_reversed_faces(both).any()


def test_a_moebius_strip_stays_as_it_is():
    n = 12
    turn = np.arange(n) * np.pi / n
    ring = np.stack([np.cos(2 * turn), np.sin(2 * turn), np.zeros(n)], axis=1)
    across = np.cos(turn)[:, None] * ring + np.sin(turn)[:, None] * [0, 0, 1]
    vertices = np.concatenate([ring - 0.3 * across, ring + 0.3 * across])
    faces = []
    for i in range(n):
        a, b = i, i + n
        c, d = (i + 1, i + 1 + n) if i + 1 < n else (n, 0)  # the last quad joins the edges crosswise
        faces += [[a, b, c], [c, b, d]]

    mesh = make_mesh(vertices, faces)

    assert len(mesh.faces) == 2 * n
    assert mesh.repairs == ()
    assert np.isfinite(mesh.normals).all()


def test_an_edge_of_three_faces_is_taken_as_it_is():
    mesh = make_mesh([[0, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 1, 0], [-1, -1, 0]], [[0, 1, 2], [0, 1, 3], [0, 1, 4]])

    assert len(mesh.faces) == 3
    assert mesh.repairs == ()


@pytest.mark.parametrize("bad", [NAN, 0.0])
def test_invalid_normals_of_a_file_are_computed_again(bad):
    normals = np.tile([0.0, 0, 2.0], (4, 1))
    normals[2] = bad

    mesh = make_mesh(SQUARE, HALVES, normals)

    assert mesh.repairs == ("computed new normals, because the stated ones are zero or not finite",)
    np.testing.assert_array_equal(mesh.normals, np.tile([0.0, 0, 1], (4, 1)))


def test_an_inverted_mesh_shows_the_same():
    vertices, faces = ball(2)
    trimesh.Trimesh(vertices, faces, process=False).export("ball.ply")
    trimesh.Trimesh(vertices, faces[:, ::-1], process=False).export("inverted.ply")

    right, inverted = (gb.view("mesh", shape=name, resolution=24).points() for name in ("ball.ply", "inverted.ply"))

    for name in ("n", "ng", "position"):
        a, b = getattr(right, name), getattr(inverted, name)
        np.testing.assert_allclose(np.stack(a), np.stack(b), atol=3e-7)  # measured 6e-8


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


# One size and place; equal by content.


@pytest.mark.parametrize(("scale", "shift"), [(1e-30, 0), (1e30, 0), (1e3, 1e7), (1e300, 0)])
def test_size_and_place_of_the_file_do_not_matter(scale, shift):
    vertices, faces = ball(2)
    vertices = vertices * [1, 0.5, 0.25]

    mesh = make_mesh(vertices * scale + shift, faces)

    # Measured 0.
    np.testing.assert_allclose(mesh.vertices.max(0), [1, 0.5, 0.25], rtol=1e-15)
    np.testing.assert_allclose(mesh.vertices.min(0), [-1, -0.5, -0.25], rtol=1e-15)


def test_meshes_are_equal_by_content():
    assert cloth(rows=8) == cloth(rows=8)
    assert hash(cloth(rows=8)) == hash(cloth(rows=8))
    assert cloth(rows=8) != cloth(rows=8, seed=2)
    assert cloth(rows=8) != "cloth"


def test_a_mesh_cannot_be_written_to():
    with pytest.raises(ValueError, match="read-only"):
        make_named_mesh("cloth").vertices[0] = 0


# Normals.


def test_made_normals_of_a_ball_point_away_from_its_middle():
    mesh = make_mesh(*ball(4))

    angles = np.arccos(np.clip((mesh.normals * mesh.vertices).sum(1), -1, 1))
    # Measured 2.6e-3 at 5120 faces: second order in their size.
    assert angles.max() < 5e-3


def test_made_normals_are_weighted_by_angles():
    """Of a cube each face has the same say at a corner, into however many triangles it is cut there."""
    box = trimesh.creation.box()

    mesh = make_mesh(box.vertices, box.faces)

    # Measured 1.1e-16.
    np.testing.assert_allclose(mesh.normals, np.sign(mesh.vertices) / np.sqrt(3), atol=5e-16)


def test_vertices_of_one_place_share_their_normal():
    vertices, faces = ball(2)
    soup = vertices[faces].reshape(-1, 3)

    mesh = make_mesh(soup, np.arange(len(soup)).reshape(-1, 3))

    assert len(mesh.vertices) == len(vertices)
    order = lambda m: m.normals[np.lexsort(m.vertices.T)]  # noqa: E731
    np.testing.assert_allclose(order(mesh), order(make_mesh(vertices, faces)), atol=1e-15)  # measured 0


# Shapes: their normals and tangents against differences of their vertices.


@pytest.mark.parametrize("shape", SHAPES)
def test_shapes_need_no_repair_and_are_of_some_ten_thousand_triangles(shape):
    mesh = SHAPES[shape]()

    assert mesh.repairs == ()
    assert 20_000 < len(mesh.faces) < 60_000
    assert not find_reversed_faces(mesh.faces).any()
    assert np.abs(mesh.vertices).max() == pytest.approx(1, rel=1e-15)  # measured 0


@pytest.mark.parametrize(
    ("shape", "fine", "largest"),
    [
        (cloth, {"rows": 320}, 0.12),
        (torus_knot, {"around": 64, "along": 1280}, 0.08),
        (bowl, {"around": 384, "arc": 96, "rim": 24}, 0.07),
    ],
)
def test_stated_normals_are_those_of_the_faces_to_first_order(shape, fine, largest):
    def angle(mesh):
        faces = mesh.face_normals(np.arange(len(mesh.faces)))
        cosines = np.einsum("fk,fvk->fv", faces, mesh.normals[mesh.faces])
        return np.arccos(np.clip(cosines, -1, 1)).max()

    coarse, half = angle(shape()), angle(shape(**fine))

    # Measured 0.215, 0.144, 0.132 at first, and half of it at twice the rows: 0.11, 0.072, 0.066.
    assert half < largest
    assert half < 0.55 * coarse


@pytest.mark.parametrize("shape", SHAPES)
def test_stated_tangents_are_orthogonal_to_the_normals(shape):
    mesh = SHAPES[shape]()

    # Measured 3e-16.
    assert np.abs((mesh.tangents * mesh.normals).sum(1)).max() < 1.5e-15


@pytest.mark.parametrize("shape", ["torus_knot", "bowl"])
def test_closed_shapes_are_closed_and_wind_outwards(shape):
    mesh = SHAPES[shape]()
    place = np.unique(mesh.vertices, axis=0, return_inverse=True)[1].reshape(-1)

    merged = trimesh.Trimesh(mesh.vertices, place[mesh.faces], process=False)

    assert merged.is_watertight
    assert volume(mesh) > 0


def test_volume_of_the_bowl_is_that_of_its_body_of_revolution():
    """Half a shell, and half a torus that is its rim: Pappus."""
    middle, width = 0.95, 0.05
    shell, rim = 2 / 3 * np.pi * (1 - 0.9**3), np.pi * width**2 / 2 * 2 * np.pi * middle

    mesh = bowl()

    # Its box is 2 wide already: no change of size. Measured 9e-4 less, at 192 triangles around.
    assert volume(mesh) == pytest.approx(shell + rim, rel=4e-3)


# Files.


@pytest.mark.parametrize("suffix", ["obj", "ply", "glb", "gltf", "stl"])
def test_every_format_gives_the_same_mesh(suffix):
    vertices, faces = ball(2)
    written = trimesh.Trimesh(vertices, faces, process=False).export(file_type=suffix)
    for name, data in (written if isinstance(written, dict) else {f"model.{suffix}": written}).items():
        Path(name).write_bytes(data.encode() if isinstance(data, str) else data)

    mesh = load_mesh(f"model.{suffix}")

    expected = make_mesh(vertices, faces)
    order = lambda m: np.lexsort(m.vertices.round(4).T)  # noqa: E731
    assert len(mesh.faces) == len(faces)
    # Measured 2.6e-8 and 7e-8: float32.
    np.testing.assert_allclose(mesh.vertices[order(mesh)], expected.vertices[order(expected)], atol=1.3e-7)
    np.testing.assert_allclose(mesh.normals[order(mesh)], expected.normals[order(expected)], atol=3.5e-7)


@pytest.mark.parametrize("suffix", ["obj", "ply", "glb"])
def test_normals_of_the_file_are_kept(suffix):
    tilted = np.tile([0.6, 0.0, 0.8], (4, 1))
    square = trimesh.Trimesh(SQUARE, HALVES, vertex_normals=tilted, process=False)
    Path(f"square.{suffix}").write_bytes(_exported(square, suffix))

    mesh = load_mesh(f"square.{suffix}")

    np.testing.assert_allclose(mesh.normals, tilted, atol=5e-8)  # measured 9.5e-9


def _exported(mesh, suffix):
    options = {"obj": {"include_normals": True}, "ply": {"vertex_normal": True}, "glb": {"include_normals": True}}
    data = mesh.export(file_type=suffix, **options[suffix])
    return data.encode() if isinstance(data, str) else data


def test_all_parts_of_a_scene_are_one_mesh_each_in_its_place():
    scene = trimesh.Scene()
    for x in (-3.0, 3.0):
        scene.add_geometry(
            trimesh.creation.icosphere(1), transform=trimesh.transformations.translation_matrix([x, 0, 0])
        )
    scene.export("two.glb")

    mesh = load_mesh("two.glb")

    assert len(mesh.faces) == 160
    assert mesh.vertices.max(0) == pytest.approx([1, 0.25, 0.25], rel=1e-7)  # measured 0


def test_normals_of_a_part_turn_with_it():
    """By the inverse transpose: squeezed to half along x, the normal (0.6, 0, 0.8) becomes (1.2, 0, 0.8), unit."""
    tilted = trimesh.Trimesh(SQUARE, HALVES, vertex_normals=np.tile([0.6, 0.0, 0.8], (4, 1)), process=False)
    scene = trimesh.Scene()
    scene.add_geometry(tilted, transform=np.diag([0.5, 1, 1, 1]))
    Path("squeezed.glb").write_bytes(scene.export(file_type="glb", include_normals=True))

    mesh = load_mesh("squeezed.glb")

    expected = np.array([1.2, 0, 0.8]) / np.hypot(1.2, 0.8)
    np.testing.assert_allclose(mesh.normals, np.tile(expected, (4, 1)), atol=5e-8)  # measured 9.5e-9


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.fbx", b"", "a.fbx: a mesh must be one of .obj, .ply, .glb, .gltf, .stl"),
        ("a.obj", b"", "a.obj"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\n", "a.obj"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "a.obj"),
        ("a.obj", b"v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n", "a.obj must be finite everywhere"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 3\n", "a.ply"),
        ("a.glb", b"not a glb", "a.glb: not a mesh that can be read"),
        ("a.stl", b"\x00" * 84, "a.stl"),
        ("a.gltf", b"{}", "a.gltf"),
    ],
)
def test_a_broken_file_is_refused_in_one_line(name, content, message):
    Path(name).write_bytes(content)

    with pytest.raises(InputError, match=message) as caught:
        load_mesh(name)

    assert "\n" not in str(caught.value)


def test_names_are_shapes_then_the_catalogue_then_files(shared_data, monkeypatch):
    monkeypatch.setenv("GLOSSBENCH_DATA", str(shared_data))

    assert make_named_mesh("cloth") == cloth()
    assert make_named_mesh("teapot") == load_mesh(shared_data / "meshes" / "teapot.obj")
    assert len(make_named_mesh("spot").vertices) == 2930  # its 3225 texture coordinates split none
    assert len(make_named_mesh("bunny").faces) == 69451


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("buny", "unknown mesh 'buny'; did you mean 'bunny'?"),
        ("torus", "unknown mesh 'torus'; did you mean 'torus_knot'?"),
        ("none.obj", "no mesh file 'none.obj': not in "),
    ],
)
def test_an_unknown_name_offers_the_nearest(name, message):
    with pytest.raises(InputError) as caught:
        make_named_mesh(name)

    assert str(caught.value).startswith(message)
