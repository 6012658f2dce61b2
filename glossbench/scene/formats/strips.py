"""Strips and fans: triangles that share edges, as in mesh files and graphics libraries."""

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]


def split_strip(values: Ints, counts: Ints) -> Ints:
    """Triangles (T, 3) of strips with lengths `counts`; -1 also ends a strip. Winding is that of a strip's first one.

    Triangle i is i, i + 1, i + 2; every second one is reversed. A triangle that has a vertex twice is a seam between
    strips and is left out.
    """
    ends = np.cumsum(counts)
    strip = np.searchsorted(ends, np.arange(len(values)), side="right")  # the number of each value's strip
    breaks = np.cumsum(values < 0)
    strip = strip + breaks
    first = np.maximum.accumulate(np.where(np.diff(strip, prepend=-1) != 0, np.arange(len(values)), 0))
    first = first + (values[first] < 0)
    i = np.arange(max(len(values) - 2, 0))
    i = i[(strip[i] == strip[i + 2]) & (values[i] >= 0)]
    faces = np.stack([values[i], values[i + 1], values[i + 2]], axis=1)
    turned = (i - first[i]) % 2 == 1
    faces[turned] = faces[turned][:, [1, 0, 2]]
    return _without_seams(faces)


def split_fan(values: Ints) -> Ints:
    """Triangles (T, 3) of one fan: its first vertex with each edge between the others."""
    faces = np.stack([np.full(max(len(values) - 2, 0), values[0]), values[1:-1], values[2:]], axis=1)
    return _without_seams(faces)


def _without_seams(faces: Ints) -> Ints:
    return faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
