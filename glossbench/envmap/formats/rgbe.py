"""Pixels of Radiance pictures: mantissas of red, green, blue and a shared exponent, flat or run-length coded."""

from pathlib import Path

import numpy as np

from glossbench.envmap.formats.refusals import check_fits, make_damage_error

_SCALE = np.ldexp(np.float32(1), np.arange(256) - 136)  # factor of a mantissa, by exponent
_SCALE[0] = 0
_AT_ONCE = 2**20  # pixels converted at a time, to bound the memory


def read_pixels(path: Path, kind: str, start: int, n_lines: int, n_pixels: int) -> np.ndarray:
    """Values (n_lines, n_pixels, 3), float32, of the scanlines that begin at byte `start` of a file.

    value = mantissa 2^(exponent - 136), 0 if the exponent is 0. The first bytes of each scanline state its coding: the
    new coding begins with 2, 2 and the length, 8 to 32767, and has four planes of runs. Otherwise the scanline holds
    pixels, and a record 1, 1, 1, n repeats the pixel before it (the old coding). If no scanline has the new coding, old
    runs may cross lines.

    Raises:
        InputError: there are fewer bytes than the size needs, runs do not add up, or a scanline has another length.
    """
    n_bytes = path.stat().st_size - start
    if n_bytes < 4 * n_lines:
        claimed = f"the {n_lines} x {n_pixels} pixels that its header claims"
        raise make_damage_error(path, kind, f"too few bytes for {claimed}: {max(n_bytes, 0)}")
    check_fits(path, n_pixels, n_lines)
    with path.open("rb") as file:
        file.seek(start)
        data = file.read(n_lines * (8 * n_pixels + 4))  # the size of the longest coding
    marker = bytes([2, 2, *divmod(n_pixels, 256)]) if 8 <= n_pixels < 2**15 else b""
    if marker and data[:2] == marker[:2] and data[2] < 128 and data[2:4] != marker[2:]:
        stated = 256 * data[2] + data[3]
        raise make_damage_error(path, kind, f"a scanline states {stated} pixels, its header {n_pixels}")
    if not marker or marker not in data:
        rgbe, _ = _decode_records(path, kind, data, 0, n_lines * n_pixels, n_bytes == 4 * n_lines * n_pixels)
    else:
        rgbe = _decode_scanlines(path, kind, data, n_lines, n_pixels, marker)
    image = np.empty((n_lines * n_pixels, 3), np.float32)
    for at in range(0, len(image), _AT_ONCE):
        some = rgbe[at : at + _AT_ONCE]
        np.multiply(some[:, :3], _SCALE[some[:, 3:]], out=image[at : at + _AT_ONCE])
    return image.reshape(n_lines, n_pixels, 3)


def _decode_scanlines(path: Path, kind: str, data: bytes, n_lines: int, n_pixels: int, marker: bytes) -> np.ndarray:
    """Pixels (N, 4) of scanlines, each of which may have the new or the old coding."""
    rgbe = np.empty((n_lines, n_pixels, 4), np.uint8)
    at = 0
    for line in range(n_lines):
        head = data[at : at + 4]
        if head[:2] != marker[:2] or head[2:3] >= b"\x80":
            rgbe[line], at = _decode_records(path, kind, data, at, n_pixels, False)
            continue
        if head != marker:
            raise make_damage_error(
                path, kind, f"scanline {line} does not state its {n_pixels} pixels, but {head[2:].hex(' ')}"
            )
        at += 4
        for channel in range(4):
            plane, at = _decode_plane(data, at, n_pixels)
            if len(plane) != n_pixels:
                raise make_damage_error(
                    path, kind, f"its runs make {len(plane)} of {n_pixels} pixels of scanline {line}"
                )
            rgbe[line, :, channel] = np.frombuffer(plane, np.uint8)
    return rgbe.reshape(-1, 4)


def _decode_plane(data: bytes, at: int, n_pixels: int) -> tuple[bytes, int]:
    """One channel of a scanline in the new coding, with the length of its runs, and the byte where it ends."""
    parts, n_done = [], 0
    while n_done < n_pixels and at + 1 < len(data):
        count = data[at]
        if count > 128:
            count -= 128
            parts.append(data[at + 1 : at + 2] * count)
            at += 2
        elif count:
            parts.append(data[at + 1 : at + 1 + count])
            at += 1 + count
        else:
            break
        n_done += count
    return b"".join(parts), at


def _decode_records(
    path: Path, kind: str, data: bytes, at: int, n_pixels: int, is_flat: bool
) -> tuple[np.ndarray, int]:
    """Pixels (N, 4) that are flat or in the old run-length coding, and the byte where they end.

    A record 1, 1, 1, n cannot be a normalised pixel: it repeats the pixel before it n times, or n 256^k times if k such
    records precede it directly. Pixels that are known to be flat have no runs.
    """
    n_records = min((len(data) - at) // 4, n_pixels)  # valid files have no empty run 1, 1, 1, 0
    records = np.frombuffer(data, np.uint8, n_records * 4, at).reshape(-1, 4)
    is_run = (records[:, :3] == 1).all(1) & (not is_flat)
    if is_run[:1].any():
        raise make_damage_error(path, kind, "it begins with a repetition, before any pixel")
    if n_records == n_pixels and not is_run.any():
        return records, at + 4 * n_pixels
    index = np.arange(n_records)
    pixel = np.maximum.accumulate(np.where(is_run, 0, index))  # the record's own pixel, or the one that it repeats
    # A run of 2^32 pixels is too long in any case: the bound keeps the shift within 64 bits.
    k = np.clip(index - pixel - 1, 0, 4)
    ends = np.cumsum(np.where(is_run, records[:, 3].astype(np.int64) << (8 * k), 1))
    n_used = int(np.searchsorted(ends, n_pixels)) + 1
    if n_used > n_records or ends[n_used - 1] != n_pixels:
        have = ends[-1] if n_records else 0
        raise make_damage_error(path, kind, f"its runs make {have} pixels, its header claims {n_pixels}")
    return records[np.repeat(pixel[:n_used], np.diff(ends[:n_used], prepend=0))], at + 4 * n_used
