"""Radiance pictures (.hdr): a header of text, then four bytes per pixel."""

import re
from math import isfinite, prod
from pathlib import Path

import numpy as np

from glossbench.envmap.formats.chromaticities import REC_709, convert_to_rec709
from glossbench.envmap.formats.image_content import ImageContent
from glossbench.envmap.formats.refusals import check_size, make_damage_error
from glossbench.envmap.formats.rgbe import read_pixels
from glossbench.errors import InputError

KIND = "a Radiance HDR image"
_MAX_HEADER = 2**16
_RESOLUTION = re.compile(rb"\s*([-+])([XY])\s+([0-9]{1,9})\s+([-+])([XY])\s+([0-9]{1,9})\s*")
_XYZ = ((1.0, 0.0), (0.0, 1.0), (0.0, 0.0), (1 / 3, 1 / 3))
# Primaries that Radiance writes into its own pictures; all programs read these pixels as Rec. 709.
_RADIANCE = ((0.64, 0.33), (0.29, 0.60), (0.15, 0.06), (1 / 3, 1 / 3))


def read_hdr(path: Path) -> ImageContent:
    """Radiance (H, W, 3), float32, row 0 at the top, from any of the eight scan orders.

    radiance = stored value / product of all EXPOSURE lines / product of all COLORCORR lines of the channel. It is
    converted from CIE XYZ (FORMAT=32-bit_rle_xyze) or other PRIMARIES to linear Rec. 709. An EXPOSURE, COLORCORR or
    GAMMA of 0 has no meaning, and counts as 1. The reader accepts spaces and tabs around names and numbers, line ends
    of all systems, and headers that lack FORMAT or have empty lines.

    Raises:
        InputError: the file is damaged or too large, or GAMMA is not 1: its values are not linear.

    Source: Ward 1991, "Real Pixels"; the file formats of the Radiance manual ("divide by all the EXPOSURE settings").
    """
    lines, match, start = _read_header(path)
    n_lines, n_pixels = int(match[3]), int(match[6])
    by_rows = match[2] == b"Y"
    check_size(path, KIND, *((n_pixels, n_lines) if by_rows else (n_lines, n_pixels)))
    pairs = [(name.strip().upper(), value.strip()) for name, _, value in (line.partition("=") for line in lines)]
    scale, notes = _scale(path, pairs)
    primaries = _read_primaries(path, pairs)
    image = read_pixels(path, KIND, start, n_lines, n_pixels)
    if not (scale == 1).all():
        image *= scale
    # Downwards (-Y) and rightwards (+X) is the wanted order.
    steps = (1 if sign + axis in (b"-Y", b"+X") else -1 for sign, axis in (match.group(1, 2), match.group(4, 5)))
    image = image[tuple(slice(None, None, step) for step in steps)]
    image = np.ascontiguousarray(image if by_rows else image.swapaxes(0, 1))
    if primaries not in (REC_709, _RADIANCE):
        given = (
            "CIE XYZ" if primaries == _XYZ else f"its PRIMARIES {' '.join(f'{n:g}' for xy in primaries for n in xy)}"
        )
        image, more = convert_to_rec709(image, primaries, given)
        notes += more
    return ImageContent(image, tuple(notes))


def _read_header(path: Path) -> tuple[list[str], re.Match[bytes], int]:
    """The lines of the header, the line of the size that ends it, and the byte where the pixels begin.

    The size follows an empty line; but some programs write several empty lines, or none.
    """
    with path.open("rb") as file:
        head = file.read(_MAX_HEADER)
    first = re.search(rb"\r\n|\n|\r", head)
    end_of_line = b"\r" if first and first[0] == b"\r" else b"\n"
    lines: list[bytes] = []
    at = 0
    while (end := head.find(end_of_line, at)) >= 0:
        line = head[at:end]
        at = end + 1
        if match := _RESOLUTION.fullmatch(line):
            if match[2] == match[5]:
                raise _make_size_error(path, line)
            return [each.decode("ascii", "replace") for each in lines if not each.startswith(b"#")], match, at
        if lines and not lines[-1].strip() and line.strip() and not re.match(rb"#|\s*[A-Za-z_]+\s*=", line):
            raise _make_size_error(path, line)
        lines.append(line)
    raise make_damage_error(path, KIND, "its header does not end")


