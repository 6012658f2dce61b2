"""Meshes by name: an embedded shape, one of the catalogue, or a file."""

import hashlib
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glossbench.catalog import entries, fetch
from glossbench.errors import InputError, nearest
from glossbench.scene.mesh import Mesh, make_mesh
from glossbench.scene.shapes import SHAPES

FORMATS = (".obj", ".ply", ".glb", ".gltf", ".stl")


def mesh_named(name: str) -> Mesh:
    """The mesh of a name or a path.

    Raises:
        InputError: no such name or file, or a file that holds no mesh that can be shaded.
    """
    if name in SHAPES:
        return _shape(name)
    path = _path_of(name)
    return _of_file(path, _digest(path))


def meaning_of(name: str) -> str:
    """What a name stands for, as text: of a file, its bytes."""
    return name if name in SHAPES else _digest(_path_of(name))


def load_mesh(path: Path | str) -> Mesh:
    """The mesh of a Wavefront OBJ, PLY, glTF or STL file; all of its parts as one, textures and colours left out.

    Normals of the file are kept; where it has none they are made, see `make_mesh`. Tangents it never states.

    Raises:
        InputError: an unknown format, a file that cannot be read, or a mesh that cannot be repaired.
    """
    import trimesh  # takes a third of a second, which shapes need not wait for

    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"{path}: a mesh must be one of {', '.join(FORMATS)}")
    try:
        scene: Any = trimesh.load_scene(path, process=False)
        placed = [(scene.geometry[scene.graph[node][1]], scene.graph[node][0]) for node in scene.graph.nodes_geometry]
        parts = [_placed(part, matrix) for part, matrix in placed if isinstance(part, trimesh.Trimesh)]
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except Exception as error:  # a broken file breaks its reader in many ways
        first = (str(error).splitlines() or [""])[0]
        raise InputError(f"{path}: not a mesh that can be read: {type(error).__name__}: {first}") from error
    if not parts:
        raise InputError(f"{path} has no faces")
    starts = np.cumsum([0, *(len(vertices) for vertices, _, _ in parts)])
    faces = np.concatenate([f + start for (_, f, _), start in zip(parts, starts, strict=False)])
    normals = [n for _, _, n in parts if n is not None]
    stated = np.concatenate(normals) if len(normals) == len(parts) else None
    return make_mesh(np.concatenate([v for v, _, _ in parts]), faces, stated, name=str(path))


def _placed(part: Any, matrix: NDArray[np.float64]) -> tuple[Any, Any, Any]:
    """Vertices and faces of a part in its scene, and normals where the file states some."""
    turned = matrix[:3, :3]
    # Asked for, trimesh makes normals; those of the file it keeps in its cache from the beginning.
    stated = part.vertex_normals @ np.linalg.inv(turned) if "vertex_normals" in part._cache else None
    return part.vertices @ turned.T + matrix[:3, 3], part.faces, stated


# Kept, because each cell of a study asks for its mesh anew, and rays need a second to be ready for a large one.


@lru_cache(maxsize=4)
def _shape(name: str) -> Mesh:
    return SHAPES[name]()


@lru_cache(maxsize=4)
def _of_file(path: Path, digest: str) -> Mesh:
    mesh = load_mesh(path)
    if _digest(path) != digest:
        raise InputError(f"{path}: was changed while it was read; run it again")
    return mesh


def _path_of(name: str) -> Path:
    known = {entry.name for entry in entries("mesh")}
    if name in known:
        return fetch(name)
    if not Path(name).suffix:
        raise InputError(f"unknown mesh {name!r}{nearest(name, [*SHAPES, *known])}")
    if not Path(name).is_file():
        raise InputError(f"no mesh file {name!r}: not in {Path.cwd()}")
    return Path(name)


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
