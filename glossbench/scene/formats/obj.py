"""Wavefront OBJ: positions, normals and polygons, without textures, materials and names."""

import codecs
from pathlib import Path

import numpy as np

from glossbench.errors import InputError
from glossbench.scene.formats.polygons import Surface, triangulate


def read_obj(path: Path) -> Surface:
    """The polygons of an .obj file as triangles; all objects and groups are joined.

    v x y z, vn x y z, f c c c ..., a corner c is v, v/vt, v//vn or v/vt/vn. Vertices are numbered from 1; negative
    numbers count back from the last vertex so far. # begins a comment; a line that ends in \\ continues in the next. If
    every face states normals, they are read, and each pair of position and normal becomes a vertex.

    Raises:
        InputError: a line does not hold numbers (the error names the line), or a vertex or normal does not exist.

    Source: Wavefront, Advanced Visualizer manual, appendix B1.
    """
    v: list[tuple[float, ...]] = []
    vn: list[tuple[float, ...]] = []
    corners: list[int] = []
    normals: list[int] = []
    counts: list[int] = []
    for i, line in enumerate(_split_lines(path.read_bytes()), 1):
        words = line.split()
        kind = words[0] if words else ""
        try:
            if kind == "v" or kind == "vn":
                x, y, z = words[1:4]
                (v if kind == "v" else vn).append((float(x), float(y), float(z)))
            elif kind == "f" or kind == "fo":
                for word in words[1:]:
                    place, _, rest = word.partition("/")
                    corners.append(_resolve_number(int(place), len(v)))
                    normal = rest.partition("/")[2]
                    if normal:
                        normals.append(_resolve_number(int(normal), len(vn)))
                counts.append(len(words) - 1)
        except ValueError as error:
            what = "three numbers" if kind[0] == "v" else "vertices by number, from 1 or back from the last so far"
            text = " ".join(words[1:])[:60]
            raise InputError(f"{path}:{i}: {kind} needs {what}, got {text!r}") from error
    vertices, face_corners = np.array(v).reshape(-1, 3), np.array(corners, np.int64)
    triangles = triangulate(str(path), vertices, face_corners, np.array(counts, np.int64))
    if not corners or len(normals) < len(corners):
        return Surface(vertices, face_corners[triangles], None)
    if max(normals) >= len(vn):
        raise InputError(f"{path} has {len(vn)} normals, but a face has normal {max(normals)}, from 0")
    pairs, of_corner = np.unique(np.stack([face_corners, normals], 1), axis=0, return_inverse=True)
    faces = of_corner.reshape(-1)[triangles]
    return Surface(vertices[pairs[:, 0]], faces, np.array(vn)[pairs[:, 1]])


def _resolve_number(number: int, so_far: int) -> int:
    """A vertex number from 0, from a number that counts from 1 or back from the last vertex so far."""
    place = number - 1 if number > 0 else so_far + number
    if number == 0 or place < 0:
        raise ValueError(number)
    return place


def _split_lines(content: bytes) -> list[str]:
    """Lines of a text with the line ends of any system, without comments; an empty line follows a continued one."""
    encoding = "utf-16" if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8-sig"
    lines = content.decode(encoding, errors="replace").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if b"#" in content:
        lines = [line.partition("#")[0] for line in lines]
    if b"\\" in content:
        for i in reversed(range(len(lines) - 1)):
            if lines[i].rstrip().endswith("\\"):
                lines[i : i + 2] = [f"{lines[i].rstrip()[:-1]} {lines[i + 1]}", ""]
    return lines
