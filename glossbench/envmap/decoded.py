"""What a reader makes of an image file: its pixels, and what whoever uses them must know."""

from typing import NamedTuple

import numpy as np


class Decoded(NamedTuple):
    """The content of an image file.

    Attributes:
        image: (H, W, 3), float32, row 0 at the top; linear Rec. 709 unless a note says otherwise.
        notes: what was changed, left out or assumed on the way, a sentence each, without the file's name.
    """

    image: np.ndarray
    notes: tuple[str, ...] = ()
