"""Rays against triangles: the first hit, and whether a point sees a direction, by Embree in float32."""

from typing import NamedTuple

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

# How far a shadow ray starts off its surface, where the mesh has a half-extent of 1. Rounding moves points and planes
# by about 1e-7: of 400 000 rays off flattened balls of 320 to 81 920 triangles, half of them within 0.06 degrees of the
# surface, 195 000 were stopped by it at offset 0, 14 at 6e-8, 1 at 2.5e-7, none from 5e-7 on.
OFFSET = 2e-6

Array = NDArray[np.floating]


class Hits(NamedTuple):
    """What rays hit first.

    Attributes:
        face: number of the triangle, (N,); -1 where a ray hits none.
        barycentric: weights of its three vertices, (N, 3), float64.
        distance: along the ray in lengths of its direction, (N,); infinite where it hits none.
    """

    face: NDArray[np.int32]
    barycentric: NDArray[np.float64]
    distance: NDArray[np.float32]


class Rays:
    """Triangles that answer rays. Edges are watertight: no ray slips between two triangles that share one.

    Aimed exactly at a vertex, some do: 32 of 2562 from within a flattened ball; nothing drawn at random is so exact.

    Args:
        vertices: (V, 3), within [-1, 1], so that the offset of shadow rays fits.
        faces: (F, 3), vertex numbers.
    """

    def __init__(self, vertices: Array, faces: NDArray[np.integer]) -> None:
        self._scene = EmbreeScene(robust=True)
        TriangleMesh(self._scene, np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.int32))

    def first_hit(self, origins: Array, directions: Array) -> Hits:
        """The nearest triangle in front of each ray (N, 3), seen from either side."""
        found = self._scene.run(_floats(origins), _floats(directions), output=True)
        face, u, v = found["primID"], found["u"].astype(np.float64), found["v"].astype(np.float64)
        distance = np.where(face < 0, np.float32(np.inf), found["tfar"])
        return Hits(face, np.stack([1 - u - v, u, v], axis=1), distance)

    def visible(self, points: Array, normals: Array, directions: Array) -> NDArray[np.bool_]:
        """Whether nothing stands between a surface point and infinity, (N,).

        Args:
            points: on the surface, (N, 3).
            normals: of the triangle itself, on the side that is lit, unit, (N, 3); the ray starts OFFSET along it.
            directions: (N, 3); those behind the surface are not visible, and no ray is cast for them.
        """
        above = np.einsum("nk,nk->n", normals, directions) > 0
        starts = _floats(points[above] + OFFSET * normals[above])
        free = np.zeros(len(points), dtype=bool)
        if len(starts):
            free[above] = self._scene.run(starts, _floats(directions[above]), query="OCCLUDED") < 0
        return free


def _floats(values: Array) -> NDArray[np.float32]:
    return np.ascontiguousarray(values, np.float32)
