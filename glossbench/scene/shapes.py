"""Shapes that shadow themselves, defined by formulas, with the normals and tangents of the smooth surface."""

from collections.abc import Callable
from math import pi

import numpy as np
from numpy.typing import NDArray

from glossbench.scene.mesh import Mesh, make_mesh

Floats = NDArray[np.float64]


def cloth(rows: int = 160, n_waves: int = 24, seed: int = 1) -> Mesh:
    """A wrinkled square cloth of 2 rows^2 triangles; tangents are along its threads, which lie along x.

    Height y = sum of a_k cos(k . (x, z) + phase) over random waves, 1 to 7 across the cloth, with equal slopes a_k |k|.
    """
    rng = np.random.default_rng(seed)
    angle, waves, phase = rng.uniform(0, pi, n_waves), rng.uniform(1, 7, n_waves), rng.uniform(0, 2 * pi, n_waves)
    k = pi * waves * np.stack([np.cos(angle), np.sin(angle)])
    amplitude = 1.2 / np.sqrt(n_waves) / (pi * waves)
    x, z = (g.reshape(-1, 1) for g in np.meshgrid(*[np.linspace(-1, 1, rows + 1)] * 2))
    theta = x * k[0] + z * k[1] + phase
    y = (amplitude * np.cos(theta)).sum(1)
    slope_x, slope_z = (-(amplitude * np.sin(theta)) @ c for c in k)
    one, zero = np.ones_like(y), np.zeros_like(y)
    return make_mesh(
        np.stack([x[:, 0], y, z[:, 0]], axis=1),
        _make_grid(rows + 1, rows + 1).reshape(-1, 3),
        np.stack([-slope_x, one, -slope_z], axis=1),
        np.stack([one, slope_x, zero], axis=1),
        "cloth",
    )


def torus_knot(p: int = 2, q: int = 3, radius: float = 0.4, around: int = 32, along: int = 640) -> Mesh:
    """A tube of 2 around along triangles on the knot ((2 + cos qs) cos ps, (2 + cos qs) sin ps, sin qs).

    Tangents are along the tube.
    """
    s = np.arange(along) * 2 * pi / along
    ring = 2 + np.cos(q * s)
    centre = np.stack([ring * np.cos(p * s), ring * np.sin(p * s), np.sin(q * s)], axis=1)
    ahead = np.stack(
        [
            -q * np.sin(q * s) * np.cos(p * s) - p * ring * np.sin(p * s),
            -q * np.sin(q * s) * np.sin(p * s) + p * ring * np.cos(p * s),
            q * np.cos(q * s),
        ],
        axis=1,
    )
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    # The knot lies on a torus, whose normal is orthogonal to it.
    out = np.stack([np.cos(q * s) * np.cos(p * s), np.cos(q * s) * np.sin(p * s), np.sin(q * s)], axis=1)
    side = np.cross(out, ahead)
    v = (np.arange(around) * 2 * pi / around)[None, :, None]
    normals = np.cos(v) * out[:, None] + np.sin(v) * side[:, None]
    vertices = centre[:, None] + radius * normals
    tangents = np.broadcast_to(ahead[:, None], normals.shape)
    vertices, normals, tangents = (a.reshape(-1, 3) for a in (vertices, normals, tangents))
    return make_mesh(
        vertices, _make_grid(along, around, closed=(True, True)).reshape(-1, 3), normals, tangents, "torus_knot"
    )


def bowl(inner: float = 0.9, around: int = 192, arc: int = 48, rim: int = 12) -> Mesh:
    """Half a hollow ball of outer radius 1, open to +y, with a round rim; tangents are along circles of latitude.

    It has 4 around (arc + rim / 2) triangles, less those without area at the two poles.
    """
    middle, width = (1 + inner) / 2, (1 - inner) / 2
    up, over = np.linspace(-pi / 2, 0, arc + 1), np.linspace(0, pi, rim + 1)[1:-1]
    down = up[::-1]
    radius = np.concatenate([np.cos(up), middle + width * np.cos(over), inner * np.cos(down)])
    height = np.concatenate([np.sin(up), width * np.sin(over), inner * np.sin(down)])
    normal_out = np.concatenate([np.cos(up), np.cos(over), -np.cos(down)])
    normal_up = np.concatenate([np.sin(up), np.sin(over), -np.sin(down)])
    radius[[0, -1]] = 0
    phi = np.arange(around) * 2 * pi / around
    x, z = np.cos(phi), np.sin(phi)

    def revolve(out: Floats, along_y: Floats) -> Floats:
        y = np.broadcast_to(along_y[:, None], (len(out), around))
        return np.stack([out[:, None] * x, y, out[:, None] * z], axis=2).reshape(-1, 3)

    tangents = np.tile(np.stack([z, np.zeros(around), -x], axis=1), (len(radius), 1))
    quads = _make_grid(len(radius), around, closed=(False, True))
    # At the poles a row is one point, and one triangle of each quad has no area.
    faces = np.concatenate([quads[0, :, 0], quads[1:-1].reshape(-1, 3), quads[-1, :, 1]])
    return make_mesh(revolve(radius, height), faces, revolve(normal_out, normal_up), tangents, "bowl")


def _make_grid(rows: int, columns: int, closed: tuple[bool, bool] = (False, False)) -> NDArray[np.int64]:
    """Two triangles per quad of a grid of vertices: (rows, columns, 2, 3), one row or column less if it is not closed.

    Triangles are counter-clockwise seen from the side where rows go down and columns to the right.
    """
    i, j = (np.arange(n if wraps else n - 1) for n, wraps in zip((rows, columns), closed, strict=True))
    i, j = i[:, None], j[None]
    below, right = (i + 1) % rows, (j + 1) % columns
    a, b, c, d = i * columns + j, below * columns + j, below * columns + right, i * columns + right
    return np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)], axis=2)


SHAPES: dict[str, Callable[[], Mesh]] = {"bowl": bowl, "cloth": cloth, "torus_knot": torus_knot}