def _make_size_error(path: Path, line: bytes) -> InputError:
    return make_damage_error(path, KIND, f"its size must be a line such as '-Y 512 +X 1024', got {line[:40]!r}")


def _parse_numbers(path: Path, pairs: list[tuple[str, str]], key: str, count: int) -> list[list[float]]:
    """The numbers in each line that begins with a key."""
    found = []
    for value in (value for name, value in pairs if name == key):
        try:
            found.append([float(word) for word in value.split()])
        except ValueError:
            found.append([])
        if value and not (len(found[-1]) == count and all(isfinite(n) for n in found[-1])):
            raise _make_numbers_error(path, key, count, value)
    return found


def _make_numbers_error(path: Path, key: str, count: int, value: str) -> InputError:
    rule, many = "" if key == "PRIMARIES" else "positive ", "s" * (count > 1)
    return make_damage_error(
        path, KIND, f"{key} must be {count} {rule}number{many}, got {value[:40]!r}; correct or remove it"
    )


def _scale(path: Path, pairs: list[tuple[str, str]]) -> tuple[np.ndarray, list[str]]:
    """Factor of each channel, float32 (3,), and notes."""
    stated, notes = {}, []
    for key, count in (("EXPOSURE", 1), ("COLORCORR", 3), ("GAMMA", 1)):
        stated[key] = [[1.0] * count]
        for numbers in _parse_numbers(path, pairs, key, count):
            if not any(numbers):
                notes.append(f"{key}={' '.join(f'{n:g}' for n in numbers)} is not a factor and counts as 1")
            elif min(numbers) <= 0:
                raise _make_numbers_error(path, key, count, " ".join(f"{n:g}" for n in numbers))
            else:
                stated[key].append(numbers)
    if any(gamma != [1.0] for gamma in stated["GAMMA"]):
        raise InputError(f"{path}: must be linear (GAMMA=1), but is gamma-corrected; if that line is wrong, remove it")
    if any(name == "PIXASPECT" and value not in ("1", "1.0", "1.000000") for name, value in pairs):
        notes.append("PIXASPECT is ignored: a projection knows the shape of its pixels")
    exposure = prod(e for (e,) in stated["EXPOSURE"])
    scale = 1 / (exposure * np.array([prod(c[i] for c in stated["COLORCORR"]) for i in range(3)]))
    if not (np.isfinite(scale).all() and (scale > 1e-30).all() and (scale < 1e30).all()):
        raise make_damage_error(path, KIND, f"EXPOSURE and COLORCORR multiply to {exposure:g}")
    return scale.astype(np.float32), list(dict.fromkeys(notes))


def _read_primaries(path: Path, pairs: list[tuple[str, str]]) -> tuple[tuple[float, float], ...]:
    """CIE xy of red, green, blue and white of the stored values."""
    for name, value in pairs:
        if name == "FORMAT" and value == "32-bit_rle_xyze":
            return _XYZ
        if name == "FORMAT" and value != "32-bit_rle_rgbe":
            raise InputError(f"{path}: FORMAT must be 32-bit_rle_rgbe or 32-bit_rle_xyze, is {value[:40]}")
    stated = [numbers for numbers in _parse_numbers(path, pairs, "PRIMARIES", 8) if any(numbers)]
    if not stated:
        return REC_709
    rounded = [round(n, 4) for n in stated[-1]]
    for known in (REC_709, _RADIANCE):
        if np.allclose(stated[-1], np.ravel(known), rtol=0, atol=5e-4):
            return known
    return tuple(zip(rounded[::2], rounded[1::2], strict=True))
