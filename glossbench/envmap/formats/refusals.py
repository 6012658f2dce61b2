"""Checks common to all image formats, made before memory is allocated or the header is trusted."""

from collections.abc import Callable
from pathlib import Path

from glossbench.errors import InputError
from glossbench.memory import check_memory

MAX_PIXELS = 2**28  # 3 GB as float32 RGB: a header that claims more is taken as damaged
_BYTES_A_PIXEL = 100  # per pixel of a light: decoded 12 and 16, resampled 36, and 1.5 texels of its cube map


def make_damage_error(path: Path, kind: str, reason: str) -> InputError:
    """The error for a file whose bytes violate its format, in one line even if the library reports several."""
    # Libraries repeat the path, and may report one fault in several lines: the first line names the fault.
    first = next((line for line in reason.strip().splitlines() if line), "no reason given")
    return InputError(f"{path}: is truncated or damaged as {kind}: {first.replace(f'({path})', '').strip()}")


def check_size(path: Path, kind: str, width: int, height: int) -> None:
    """Raises InputError if a header claims no pixels, or more than 2^28."""
    if min(width, height) < 1:
        raise make_damage_error(path, kind, f"it must have at least 1x1 pixels, its header claims {width}x{height}")
    if width * height > MAX_PIXELS:
        raise InputError(f"{path}: must have at most {MAX_PIXELS} pixels, its header claims {width} x {height}")


def check_fits(path: Path, width: int, height: int) -> None:
    """Raises InputError if a valid image does not fit into memory as a light."""
    check_memory(f"{path}: an image of {width} x {height} pixels", _BYTES_A_PIXEL * width * height)


def take_last_error(report: Callable[[], str]) -> str:
    """The last error message of the library; reading it clears it."""
    try:
        return report()
    except UnicodeDecodeError:
        return "unreadable header"  # the message quotes the damaged bytes, which are not UTF-8
