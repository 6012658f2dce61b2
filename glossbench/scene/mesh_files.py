"""Meshes by name: an embedded shape, a mesh of the catalogue, or a file."""

import hashlib
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

from glossbench.catalog.entries import fetch, list_entries
from glossbench.catalog.locate import locate
from glossbench.errors import InputError, suggest_nearest
from glossbench.file_bytes import compute_file_digest, require_size
from glossbench.scene.formats.gltf import find_buffer_files, read_gltf
from glossbench.scene.formats.obj import read_obj
from glossbench.scene.formats.ply import read_ply
from glossbench.scene.formats.polygons import Surface
from glossbench.scene.formats.stl import read_stl
from glossbench.scene.mesh import Mesh, make_mesh
from glossbench.scene.shapes import SHAPES

READERS: dict[str, Callable[[Path], Surface]] = {
    ".obj": read_obj, ".ply": read_ply, ".glb": read_gltf, ".gltf": read_gltf, ".stl": read_stl,
}  # fmt: skip
MAX_BYTES = 1 << 30  # more than a mesh with the largest number of faces needs as text


def make_named_mesh(name: str) -> Mesh:
    """The mesh of a name or a path.

    Raises:
        InputError: the name or file does not exist, or the file does not hold a mesh that can be shaded.
    """
    if name in SHAPES:
        return _make_shape(name)
    path = _find_path(name)
    return _read_mesh(path, _compute_digest(path))


def identify_mesh(name: str) -> str:
    """Text that identifies the mesh of a name: the name of a shape, or the hash of a file's bytes."""
    return name if name in SHAPES else _compute_digest(_find_path(name))


def load_mesh(path: Path | str) -> Mesh:
    """The mesh of a Wavefront OBJ, PLY, glTF or STL file; all parts are joined, textures and colours are left out.

    Normals of the file are kept; if it has none they are computed, see `make_mesh`. Tangents are never read.

    Raises:
        InputError: the format is unknown, the file cannot be read, or the mesh cannot be repaired.
    """
    path = Path(path)
    if path.suffix.lower() not in READERS:
        raise InputError(f"{path}: a mesh must be one of {', '.join(READERS)}")
    try:
        require_size(path, "mesh", MAX_BYTES)
        surface = READERS[path.suffix.lower()](path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    return make_mesh(surface.vertices, surface.faces, surface.normals, name=str(path))


# Cached: every cell of a study asks for its mesh, and preparing a large one for rays takes a second.


@lru_cache(maxsize=4)
def _make_shape(name: str) -> Mesh:
    return SHAPES[name]()


@lru_cache(maxsize=4)
def _read_mesh(path: Path, digest: str) -> Mesh:
    mesh = load_mesh(path)
    if _compute_digest(path) != digest:
        raise InputError(f"{path}: was changed while it was read; run it again")
    return mesh


def _find_path(name: str) -> Path:
    known = {entry.name for entry in list_entries("mesh")}
    if name in known:
        return fetch(name)
    if not Path(name).suffix:
        raise InputError(f"unknown mesh {name!r}{suggest_nearest(name, [*SHAPES, *known])}")
    return locate(name, what="mesh file")


def _compute_digest(path: Path) -> str:
    """SHA-256 of a file, and of the buffers that a glTF file names."""
    own = compute_file_digest(path, "mesh", MAX_BYTES)
    if READERS.get(path.suffix.lower()) is not read_gltf:
        return own
    buffers = [file for file in _find_buffers(path, own) if file.is_file()]
    every = [own, *(compute_file_digest(file, "mesh", MAX_BYTES) for file in buffers)]
    return hashlib.sha256(" ".join(every).encode()).hexdigest()


@lru_cache(maxsize=4)
def _find_buffers(path: Path, digest: str) -> list[Path]:
    return find_buffer_files(path)
