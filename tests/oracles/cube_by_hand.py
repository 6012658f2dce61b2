"""The cube of a light by its own words: the table of its faces, and the bilinear interpolant over its borders."""

import numpy as np
from scipy.spatial import cKDTree

# The face table of the cube's convention: normal, to the right, down.
FACES = np.array(
    [
        [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
        [[-1, 0, 0], [0, 0, -1], [0, -1, 0]],
        [[0, 1, 0], [1, 0, 0], [0, 0, -1]],
        [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
        [[0, 0, 1], [-1, 0, 0], [0, -1, 0]],
        [[0, 0, -1], [1, 0, 0], [0, -1, 0]],
    ],
    dtype=float,
)


def centres(n):
    return (2 * np.arange(n) + 1) / n - 1


def face_points(s, t):
    """Points (6, len(t), len(s), 3) of the cube [-1, 1]^3."""
    n, right, down = (FACES[:, None, None, k] for k in range(3))
    return n + s[None, None, :, None] * right + t[None, :, None, None] * down


def with_border(faces):
    """Each border texel is the texel of another face whose centre lies nearest to the edge between them."""
    r = faces.shape[1]
    points = face_points(centres(r), centres(r))
    padded = np.zeros((6, r + 2, r + 2, 3))
    padded[:, 1:-1, 1:-1] = faces
    for face in range(6):
        others = [k for k in range(6) if k != face]
        near, colors = cKDTree(points[others].reshape(-1, 3)), faces[others].reshape(-1, 3)
        (n, right, down), along = FACES[face], centres(r)[:, None]
        padded[face, 0, 1:-1], padded[face, -1, 1:-1], padded[face, 1:-1, 0], padded[face, 1:-1, -1] = (
            colors[near.query(edge)[1]]
            for edge in (
                n + along * right - down,
                n + along * right + down,
                n - right + along * down,
                n + right + along * down,
            )
        )
        for y, x, ny, nx in ((0, 0, 1, 1), (0, -1, 1, -2), (-1, 0, -2, 1), (-1, -1, -2, -2)):
            padded[face, y, x] = (padded[face, ny, nx] + padded[face, y, nx] + padded[face, ny, x]) / 3
    return padded


def fine_light(faces, k):
    """Directions, radiance and solid angles of k^2 sub-texels a texel, flat."""
    r = faces.shape[1]
    at = (np.arange(r * k) + 0.5) / k + 0.5  # in the padded grid, whose texel centres are integers
    low, part = at.astype(int), at % 1
    padded = with_border(faces)
    rows = padded[:, low] * (1 - part)[:, None, None] + padded[:, low + 1] * part[:, None, None]
    radiance = rows[:, :, low] * (1 - part)[:, None] + rows[:, :, low + 1] * part[:, None]
    points = face_points(centres(r * k), centres(r * k))
    distance = np.linalg.norm(points, axis=-1, keepdims=True)
    edge = np.linspace(-1, 1, r * k + 1)
    corner = np.arctan2(edge[None] * edge[:, None], np.sqrt(edge[None] ** 2 + edge[:, None] ** 2 + 1))
    solid_angle = np.broadcast_to(np.diff(np.diff(corner, axis=0), axis=1), (6, r * k, r * k))
    return (points / distance).reshape(-1, 3), radiance.reshape(-1, 3), solid_angle.reshape(-1)
