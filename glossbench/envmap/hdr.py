"""Radiance pictures (.hdr): four bytes a pixel, mantissas of red, green, blue and a shared exponent."""

import re
from math import isfinite, prod
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from glossbench.envmap.decoded import Decoded
from glossbench.envmap.refusals import check_size, damaged, last_error
from glossbench.errors import InputError

KIND = "a Radiance HDR image"
_MAX_HEADER = 2**16
_RESOLUTION = re.compile(rb"([-+])([XY]) +([0-9]{1,9}) +([-+])([XY]) +([0-9]{1,9})\s*")


def read_hdr(path: Path) -> Decoded:
    """Radiance (H, W, 3), float32, row 0 at the top, of any of the eight scan orders.

    radiance = stored value / product of all EXPOSURE lines / product of all COLORCORR lines of the channel. Pixels
    may be flat or run-length coded, in the old way (a pixel 1, 1, 1, n repeats the one before) or the new (planes of
    a scanline).

    Raises:
        InputError: damaged or too large; CIE XYZ instead of RGB; a GAMMA other than 1, which is not linear.

    Source: Ward 1991, "Real Pixels"; the file formats of the Radiance manual ("divide by all the EXPOSURE settings").
    """
    data = path.read_bytes()
    lines, start = _header(path, data)
    match = _RESOLUTION.fullmatch(lines[-1])
    if not match or match[2] == match[5]:
        raise damaged(path, KIND, f"no line of its size such as '-Y 512 +X 1024', got {lines[-1][:40]!r}")
    n_lines, n_pixels = int(match[3]), int(match[6])
    by_rows = match[2] == b"Y"
    check_size(path, KIND, *((n_pixels, n_lines) if by_rows else (n_lines, n_pixels)))
    scale = _scale(path, [line.decode("ascii", "replace") for line in lines[1:-1]])
    if data[start : start + 2] == b"\2\2" and data[start + 2 : start + 3] < b"\x80" and 8 <= n_pixels < 2**15:
        # A run covers at most 127 bytes of a plane, so a small file cannot claim a large image.
        if len(data) - start < n_lines * (4 + 8 * -(-n_pixels // 127)):
            raise damaged(path, KIND, f"too few bytes for the {n_lines} x {n_pixels} pixels that its header claims")
        image = _planes(path, n_lines, n_pixels)
    else:
        image = _records(path, data, start, n_lines * n_pixels).reshape(n_lines, n_pixels, 3)
    # Downwards (-Y) and rightwards (+X) are as wanted.
    steps = (1 if sign + axis in (b"-Y", b"+X") else -1 for sign, axis in (match.group(1, 2), match.group(4, 5)))
    image = image[tuple(slice(None, None, step) for step in steps)]
    return Decoded(np.ascontiguousarray(image if by_rows else image.swapaxes(0, 1)) * scale)


def _header(path: Path, data: bytes) -> tuple[list[bytes], int]:
    """Lines of the header without the empty one, the size last, and where the pixels begin."""
    end = data.find(b"\n\n", 0, _MAX_HEADER)
    size = data.find(b"\n", end + 2, end + 2 + 80) if end >= 0 else -1
    if size < 0:
        raise damaged(path, KIND, "its header does not end")
    return [*data[:end].split(b"\n"), data[end + 2 : size]], size + 1


def _scale(path: Path, lines: list[str]) -> np.ndarray:
    """Factor of each channel, float32 (3,)."""
    pairs = [(name.strip(), value.strip()) for name, _, value in (line.partition("=") for line in lines)]

    def numbers(key: str, count: int) -> list[list[float]]:
        found = []
        for value in (value for name, value in pairs if name == key):
            try:
                found.append([float(word) for word in value.split()])
            except ValueError:
                found.append([])
            if len(found[-1]) != count or not all(isfinite(n) and n > 0 for n in found[-1]):
                raise damaged(
                    path, KIND, f"{key} must be {count} positive number{'s' * (count > 1)}, got {value[:40]!r}"
                )
        return found

    for name, value in pairs:
        if name == "FORMAT" and value != "32-bit_rle_rgbe":
            raise InputError(f"{path}: FORMAT must be 32-bit_rle_rgbe, is {value[:40]}; convert it to RGB first")
    if any(gamma != [1.0] for gamma in numbers("GAMMA", 1)):
        raise InputError(f"{path}: must be linear (GAMMA=1), is gamma-corrected; where the line is wrong, remove it")
    exposure = prod(e for (e,) in numbers("EXPOSURE", 1))
    correction = [prod(c[i] for c in numbers("COLORCORR", 3)) for i in range(3)]
    scale = 1 / (exposure * np.array(correction))
    if not (np.isfinite(scale).all() and (scale > 1e-30).all() and (scale < 1e30).all()):
        raise damaged(path, KIND, f"EXPOSURE and COLORCORR multiply to {exposure:g}")
    return scale.astype(np.float32)


def _planes(path: Path, height: int, width: int) -> np.ndarray:
    """Scanlines in the new run-length coding."""
    source = oiio.ImageInput.open(str(path))
    try:
        pixels = source.read_image(oiio.FLOAT) if source else None
        if pixels is None:
            raise damaged(path, KIND, last_error(source.geterror if source else oiio.geterror))
    finally:
        if source:
            source.close()
    if pixels.shape != (height, width, 3):
        raise damaged(
            path, KIND, f"its header claims {width}x{height} pixels, {pixels.shape[1]}x{pixels.shape[0]} came"
        )
    return pixels


def _records(path: Path, data: bytes, start: int, n_pixels: int) -> np.ndarray:
    """(N, 3) of pixels that are flat or in the old run-length coding.

    A record 1, 1, 1, n is no normalised pixel: it repeats the pixel before it n times, n 256^k times as the k-th
    such record in a row. A file with exactly a record a pixel has no runs.
    """
    n_records = min((len(data) - start) // 4, n_pixels)  # a run of none, 1, 1, 1, 0, does not come in a sound file
    records = np.frombuffer(data, np.uint8, n_records * 4, start).reshape(-1, 4)
    is_run = (records[:, :3] == 1).all(1) & (len(data) - start != 4 * n_pixels)
    if is_run[:1].any():
        raise damaged(path, KIND, "it begins with a repetition of nothing")
    index = np.arange(n_records)
    pixel = np.maximum.accumulate(np.where(is_run, 0, index))  # that the record is, or repeats
    # A run of 2^32 pixels is too long already: the bound keeps the shift within 64 bits.
    k = np.clip(index - pixel - 1, 0, 4)
    ends = np.cumsum(np.where(is_run, records[:, 3].astype(np.int64) << (8 * k), 1))
    n_used = int(np.searchsorted(ends, n_pixels)) + 1
    if n_used > n_records or ends[n_used - 1] != n_pixels:
        have = ends[-1] if n_records else 0
        raise damaged(path, KIND, f"its runs make {have} pixels, its header claims {n_pixels}")
    rgbe = records[np.repeat(pixel[:n_used], np.diff(ends[:n_used], prepend=0))]
    scale = np.ldexp(np.float32(1), rgbe[:, 3:].astype(np.int32) - 136)
    return np.where(rgbe[:, 3:] > 0, rgbe[:, :3] * scale, 0).astype(np.float32)
