"""Triangle meshes: checked, repaired where this is safe, and scaled and moved to a standard size and position."""

import hashlib
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from glossbench.directions import Vec3, stack
from glossbench.errors import InputError
from glossbench.scene.points import Occluder
from glossbench.scene.rays import Rays
from glossbench.scene.winding import find_reversed_faces

# Measured on one thread on a bumpy sheet, including the structure for rays: 1.0 million faces took 6.0 s and at most
# 0.41 GB. In proportion (not measured) this limit takes a minute and 4 GB.
MAX_FACES = 10_000_000
# A triangle whose area is below this share of its longest edge squared has no reliable normal in float32.
FLAT = 1e-7

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Mesh(Occluder):
    """Triangles with a normal at each vertex. Two meshes are equal if all of their numbers are.

    The surface is opaque and is seen and lit from both sides. Lights are infinitely far, so size and position do not
    matter: `make_mesh` moves the centre of the mesh's bounding box to the origin and scales its longest half-edge to 1.

    Attributes:
        vertices: (V, 3), float64.
        faces: vertex numbers, counter-clockwise seen from outside, (F, 3), int64.
        normals: unit, (V, 3), float64; zero if the normals of the faces around a vertex cancel.
        tangents: (V, 3), float64; None if the surface does not have them.
        repairs: descriptions of the changes that were made.
        key: SHA-256 of all of these numbers.
    """

    vertices: Floats
    faces: NDArray[np.int64]
    normals: Floats
    tangents: Floats | None = None
    repairs: tuple[str, ...] = ()
    key: str = field(init=False)

    def __post_init__(self) -> None:
        arrays = [self.vertices, self.faces, self.normals, *([] if self.tangents is None else [self.tangents])]
        digest = hashlib.sha256()
        for array in arrays:
            array.setflags(write=False)
            digest.update(f"{array.shape} {array.dtype}".encode() + array.tobytes())
        object.__setattr__(self, "key", digest.hexdigest())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Mesh) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)

    @cached_property
    def rays(self) -> Rays:
        """The structure that answers rays, built at first use."""
        return Rays(self.vertices, self.faces)

    def face_normals(self, faces: NDArray[np.integer]) -> Floats:
        """Unit normals (N, 3) of some faces, on the side from which their vertices are counter-clockwise."""
        return _normalize(_cross_products(self.vertices, self.faces[faces]))

    def visible(self, position: Vec3, ng: Vec3, direction: Vec3) -> Tensor:
        """Whether light from a direction reaches a position, all (N,): bool (N,)."""
        free = self.rays.visible(*(stack(v).cpu().numpy() for v in (position, ng, direction)))
        return torch.from_numpy(free).to(position.x.device)


def make_mesh(
    vertices: ArrayLike,
    faces: ArrayLike,
    normals: ArrayLike | None = None,
    tangents: ArrayLike | None = None,
    name: str = "mesh",
) -> Mesh:
    """Makes a mesh of unit size from any triangles.

    These repairs are made and listed in `repairs`: faces without area are left out; if a given normal is zero or not
    finite, all normals are computed; if normals are computed, faces with a winding against their neighbours are
    reversed. A mesh that is inside out, has holes or edges of three or more faces, or cuts itself is not changed: rays
    do not need it.

    Args:
        vertices: (V, 3), any size and place.
        faces: (F, 3), vertex numbers.
        normals: outward normals at vertices, (V, 3), any length; by default the mean of the normals of the faces around
            a vertex and all vertices at the same position, weighted by angle (Thuermer and Wuethrich 1998).
        tangents: tangents at vertices, (V, 3), any length.
        name: name of the mesh in errors.

    Raises:
        InputError: there are no faces or none with an area, a number is not finite, a vertex does not exist, or there
            are more than MAX_FACES faces.
    """
    v, f = _check_mesh(name, vertices, faces)
    low, high = v[f].min((0, 1)), v[f].max((0, 1))
    size = float((high / 2 - low / 2).max())
    if not size > 0:
        raise InputError(f"{name} has no size: all vertices of its {len(f)} faces are at one place")
    v = (v - (low / 2 + high / 2)) / size
    repairs: list[str] = []

    kept = _has_area(v, f)
    if not kept.any():
        raise InputError(f"{name} has no face with an area, of {len(f)}")
    if not kept.all():
        repairs.append(f"left out {int((~kept).sum())} of {len(f)} faces, which have no area")
        f = f[kept]
    used, f = np.unique(f, return_inverse=True)
    f = f.reshape(-1, 3)
    v = v[used]
    n, t = (None if a is None else np.asarray(a, np.float64)[used] for a in (normals, tangents))
    if n is not None and not (np.isfinite(n).all() and n.any(axis=1).all()):
        repairs.append("computed new normals, because the stated ones are zero or not finite")
        n = None
    if n is None:
        v, first, place = np.unique(v, axis=0, return_index=True, return_inverse=True)
        f, t = place.reshape(-1)[f], None if t is None else t[first]
        against = find_reversed_faces(f)
        if against.any():
            repairs.append(
                f"turned {int(against.sum())} of {len(f)} faces, whose winding was opposite to that of their neighbours"
            )
            f[against] = f[against, ::-1]
        n = _vertex_normals(v, f)
    return Mesh(v, f, _normalize(n), t, tuple(repairs))


def _check_mesh(name: str, vertices: ArrayLike, faces: ArrayLike) -> tuple[Floats, NDArray[np.int64]]:
    v, f = np.asarray(vertices, np.float64), np.asarray(faces)
    if f.size == 0:
        raise InputError(f"{name} has no faces")
    if v.ndim != 2 or v.shape[1] != 3 or f.ndim != 2 or f.shape[1] != 3:
        raise InputError(f"{name} needs vertices (V, 3) and triangles (F, 3), got {v.shape} and {f.shape}")
    if len(f) > MAX_FACES:
        raise InputError(f"{name} has {len(f)} faces, more than {MAX_FACES}; reduce it first")
    if f.min() < 0 or f.max() >= len(v):
        bad = int(((f < 0) | (f >= len(v))).any(axis=1).argmax())
        raise InputError(f"{name} has {len(v)} vertices, but face {bad} has {f[bad].tolist()}")
    used = np.unique(f)
    wrong = used[~np.isfinite(v[used]).all(axis=1)]
    if len(wrong):
        bad = int(wrong[0])
        raise InputError(f"{name} must be finite everywhere, but vertex {bad} is at {v[bad].tolist()}")
    return v, f.astype(np.int64)


def _has_area(v: Floats, f: NDArray[np.int64]) -> NDArray[np.bool_]:
    a, b, c = (v[f[:, k]] for k in range(3))
    longest = np.max([((p - q) ** 2).sum(1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    return np.linalg.norm(_cross_products(v, f), axis=1) > FLAT * longest


def _cross_products(v: Floats, f: NDArray[np.int64]) -> Floats:
    return np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]])


def _normalize(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0, length, 1)


def _vertex_normals(v: Floats, f: NDArray[np.int64]) -> Floats:
    """Mean of the normals of the faces around each vertex, weighted by their angles at this vertex."""
    corners = v[f]
    ahead = _normalize((np.roll(corners, -1, 1) - corners).reshape(-1, 3)).reshape(corners.shape)
    angles = np.arccos(np.clip(-(ahead * np.roll(ahead, 1, 1)).sum(2), -1, 1))
    weighted = _normalize(_cross_products(v, f))[:, None] * angles[:, :, None]
    return np.stack([np.bincount(f.reshape(-1), weighted[..., k].reshape(-1), len(v)) for k in range(3)], axis=1)
