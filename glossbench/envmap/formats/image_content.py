"""The result of reading an image file: its pixels, and what their user must know."""

from typing import NamedTuple

import numpy as np


class Covering(NamedTuple):
    """How an image covers the sphere, as stated in its own file.

    Attributes:
        projection, axes: names as in the modules conversion and axes.
        said_by: the part of the file that states it.
        note: a warning for users who do not expect it; "" if there is none.
    """

    projection: str
    axes: str
    said_by: str = ""
    note: str = ""


class ImageContent(NamedTuple):
    """The content of an image file.

    Attributes:
        image: (H, W, 3), float32, row 0 at the top; linear Rec. 709 unless a note says otherwise.
        notes: what was changed, left out or assumed, one sentence each, without the file's name.
        covers: how it covers the sphere, if the file states it.
    """

    image: np.ndarray
    notes: tuple[str, ...] = ()
    covers: Covering | None = None
