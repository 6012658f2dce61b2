"""STL: triangles, as text or binary; each of their corners is a vertex."""

from pathlib import Path
from typing import Any

import numpy as np

from glossbench.errors import InputError
from glossbench.scene.formats.polygons import Surface


def read_stl(path: Path) -> Surface:
    """The triangles of all solids of an .stl file; normals follow from the corners.

    Raises:
        InputError: the file is not text from `solid` to `endsolid`, and its length does not fit its number of
            triangles.
    """
    import trimesh  # imported here: it takes a third of a second, and other formats do not need it

    data = path.read_bytes()
    n_triangles = int.from_bytes(data[80:84], "little")
    if len(data) < 84 or len(data) != 84 + 50 * n_triangles:
        if not data.lstrip(b"\xef\xbb\xbf \t\r\n")[:5].lower() == b"solid":
            raise InputError(
                f"{path}: STL file truncated or damaged: {len(data)} bytes, but {n_triangles} triangles need "
                f"{84 + 50 * n_triangles}"
            )
        if b"endsolid" not in data[-1000:].lower():
            raise InputError(f"{path}: STL file truncated: it ends without 'endsolid'")
    try:
        loaded: Any = trimesh.load_scene(path, process=False)
    except Exception as error:  # a damaged file can raise many kinds of errors in the library
        first = (str(error).splitlines() or [""])[0]
        raise InputError(f"{path}: STL file that cannot be read: {first}") from error
    solids = [solid for solid in loaded.geometry.values() if len(getattr(solid, "faces", ()))]
    if not solids:
        raise InputError(f"{path} has no faces")
    corners = np.concatenate([solid.triangles for solid in solids]).reshape(-1, 3)
    return Surface(np.asarray(corners, np.float64), np.arange(len(corners)).reshape(-1, 3), None)
