"""glTF 2.0: positions, normals and triangles of all nodes of a scene, in world coordinates, without materials."""

import base64
import binascii
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

from glossbench.errors import InputError
from glossbench.scene.formats.polygons import Floats, Ints, Surface
from glossbench.scene.formats.strips import split_fan, split_strip

TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
TRIANGLES, STRIP, FAN = 4, 5, 6
COMPRESSED = {
    "KHR_draco_mesh_compression": "Draco",
    "EXT_meshopt_compression": "meshopt",
    "KHR_meshopt_compression": "meshopt",
}
# Prefixes of the names of extensions that are supported, or that change only the look of a surface.
HARMLESS = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_", "KHR_mesh_quantization", "KHR_xmp")
MAX_ITEMS = 1 << 27  # for an accessor without bytes in the file: 1.5 GB of positions
MAX_NODES = 1 << 20


def read_gltf(path: Path) -> Surface:
    """The triangles, strips and fans of the scene in a .gltf or .glb file, without points and lines.

    Normals are read if all parts have them. If a node mirrors its content, the winding is reversed. Skins and morph
    targets are in their rest position.

    Raises:
        InputError: the file is not glTF 2.0, a buffer does not exist or is too short, a required extension is not
            supported, such as a compression, or there are no triangles.

    Source: the Khronos specification, version 2.0.1.
    """
    tree, binary = _read_contents(path)
    try:
        parts = list(_Reader(path, tree, binary).read_parts())
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as error:
        if isinstance(error, InputError):
            raise
        what = f"has no {error}" if isinstance(error, KeyError) else " ".join(str(error).split())
        raise InputError(f"{path}: glTF file that cannot be read: {what}") from error
    if not parts:
        raise InputError(f"{path} has no triangles")
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)])
    normals = [part.normals for part in parts if part.normals is not None]
    stated = np.concatenate(normals) if len(normals) == len(parts) else None
    return Surface(np.concatenate([part.vertices for part in parts]), faces, stated)


def find_buffer_files(path: Path) -> list[Path]:
    """Paths of the files that hold the buffers of a .gltf file, whether they exist or not."""
    tree, _ = _read_contents(path)
    uris = [each.get("uri") for each in _read_list(tree, "buffers")]
    return [path.parent / unquote(uri) for uri in uris if isinstance(uri, str) and ":" not in uri.partition("/")[0]]


def _read_list(tree: dict[str, Any], key: str) -> list[dict[str, Any]]:
    found = tree.get(key, [])
    return [each for each in found if isinstance(each, dict)] if isinstance(found, list) else []


def _read_contents(path: Path) -> tuple[dict[str, Any], bytes | None]:
    """The JSON tree of a file, and the binary chunk of a .glb file."""
    data = path.read_bytes()
    binary = None
    if data[:4] == b"glTF":
        data, binary = _split_chunks(path, data)
    elif path.suffix.lower() == ".glb":
        raise InputError(f"{path}: not a mesh that can be read: it begins with {data[:4]!r}, a GLB file with b'glTF'")
    try:
        tree = json.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not a glTF file: its JSON cannot be read: {error}") from None
    if not isinstance(tree, dict):
        raise InputError(f"{path}: not a glTF file: its JSON is not a mapping")
    asset = tree.get("asset")
    version = str(asset.get("version", "")) if isinstance(asset, dict) else ""
    if version.split(".")[0] != "2":
        raise InputError(f"{path}: glTF file of version {version or 'unknown'}, must be 2.0; export it again")
    return tree, binary


def _split_chunks(path: Path, data: bytes) -> tuple[bytes, bytes | None]:
    """The JSON and the binary chunk of a .glb file."""
    if len(data) < 20:
        raise InputError(f"{path}: GLB file truncated: {len(data)} bytes")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise InputError(f"{path}: glTF file of version {version}.0, must be 2.0; export it again")
    if length > len(data):
        raise InputError(f"{path}: GLB file truncated: {len(data)} bytes, its header says {length}")
    at, found = 12, dict[bytes, bytes]()
    while at + 8 <= length:
        size, kind = struct.unpack_from("<I4s", data, at)
        if at + 8 + size > len(data):
            raise InputError(f"{path}: GLB file truncated: a chunk ends at {at + 8 + size} of {len(data)} bytes")
        found.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    if b"JSON" not in found:
        raise InputError(f"{path}: GLB file without JSON")
    return found[b"JSON"], found.get(b"BIN\0")


