"""Portable float maps (.pfm): a text header of three words, then 32-bit floats, bottom row first."""

import re
from math import isfinite
from pathlib import Path

import numpy as np

from glossbench.envmap.formats.image_content import ImageContent
from glossbench.envmap.formats.refusals import check_fits, check_size, make_damage_error

KIND = "a portable float map"
# Exactly one white space after the scale ends the header: the next byte is a pixel, even if it looks like white space.
_HEADER = re.compile(rb"(PF|Pf)\s+([0-9]{1,9})\s+([0-9]{1,9})\s+([-+]?[0-9.eE+-]{1,30})(\r\n|\s)")
_REST_OF_LINE = re.compile(rb"[ \t]+\r?\n")


def read_pfm(path: Path) -> ImageContent:
    """Image (H, W, 3), float32, row 0 at the top; grey (Pf) is repeated three times.

    value = stored * |scale|: a negative scale means little-endian; its magnitude is the unit of the samples, usually 1.

    Raises:
        InputError: the header is not valid, the image is too large, or the file has fewer bytes than the header claims.

    Source: the manual of Netpbm, pfm(5). Files of Photoshop begin with the top row and need flip_vertical.
    """
    with path.open("rb") as file:
        head = file.read(128)
    match = _HEADER.match(head)
    if not match:
        raise make_damage_error(path, KIND, f"no header such as 'PF 1024 512 -1.0', got {head[:40]!r}")
    channels, width, height = (3 if match[1] == b"PF" else 1), int(match[2]), int(match[3])
    check_size(path, KIND, width, height)
    try:
        scale = float(match[4])
    except ValueError:
        scale = 0.0
    if scale == 0 or not isfinite(scale):
        raise make_damage_error(path, KIND, f"its scale must be a number other than 0, got {match[4].decode()}")
    wanted, n_bytes, start = height * width * channels * 4, path.stat().st_size, match.end()
    rest = _REST_OF_LINE.match(head, match.start(5))
    if rest and n_bytes - rest.end() == wanted:  # some programs write a space before the end of the line
        start = rest.end()
    there = n_bytes - start
    if there < wanted:
        raise make_damage_error(path, KIND, f"{there} of {wanted} bytes of pixels are there")
    check_fits(path, width, height)
    stored = np.fromfile(path, "<f4" if scale < 0 else ">f4", height * width * channels, offset=start)
    image = np.multiply(stored.reshape(height, width, channels)[::-1], abs(scale), dtype=np.float32)
    return ImageContent(image.repeat(3, axis=2) if channels == 1 else image)
