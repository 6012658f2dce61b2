"""Cuts polygons into triangles: into a fan if it covers the polygon, otherwise into ears."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glossbench.errors import InputError

# Every corner may be an ear: the time grows with the square of their number; 10,000 take seconds.
MAX_CONCAVE_CORNERS = 10_000
# Twice an area, in a polygon whose box is 1 wide: smaller values are rounding errors.
NOTHING = 1e-13

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Surface(NamedTuple):
    """The content of a mesh file: vertices (V, 3), triangles (F, 3) of vertex numbers, and normals (V, 3) or None."""

    vertices: Floats
    faces: Ints
    normals: Floats | None


def triangulate(name: str, vertices: Floats, corners: Ints, counts: Ints) -> Ints:
    """Triangles (T, 3) of polygons, as positions in `corners`; they have the winding of their polygon.

    A polygon is cut into a fan from its first corner if all triangles of this fan have the same winding about the
    polygon's mean normal, as in convex polygons. Others are cut into ears, seen along this normal: concave polygons,
    and those with a hole that a bridge of two equal edges joins to the outline. Polygons of fewer than three corners
    are left out.

    Args:
        name: name of the mesh in errors.
        vertices: (V, 3).
        corners: vertex numbers of all polygons, one polygon after the other, (C,).
        counts: number of corners of each polygon, (P,).

    Raises:
        InputError: a vertex does not exist, or a polygon of more than 10,000 corners is not a fan.

    Source: the mean normal, Newell in Sutherland et al. 1974; ears, Meisters 1975.
    """
    if len(corners) and (corners.min() < 0 or corners.max() >= len(vertices)):
        bad = int(((corners < 0) | (corners >= len(vertices))).argmax())
        face = int(np.searchsorted(np.cumsum(counts), bad, side="right"))
        raise InputError(f"{name} has {len(vertices)} vertices, but face {face} has vertex {corners[bad]}, from 0")
    starts = np.cumsum(counts) - counts
    found: list[Ints] = []
    places: list[Ints] = []  # numbers of the polygons of these triangles, to restore the order
    for n in np.unique(counts[counts > 2]):
        of_size = np.flatnonzero(counts == n)
        fan = np.stack([np.zeros(n - 2, int), np.arange(1, n - 1), np.arange(2, n)], axis=1)
        is_fan = np.ones(len(of_size), bool)
        if n > 3:
            points = vertices[corners[starts[of_size, None] + np.arange(n)]]
            with np.errstate(invalid="ignore", over="ignore"):  # numbers that are not finite are refused later
                is_fan = _mark_fans(points)
        found.append((starts[of_size[is_fan], None, None] + fan).reshape(-1, 3))
        places.append(np.repeat(of_size[is_fan], n - 2))
        for i in np.flatnonzero(~is_fan):
            if n > MAX_CONCAVE_CORNERS:
                raise InputError(f"{name}: face {of_size[i]} has {n} corners and is not a fan; cut it into triangles")
            ears = _cut_ears(points[i])
            found.append(starts[of_size[i]] + ears)
            places.append(np.repeat(of_size[i], len(ears)))
    if not found:
        return np.zeros((0, 3), np.int64)
    return np.concatenate(found)[np.argsort(np.concatenate(places), kind="stable")]


def _mark_fans(points: Floats) -> NDArray[np.bool_]:
    """Whether the fan from the first corner covers each polygon (P, n, 3)."""
    rays = points[:, 1:] - points[:, :1]
    crosses = np.cross(rays[:, :-1], rays[:, 1:])
    along = (crosses * crosses.sum(1, keepdims=True)).sum(2)
    # "Not <" makes a polygon that is not finite a fan: `make_mesh` then refuses it and names its vertex.
    return ~(along < -NOTHING * np.abs(along).sum(1, keepdims=True)).any(axis=1)


def _cut_ears(points: Floats) -> Ints:
    """Triangles (T, 3) of one polygon (n, 3), as numbers of its corners."""
    xy = _flatten(points)
    ring = np.arange(len(xy))
    found = []
    at = 0
    while len(ring) > 3:
        n = len(ring)
        a, b, c = xy[np.roll(ring, 1)], xy[ring], xy[np.roll(ring, -1)]
        doubled = _compute_doubled_areas(a, b, c)
        # A spike runs there and back, or repeats a point: it has no area, and an ear next to it could lie outside.
        spikes = np.flatnonzero((np.abs(doubled) <= NOTHING) & (((a - b) * (c - b)).sum(1) >= 0))
        if len(spikes):
            ring, at = np.delete(ring, spikes[0]), 0
            continue
        # Start at the last ear, so that the triangles go around and do not all share one corner.
        candidates = [i % n for i in range(at, at + n) if doubled[i % n] > NOTHING]
        ear = next((i for i in candidates if _is_free(xy[ring], i)), None)
        if ear is None:  # only straight corners are left, or the polygon cuts itself and has no correct triangles
            ear = int(np.abs(doubled).argmin())
        if doubled[ear] > NOTHING:
            found.append((ring[ear - 1], ring[ear], ring[(ear + 1) % n]))
        ring, at = np.delete(ring, ear), ear
    if _compute_doubled_areas(*xy[ring]) > NOTHING:
        found.append((ring[0], ring[1], ring[2]))
    return np.array(found, np.int64).reshape(-1, 3)


def _flatten(points: Floats) -> Floats:
    """Corners (n, 2) projected along the polygon's mean normal: counter-clockwise, in a box of 1."""
    points = points - points.mean(0)
    points = points / max(float(np.abs(points).max()), 1e-300)
    normal = np.cross(points, np.roll(points, -1, 0)).sum(0)
    normal = normal / max(float(np.linalg.norm(normal)), 1e-300)
    right = np.cross(np.eye(3)[np.abs(normal).argmin()], normal)
    right = right / max(float(np.linalg.norm(right)), 1e-300)
    return points @ np.stack([right, np.cross(normal, right)], axis=1) / 2


def _is_free(xy: Floats, i: int) -> bool:
    """Whether no part of the polygon lies inside the triangle of corner i or on the cut that removes it."""
    n = len(xy)
    a, b, c = xy[i - 1], xy[i], xy[(i + 1) % n]
    sides = np.stack([_compute_doubled_areas(p, q, xy) for p, q in ((a, b), (b, c), (c, a))])
    at_corner = [(xy == corner).all(1) for corner in (a, b, c)]
    inside = (sides[:2] > NOTHING).all(0) & (sides[2] > -NOTHING)
    if (inside & ~np.any(at_corner, axis=0)).any():
        return False
    # A bridge may end in b: then other edges start there, and must not enter the ear and leave it through the cut.
    for j in np.flatnonzero(at_corner[1]):
        if j != i and any((sides[:2, k % n] > NOTHING).all() for k in (j - 1, j + 1)):
            return False
    return True


def _compute_doubled_areas(a: Floats, b: Floats, c: Floats) -> Floats:
    """Twice the area of triangles, positive if they are counter-clockwise."""
    u, v = b - a, c - a
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])
