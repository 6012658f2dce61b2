"""The mesh view: framing, silhouettes, frames, and the ball that is the analytic sphere."""

from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

import glossbench as gb
from glossbench.directions import stack
from glossbench.errors import InputError
from glossbench.scene import mesh_view
from glossbench.scene.camera import MARGIN, frame_vertices
from glossbench.scene.mesh import make_mesh
from glossbench.scene.mesh_view import LEAST_COSINE, make_shading_points
from glossbench.scene.shapes import SHAPES


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def ball():
    trimesh.creation.icosphere(6).export("ball.ply")
    return "ball.ply"


def frame_of(points):
    return {name: stack(v).double().numpy() for name, v in vars(points).items() if v is not None}


# The ball against the analytic sphere.


def of_sphere(ball, resolution=64):
    options = {"camera": "orthographic", "azimuth": 0.0, "elevation": 0.0, "zoom": 1 + MARGIN}
    return gb.view("mesh", shape=ball, resolution=resolution, **options), gb.view("sphere", resolution=resolution)


def test_orthographic_ball_is_the_analytic_sphere(ball):
    mesh, sphere = of_sphere(ball)

    # A ball of 81 920 triangles has its silhouette 1e-4 inside the sphere's.
    np.testing.assert_array_equal(mesh.mask(), sphere.mask())
    ours, analytic = frame_of(mesh.points()), frame_of(sphere.points())
    inside = analytic["n"][:, 2] > 0.2
    # Measured 6.4e-4, 1.2e-3 (t, near the poles 1 / cos of the latitude of n), 1.9e-9 and 0; at the rim depth is steep.
    np.testing.assert_allclose(ours["n"][inside], analytic["n"][inside], atol=1e-3)
    np.testing.assert_allclose(ours["t"][inside], analytic["t"][inside], atol=6e-3)
    np.testing.assert_allclose(ours["position"][:, :2], analytic["n"][:, :2], atol=1e-8)
    np.testing.assert_allclose(ours["wo"], analytic["wo"], atol=1e-7)


def test_shaded_ball_is_the_shaded_sphere(ball):
    light, material = gb.light("gradient", resolution=16), gb.material("ggx", alpha=0.4)
    method = gb.method("importance_sampling", samples=64)
    mesh, sphere = of_sphere(ball, 32)

    images = [gb.shade(method, light, material, view, time_it=False).radiance for view in (mesh, sphere)]

    # Measured 6e-4 of the mean, most of it at the rim.
    assert (images[0] - images[1]).abs().max() < 2e-3 * images[1][sphere.mask()].mean()


def test_a_flipped_axis_of_the_camera_would_be_noticed(ball, monkeypatch):
    mesh, sphere = of_sphere(ball)
    right = mesh_view.make_shading_points
    monkeypatch.setattr(
        mesh_view, "make_shading_points", lambda m, f, b, wo: right(m, f, b[:, [1, 0, 2]], wo * [-1, 1, 1])
    )

    ours, analytic = frame_of(mesh.points()), frame_of(sphere.points())

    assert np.abs(ours["position"][:, :2] - analytic["n"][:, :2]).max() > 1e-3


# Frames.

CASES = [(shape, camera) for shape in SHAPES for camera in ("perspective", "orthographic")]


@pytest.mark.parametrize(("shape", "camera"), CASES)
def test_frames_are_orthonormal_right_handed_and_seen(shape, camera):
    frames = frame_of(gb.view("mesh", shape=shape, resolution=64, camera=camera).points())

    basis = np.stack([frames[name] for name in "tbn"], axis=1)
    # Measured 9e-8, 1e-7, and 5e-8 below: float32.
    np.testing.assert_allclose(basis @ basis.transpose(0, 2, 1), np.broadcast_to(np.eye(3), basis.shape), atol=5e-7)
    np.testing.assert_allclose(np.linalg.det(basis), 1, atol=5e-7)
    for name in ("wo", "ng"):
        np.testing.assert_allclose(np.linalg.norm(frames[name], axis=1), 1, atol=2.5e-7)
    assert (frames["n"] * frames["wo"]).sum(1).min() > LEAST_COSINE - 3e-8  # measured 6e-9
    assert (frames["ng"] * frames["wo"]).sum(1).min() > 0


