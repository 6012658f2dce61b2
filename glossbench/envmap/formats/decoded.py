"""What a reader makes of an image file: its pixels, and what whoever uses them must know."""

from typing import NamedTuple

import numpy as np


class Covering(NamedTuple):
    """How an image covers the sphere, as its own file says.

    Attributes:
        projection, axes: as in the modules of these names.
        said_by: what in the file says so.
        note: what whoever does not expect it must know; "" where nothing.
    """

    projection: str
    axes: str
    said_by: str = ""
    note: str = ""


class Decoded(NamedTuple):
    """The content of an image file.

    Attributes:
        image: (H, W, 3), float32, row 0 at the top; linear Rec. 709 unless a note says otherwise.
        notes: what was changed, left out or assumed on the way, a sentence each, without the file's name.
        covers: how it covers the sphere, where the file says that.
    """

    image: np.ndarray
    notes: tuple[str, ...] = ()
    covers: Covering | None = None
