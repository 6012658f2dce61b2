"""Rays against triangles, by Embree in float32: the first hit, and whether light from a direction reaches a point."""

from typing import NamedTuple

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

# Distance of the start of a shadow ray from its surface; the mesh has a half-extent of 1. Rounding moves points and
# planes by about 1e-7. Of 400 000 rays from flattened balls of 320 to 81 920 triangles, half of them within 0.06
# degrees of the surface, it stopped 195 000 at offset 0, 14 at 6e-8, 1 at 2.5e-7, and none from 5e-7 on.
OFFSET = 2e-6

Array = NDArray[np.floating]


class Hits(NamedTuple):
    """The first hits of rays.

    Attributes:
        face: number of the triangle, (N,); -1 if a ray does not hit one.
        barycentric: weights of its three vertices, (N, 3), float64.
        distance: distance along the ray in lengths of its direction, (N,); infinite if it does not hit a triangle.
    """

    face: NDArray[np.int32]
    barycentric: NDArray[np.float64]
    distance: NDArray[np.float32]


class Rays:
    """Triangles that answer rays. Edges are watertight: rays do not pass between two triangles that share an edge.

    Some rays that aim exactly at a vertex do pass: 32 of 2562 from inside a flattened ball. Random rays do not aim so
    exactly.

    Args:
        vertices: (V, 3), within [-1, 1], so that the offset of shadow rays fits.
        faces: (F, 3), vertex numbers.
    """

    def __init__(self, vertices: Array, faces: NDArray[np.integer]) -> None:
        self._scene = EmbreeScene(robust=True)
        TriangleMesh(self._scene, np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.int32))

    def first_hit(self, origins: Array, directions: Array) -> Hits:
        """The nearest triangle in front of each ray (N, 3), from either side of the triangle."""
        found = self._scene.run(_to_floats(origins), _to_floats(directions), output=True)
        face, u, v = found["primID"], found["u"].astype(np.float64), found["v"].astype(np.float64)
        distance = np.where(face < 0, np.float32(np.inf), found["tfar"])
        return Hits(face, np.stack([1 - u - v, u, v], axis=1), distance)

    def visible(self, points: Array, normals: Array, directions: Array) -> NDArray[np.bool_]:
        """Whether nothing is between a surface point and infinity, (N,).

        Args:
            points: on the surface, (N, 3).
            normals: unit normals of the triangles, on the side that is lit, (N, 3); rays start OFFSET along them.
            directions: (N, 3); directions behind the surface are not visible and need no ray.
        """
        above = np.einsum("nk,nk->n", normals, directions) > 0
        starts = _to_floats(points[above] + OFFSET * normals[above])
        free = np.zeros(len(points), dtype=bool)
        if len(starts):
            free[above] = self._scene.run(starts, _to_floats(directions[above]), query="OCCLUDED") < 0
        return free


def _to_floats(values: Array) -> NDArray[np.float32]:
    return np.ascontiguousarray(values, np.float32)
