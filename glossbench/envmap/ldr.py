"""Images of 8 bits a channel (.png, .jpg, .tif) as linear radiance: no high dynamic range, so only when asked for."""

import logging
import struct
import warnings
from pathlib import Path

import numpy as np
from PIL import Image

from glossbench.envmap.decoded import Decoded
from glossbench.envmap.refusals import check_size, damaged
from glossbench.errors import InputError
from glossbench.srgb import decoded

KIND = "an 8-bit image"
_8_BIT = ("1", "L", "LA", "P", "PA", "RGB", "RGBA", "RGBX", "CMYK", "YCbCr")
# What the library raises of damaged bytes.
_OF_DAMAGE = (OSError, SyntaxError, ValueError, EOFError, TypeError, LookupError, ArithmeticError, struct.error)
# The library takes an image whose pixels are whole though its end is missing.
_END = {b"\x89PNG": b"IEND\xaeB`\x82", b"\xff\xd8\xff": b"\xff\xd9"}
_PIXELS_A_BYTE = 2000  # of a file: no coding of colour packs more, deflate about 350
_LINEAR = decoded(np.arange(256) / 255).astype(np.float32)

# What the library logs of a damaged file goes to the screen where nobody listens.
logging.getLogger("PIL").addHandler(logging.NullHandler())


def read_ldr(path: Path) -> Decoded:
    """Colour (H, W, 3), float32, in [0, 1], decoded from sRGB; alpha is dropped.

    Raises:
        InputError: damaged, too large, or more than 8 bits a channel.
    """
    data = path.read_bytes()
    for magic, end in _END.items():
        if data.startswith(magic) and end not in data[-1024:]:
            raise damaged(path, KIND, "its end is missing")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that an image is large, or its metadata odd
            with Image.open(path) as image:
                check_size(path, KIND, *image.size)
                if image.width * image.height > _PIXELS_A_BYTE * len(data):
                    raise damaged(path, KIND, f"{len(data)} bytes cannot hold {image.width} x {image.height} pixels")
                if image.mode not in _8_BIT:
                    raise InputError(f"{path}: must have 8 bits a channel, is {image.mode}; convert it to .exr")
                return Decoded(_LINEAR[np.asarray(image.convert("RGB"))])
    except InputError:
        raise
    except (*_OF_DAMAGE, Image.DecompressionBombError) as error:
        raise damaged(path, KIND, str(error)) from None