def test_a_normal_that_faces_away_is_bent_to_the_least_cosine_within_its_plane():
    wo = np.array([[0.0, 0.0, 1.0]])
    normals = np.tile([0.8, 0.0, -0.6], (3, 1))
    mesh = make_mesh([[0.0, 0, 0], [1, 0, 2], [0, 1, 0]], [[0, 1, 2]], normals)

    points = make_shading_points(mesh, np.array([0]), np.full((1, 3), 1 / 3), wo)

    # The triangle's own normal (-2, 0, 1) turns the stated one to (-0.8, 0, 0.6), which the viewer sees.
    np.testing.assert_allclose(stack(points.n)[0], [-0.8, 0, 0.6], atol=1e-7)  # measured 2.4e-8
    away = make_mesh([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], np.tile([0.995, 0.0, 0.09987], (3, 1)))
    points = make_shading_points(away, np.array([0]), np.full((1, 3), 1 / 3), np.array([[-0.8, 0.0, 0.6]]))
    n, viewer = stack(points.n)[0].double().numpy(), np.array([-0.8, 0, 0.6])
    assert n @ viewer == pytest.approx(LEAST_COSINE, abs=1e-7)  # measured 2.1e-8
    assert n[1] == 0
    assert n @ [0.995, 0, 0.09987] > 0


def test_normals_that_cancel_give_way_to_the_triangles_own():
    mesh = make_mesh([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], [[1.0, 0, 0], [-1, 0, 0], [0, 0, 1]])

    points = make_shading_points(mesh, np.array([0]), np.array([[0.5, 0.5, 0]]), np.array([[0.0, 0, 1]]))

    np.testing.assert_allclose(stack(points.n)[0], [0, 0, 1], atol=1e-7)  # measured 0


@pytest.mark.parametrize("n", [(0, 1, 0), (0, -1, 0), (1, 0, 0), (0, 0, 1)])
@pytest.mark.parametrize("tangent", [None, (0, 1, 0), (1, 0, 0), (0, 0, 0)])
def test_every_normal_has_a_tangent(n, tangent):
    n = np.array(n, dtype=float)
    a = np.roll(n, 1)
    tangents = None if tangent is None else np.tile(np.array(tangent, dtype=float), (3, 1))
    mesh = make_mesh([np.zeros(3), a, np.cross(n, a)], [[0, 1, 2]], np.tile(n, (3, 1)), tangents)

    points = make_shading_points(mesh, np.array([0]), np.full((1, 3), 1 / 3), n[None])

    basis = torch.stack([stack(v)[0] for v in (points.t, points.b, points.n)]).double()
    torch.testing.assert_close(basis @ basis.mT, torch.eye(3).double(), atol=1e-7, rtol=0)  # measured 0


# Framing.

VIEWS = [
    (shape, camera, height, width, azimuth, elevation)
    for shape in ("cloth", "bowl")
    for camera in ("perspective", "orthographic")
    for height, width in ((90, 90), (60, 120), (120, 60))
    for azimuth, elevation in ((30, 20), (-100, -35), (0, 90))
]


@pytest.mark.parametrize(("shape", "camera", "height", "width", "azimuth", "elevation"), VIEWS)
def test_by_default_all_of_the_mesh_is_seen_up_to_a_margin(shape, camera, height, width, azimuth, elevation):
    mesh = SHAPES[shape]()
    fov = 40.0 if camera == "perspective" else None

    seen = frame_vertices(mesh.vertices, width / height, azimuth, elevation, fov, 1.0)

    # Pixel coordinates by the textbook: axes, then the division by depth.
    x, y, z = seen.axes @ mesh.vertices.T - seen.middle[:, None]
    depth = -z if seen.perspective else np.ones_like(z)
    assert depth.min() > 0
    u, v = (c / depth / seen.half * min(height, width) / 2 for c in (x, y))
    reach = [np.array([u.min(), u.max()]) / (width / 2), np.array([v.min(), v.max()]) / (height / 2)]
    frame = 1 / (1 + MARGIN)
    longest = max(reach, key=lambda r: np.abs(r).max())
    np.testing.assert_allclose(longest, [-frame, frame], rtol=2e-15)  # measured 3.5e-16
    for r in reach:
        assert np.abs(r).max() < frame + 1e-14
        if camera == "orthographic":
            assert r.sum() == pytest.approx(0, abs=1e-14)  # measured 0


@pytest.mark.parametrize("camera", ["perspective", "orthographic"])
def test_each_pixel_shows_a_point_of_its_own_ray(camera):
    view = gb.view("mesh", shape="cloth", resolution=40, width=60, camera=camera)
    mesh = view.scene()
    fov = view.fov if camera == "perspective" else None
    seen = frame_vertices(mesh.vertices, 1.5, view.azimuth, view.elevation, fov, 1.0)

    position = stack(view.points().position).double().numpy()

    x, y, z = seen.axes @ position.T - seen.middle[:, None]
    depth = -z if seen.perspective else np.ones_like(z)
    rows, columns = view.mask().numpy().nonzero()
    # Measured 3e-5 of a pixel.
    np.testing.assert_allclose(x / depth / seen.half * 20 + 30 - 0.5, columns, atol=1.5e-4)
    np.testing.assert_allclose(20 - 0.5 - y / depth / seen.half * 20, rows, atol=1.5e-4)


def test_silhouette_of_a_box_seen_straight_is_its_rectangle():
    trimesh.creation.box(extents=[2, 1, 1]).export("box.ply")

    options = {"camera": "orthographic", "azimuth": 0.0, "elevation": 0.0, "zoom": 1 + MARGIN}
    mask = gb.view("mesh", shape="box.ply", resolution=40, **options).mask().numpy()

    expected = np.zeros((40, 40), dtype=bool)
    expected[10:30] = True
    np.testing.assert_array_equal(mask, expected)


def test_azimuth_turns_the_camera_to_the_right_and_elevation_lifts_it():
    axes = {a: frame_vertices(SHAPES["bowl"]().vertices, 1.0, *a, None, 1.0).axes for a in ((0, 0), (90, 0), (0, 90))}

    # Measured 6e-17 or less.
    np.testing.assert_allclose(axes[0, 0], np.eye(3), atol=3e-16)
    np.testing.assert_allclose(axes[90, 0][2], [1, 0, 0], atol=3e-16)  # back to the camera, which is at +x
    np.testing.assert_allclose(axes[0, 90][2], [0, 1, 0], atol=3e-16)
    np.testing.assert_allclose(axes[0, 90][1], [0, 0, -1], atol=3e-16)  # from above, up in the image is forward


def test_zoom_magnifies_about_the_middle():
    options = {"shape": "bowl", "resolution": 80, "camera": "orthographic"}
    wide, near = gb.view("mesh", **options), gb.view("mesh", zoom=2.0, **options | {"resolution": 160})

    np.testing.assert_array_equal(near.mask()[40:120, 40:120].numpy().mean() > 0.5, True)
    # A pixel of the wide image is one of the near one: the same rays.
    np.testing.assert_array_equal(
        wide.mask()[20:60, 20:60], gb.view("mesh", zoom=2.0, **options | {"resolution": 40}).mask()
    )


# What a study needs of a view.


def test_all_cameras_show_the_same_scene():
    scenes = {gb.view("mesh", shape="bowl", azimuth=a).scene() for a in (0.0, 50.0)}

    assert len(scenes) == 1
    assert gb.view("mesh", shape="cloth").scene() not in scenes


def test_the_key_is_that_of_the_files_bytes_and_of_the_camera(ball):
    key = gb.view("mesh", shape=ball).key()
    Path("same.ply").write_bytes(Path(ball).read_bytes())

    assert gb.view("mesh", shape="same.ply").key() == key
    assert gb.view("mesh", shape=ball, zoom=1.5).key() != key
    trimesh.creation.icosphere(2).export(ball)
    assert gb.view("mesh", shape=ball).key() != key
    assert gb.view("mesh", shape=ball).scene() != gb.view("mesh", shape="same.ply").scene()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"shape": "knot"}, "unknown mesh 'knot'; did you mean 'torus_knot'?"),
        ({"camera": "fisheye"}, "mesh.camera"),
        ({"fov": 0.5}, "mesh.fov must be greater than or equal to 1, got 0.5"),
        ({"elevation": 91.0}, "mesh.elevation must be less than or equal to 90, got 91.0"),
        ({"zoom": 0.0}, "mesh.zoom"),
    ],
)
def test_senseless_options_are_refused(options, message):
    with pytest.raises(InputError) as caught:
        gb.view("mesh", **options).points()

    assert str(caught.value).startswith(message)


def test_a_view_that_misses_the_mesh_is_refused():
    """Zoomed into the hole of the knot's middle."""
    view = gb.view("mesh", shape="torus_knot", azimuth=0.0, elevation=0.0, zoom=300.0, resolution=4)

    with pytest.raises(InputError, match=r"^mesh: no pixel shows 'torus_knot'"):
        view.mask()
