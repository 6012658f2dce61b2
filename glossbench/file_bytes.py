"""Files as bytes: small enough to be read, and known by their content."""

import hashlib
from functools import lru_cache
from pathlib import Path

from glossbench.errors import InputError


def require_size(path: Path, what: str, most: int) -> None:
    """InputError for a file of more bytes than any that holds such a thing: it is refused before it is read."""
    size = path.stat().st_size
    if size > most:
        raise InputError(f"{path}: {size} bytes, more than the {most} of any {what} that is read")


def digest(path: Path, what: str, most: int) -> str:
    """SHA-256 of a file's bytes, computed once for each size and time of change.

    Raises:
        InputError: see `require_size`, and for a file that cannot be read.
    """
    try:
        require_size(path, what, most)
        stat = path.stat()
        return _digest(path, stat.st_size, stat.st_mtime_ns)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None


@lru_cache(maxsize=64)
def _digest(path: Path, size: int, time: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