class _Reader:
    """One file: its JSON tree, and its buffers, which are read at first use."""

    def __init__(self, path: Path, tree: dict[str, Any], binary: bytes | None) -> None:
        self._path, self._tree, self._binary = path, tree, binary
        self._buffers: dict[int, bytes] = {}
        for name in tree.get("extensionsRequired", []):
            if not str(name).startswith(HARMLESS):
                raise self._make_extension_error(str(name))

    def read_parts(self) -> Iterator[Surface]:
        """Each primitive of triangles, in world coordinates."""
        for mesh, matrix in self._place_meshes():
            for primitive in mesh["primitives"]:
                if primitive.get("mode", TRIANGLES) in (TRIANGLES, STRIP, FAN):
                    yield self._read_part(primitive, matrix)

    def _place_meshes(self) -> Iterator[tuple[dict[str, Any], Floats]]:
        """The meshes of the scene with their matrices; in a file without nodes all meshes, with the identity."""
        nodes = self._tree.get("nodes", [])
        if not nodes:
            for mesh in self._tree.get("meshes", []):
                yield mesh, np.eye(4)
            return
        scenes = self._tree.get("scenes", [])
        children = {child for node in nodes for child in node.get("children", [])}
        roots = [i for i in range(len(nodes)) if i not in children]
        if scenes:
            roots = scenes[self._tree.get("scene", 0)].get("nodes", [])
        waiting, n_seen = [(root, np.eye(4)) for root in reversed(roots)], 0
        while waiting:
            i, above = waiting.pop()
            n_seen += 1
            if n_seen > max(len(nodes), 1) or n_seen > MAX_NODES:
                raise InputError(f"{self._path}: glTF file whose nodes are children of each other")
            node = nodes[i]
            matrix = above @ _compute_matrix(node)
            if "mesh" in node:
                yield self._tree["meshes"][node["mesh"]], matrix
            waiting += [(child, matrix) for child in reversed(node.get("children", []))]

    def _read_part(self, primitive: dict[str, Any], matrix: Floats) -> Surface:
        for name in primitive.get("extensions", {}):
            bare = [i for i in primitive["attributes"].values() if "bufferView" not in self._tree["accessors"][i]]
            if name in COMPRESSED and bare:
                raise self._make_extension_error(name)
        attributes = primitive["attributes"]
        vertices = self._read_numbers(attributes["POSITION"]).astype(np.float64)
        used: Ints = np.arange(len(vertices))
        if "indices" in primitive:
            used = self._read_numbers(primitive["indices"]).reshape(-1).astype(np.int64)
        mode = primitive.get("mode", TRIANGLES)
        if mode == TRIANGLES:
            faces = used[: len(used) // 3 * 3].reshape(-1, 3)
        elif mode == STRIP:
            faces = split_strip(used, np.array([len(used)]))
        else:
            faces = split_fan(used)
        turned = matrix[:3, :3]
        mirrored = np.linalg.det(turned) < 0
        normals = None
        if "NORMAL" in attributes:
            # Cofactors are the inverse transpose times the determinant; they exist even if the inverse does not.
            a, b, c = turned
            cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)]) * (-1 if mirrored else 1)
            normals = self._read_numbers(attributes["NORMAL"]).astype(np.float64) @ cofactors.T
        return Surface(vertices @ turned.T + matrix[:3, 3], faces[:, ::-1] if mirrored else faces, normals)

    def _read_numbers(self, index: int) -> NDArray[Any]:
        """The numbers of an accessor, (count, width)."""
        accessor = self._tree["accessors"][index]
        kind, width, count = np.dtype(TYPES[accessor["componentType"]]), WIDTHS[accessor["type"]], accessor["count"]
        if "bufferView" in accessor:
            found = self._read_rows(accessor["bufferView"], accessor.get("byteOffset", 0), kind, width, count)
        elif count > MAX_ITEMS:
            raise InputError(f"{self._path}: glTF file with {count} items without data, more than {MAX_ITEMS}")
        else:
            found = np.zeros((count, width), kind)
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            n, at, values = sparse["count"], sparse["indices"], sparse["values"]
            places = self._read_rows(
                at["bufferView"], at.get("byteOffset", 0), np.dtype(TYPES[at["componentType"]]), 1, n
            )
            found = found.copy()
            found[places[:, 0]] = self._read_rows(values["bufferView"], values.get("byteOffset", 0), kind, width, n)
        if accessor.get("normalized") and kind.kind != "f":
            return np.asarray(np.maximum(found / np.iinfo(kind).max, -1.0))
        return found

    def _read_rows(self, index: int, offset: int, kind: np.dtype[Any], width: int, count: int) -> NDArray[Any]:
        view = self._tree["bufferViews"][index]
        for name in view.get("extensions", {}):
            if name in COMPRESSED and self._is_fallback(view["buffer"]):
                raise self._make_extension_error(name)
        data = self._read_buffer(view["buffer"])
        start = view.get("byteOffset", 0) + offset
        stride = view.get("byteStride") or kind.itemsize * width
        last = start + stride * (count - 1) + kind.itemsize * width
        if stride < kind.itemsize * width:
            raise InputError(
                f"{self._path}: glTF file whose items of {kind.itemsize * width} bytes are {stride} bytes apart"
            )
        if min(start, offset, count) < 0 or last > len(data) or last > start - offset + view["byteLength"]:
            raise InputError(
                f"{self._path}: glTF file truncated or damaged: numbers up to byte {last} of a buffer of {len(data)}"
            )
        strides = (stride, kind.itemsize)
        return np.ndarray((count, width), kind, data, start, strides)

    def _is_fallback(self, index: int) -> bool:
        buffer = self._tree["buffers"][index]
        return "uri" not in buffer and not (index == 0 and self._binary is not None)

    def _read_buffer(self, index: int) -> bytes:
        if index not in self._buffers:
            self._buffers[index] = self._read(index)
        return self._buffers[index]

    def _read(self, index: int) -> bytes:
        stated = self._tree["buffers"][index]
        uri = stated.get("uri")
        if uri is None:
            if index or self._binary is None:
                raise InputError(f"{self._path}: glTF file whose buffer {index} has no data")
            data, what = self._binary, "its binary chunk"
        elif uri.startswith("data:"):
            data, what = self._decode_inline(uri), "a buffer in the file itself"
        elif ":" in uri.partition("/")[0]:
            raise InputError(f"{self._path}: glTF file whose buffer is at {uri[:60]!r}: fetch it, and name the file")
        else:
            file = self._path.parent / unquote(uri)
            try:
                data, what = file.read_bytes(), f"its buffer {uri!r}"
            except OSError as error:
                raise InputError(f"{self._path}: its buffer {str(file)!r} cannot be read: {error.strerror}") from None
        if len(data) < stated["byteLength"]:
            raise InputError(f"{self._path}: {what} has {len(data)} bytes, must have {stated['byteLength']}")
        return data

    def _decode_inline(self, uri: str) -> bytes:
        kind, _, content = uri.partition(",")
        try:
            return base64.b64decode(content, validate=True) if kind.endswith(";base64") else unquote_to_bytes(content)
        except binascii.Error as error:
            raise InputError(f"{self._path}: glTF file whose buffer is not base64: {error}") from None

    def _make_extension_error(self, extension: str) -> InputError:
        what = f" (compressed by {COMPRESSED[extension]})" if extension in COMPRESSED else ""
        return InputError(
            f"{self._path}: glTF file with {extension}{what}, which is not read; export it without this extension"
        )


def _compute_matrix(node: dict[str, Any]) -> Floats:
    """The matrix that a node applies to its content: its own, or translation x rotation x scale."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0, 0, 0, 1))
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.array(node.get("scale", (1, 1, 1)), np.float64)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix
