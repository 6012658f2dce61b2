"""Polygons cut into triangles: their area, their winding, and what no triangle may leave or touch."""

import numpy as np
import pytest

from glossbench.errors import InputError
from glossbench.scene.formats import polygons
from glossbench.scene.formats.polygons import triangulate

ARROW = [(0, 0), (2, 0), (2, 2), (1, 0.2), (0, 2)]
COMB = [(0, 0), (7, 0), (7, 3), (6, 3), (6, 1), (5, 1), (5, 3), (4, 3), (4, 1), (3, 1), (3, 3), (0, 3)]
SPIRAL = [
    (0, 0),
    (6, 0),
    (6, 6),
    (1, 6),
    (1, 2),
    (4, 2),
    (4, 4),
    (3, 4),
    (3, 3),
    (2, 3),
    (2, 5),
    (5, 5),
    (5, 1),
    (0, 1),
]
# A square with a square hole: the bridge from (0, 0) to (1, 1) is walked there and back.
FRAME = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]
TWO_HOLES = [
    (0, 0), (9, 0), (9, 4), (0, 4), (0, 0),
    (1, 1), (1, 3), (3, 3), (3, 1), (1, 1), (0, 0),
    (5, 1), (5, 3), (8, 3), (8, 1), (5, 1),
]  # fmt: skip
STRAIGHT = [(0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (1, 0.5), (0, 2), (0, 1)]
DOUBLED = [(0, 0), (2, 0), (2, 0), (2, 2), (1, 0.2), (1, 0.2), (0, 2)]
SPIKE = [(0, 0), (2, 0), (2, 2), (3, 3), (2, 2), (1, 0.2), (0, 2)]
SHAPES = {
    "arrow": (ARROW, 2.2),
    "comb": (COMB, 17.0),
    "spiral": (SPIRAL, 21.0),
    "frame": (FRAME, 12.0),
    "straight corners": (STRAIGHT, 2.5),
    "doubled corners": (DOUBLED, 2.2),
    "a spike": (SPIKE, 2.2),
}
PLANES = {
    "from above": np.array([[1, 0, 0], [0, 1, 0]]),
    "from below": np.array([[0, 1, 0], [1, 0, 0]]),
    "aslant and large": np.array([[300, 200, -100], [-100, 500, 700]]),
}


def doubled_areas(corners):
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def cut(points):
    points = np.asarray(points, float)
    return points[triangulate("x", points, np.arange(len(points)), np.array([len(points)]))]


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("shape", SHAPES)
def test_triangles_cover_the_polygon_once_and_turn_as_it_does(shape, plane):
    corners, area = SHAPES[shape]
    axes = PLANES[plane]
    for start in range(len(corners)):
        points = np.roll(np.array(corners, float), start, axis=0) @ axes

        triangles = cut(points)

        normals = doubled_areas(triangles) @ np.cross(*axes) / (np.cross(*axes) @ np.cross(*axes)) / 2
        assert normals.min() > -1e-12
        assert normals.sum() == pytest.approx(area, rel=1e-12)


def inside(xy, corners):
    """Whether points (N, 2) lie inside a polygon, by how often a ray along x crosses it."""
    a, b = np.array(corners, float), np.roll(np.array(corners, float), -1, axis=0)
    between = (a[:, 1] > xy[:, None, 1]) != (b[:, 1] > xy[:, None, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        x = a[:, 0] + (xy[:, None, 1] - a[:, 1]) * (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
    return (between & (x > xy[:, None, 0])).sum(1) % 2 == 1


def times_covered(triangles, xy):
    a, b, c = (triangles[:, k, None, :2] for k in range(3))
    sides = [
        (q - p)[..., 0] * (xy - p)[..., 1] - (q - p)[..., 1] * (xy - p)[..., 0] for p, q in ((a, b), (b, c), (c, a))
    ]
    return (np.stack(sides) > 0).all(0).sum(0)


def wild(seed, n=24):
    """A star of very different radii: simple, and far from convex."""
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.random(n)) * 2 * np.pi
    return np.stack([np.cos(angles), np.sin(angles)], 1) * rng.uniform(0.05, 1, (n, 1))


@pytest.mark.parametrize("corners", [FRAME, SPIRAL, COMB, STRAIGHT, *map(wild, range(12))])
def test_each_point_lies_in_one_triangle_if_inside_and_in_none_if_outside(corners):
    corners = np.asarray(corners, float)
    xy = np.random.default_rng(1).uniform(corners.min(0), corners.max(0), (400, 2))

    triangles = cut(np.c_[corners, np.zeros(len(corners))])

    np.testing.assert_array_equal(times_covered(triangles, xy), inside(xy, corners).astype(int))


def test_a_fan_would_be_noticed(monkeypatch):
    monkeypatch.setattr(polygons, "_mark_fans", lambda points: np.ones(len(points), bool))

    triangles = cut(np.c_[np.array(ARROW, float), np.zeros(5)])

    assert np.linalg.norm(doubled_areas(triangles), axis=1).sum() / 2 == pytest.approx(3.8)


def test_two_holes_that_hang_on_one_corner_stay_open():
    triangles = cut(np.c_[np.array(TWO_HOLES, float), np.zeros(len(TWO_HOLES))])

    assert np.linalg.norm(doubled_areas(triangles), axis=1).sum() / 2 == pytest.approx(36 - 4 - 6)


def test_a_convex_polygon_is_the_fan_from_its_first_corner():
    angles = np.arange(7) / 7 * 2 * np.pi
    points = np.stack([np.cos(angles), np.sin(angles), 0 * angles], 1)

    faces = triangulate("x", points, np.arange(7), np.array([7]))

    np.testing.assert_array_equal(faces, [[0, i, i + 1] for i in range(1, 6)])


def test_a_polygon_that_is_not_flat_is_cut_as_it_looks_along_its_mean_normal():
    bent = np.array([[0, 0, 0.1], [2, 0, -0.1], [2, 2, 0.1], [1, 0.2, -0.1], [0, 2, 0.1]])

    triangles = cut(bent)

    assert doubled_areas(triangles)[:, 2].min() > 0
    assert doubled_areas(triangles)[:, 2].sum() / 2 == pytest.approx(2.2)


def test_polygons_of_all_sizes_keep_their_order_and_give_places_of_corners():
    points = np.c_[np.array(ARROW, float), np.zeros(5)]
    corners = np.array([0, 1, 2, 3, 4, 2, 1, 0, 0, 1, 0, 1, 2, 3])

    faces = triangulate("x", points, corners, np.array([5, 3, 2, 4]))

    assert faces[:3].max() == 4
    np.testing.assert_array_equal(faces[3], [5, 6, 7])
    assert (faces[4:].min(), faces[4:].max()) == (10, 13)


def test_a_polygon_that_cuts_itself_ends_in_triangles():
    star = np.array([(np.cos(a), np.sin(a), 0) for a in np.arange(5) * 4 * np.pi / 5])

    assert 0 < len(cut(star)) <= 3


def test_a_concave_polygon_of_very_many_corners_is_refused(monkeypatch):
    monkeypatch.setattr(polygons, "MAX_CONCAVE_CORNERS", 4)

    with pytest.raises(InputError, match=r"^x: face 0 has 5 corners and is not a fan; cut it into triangles$"):
        cut(np.c_[np.array(ARROW, float), np.zeros(5)])


def test_a_vertex_that_is_not_there_is_named_with_its_face():
    with pytest.raises(InputError, match=r"^x has 3 vertices, but face 1 has vertex 7, from 0$"):
        triangulate("x", np.eye(3), np.array([0, 1, 2, 0, 7, 1]), np.array([3, 3]))
