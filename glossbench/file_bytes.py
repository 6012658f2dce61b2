"""Files as bytes: the check of their size before they are read, and the hash of their content."""

import hashlib
from functools import lru_cache
from pathlib import Path

from glossbench.errors import InputError


def require_size(path: Path, what: str, most: int) -> None:
    """Raise InputError before a file is read if it has more bytes than any file of its kind may have."""
    size = path.stat().st_size
    if size > most:
        raise InputError(f"{path}: a {what} must have at most {most} bytes, got {size}")


def compute_file_digest(path: Path, what: str, most: int) -> str:
    """SHA-256 of a file's bytes, computed again only if the size or the time of change differs.

    Raises:
        InputError: the file cannot be read, or is too large (see `require_size`).
    """
    try:
        require_size(path, what, most)
        stat = path.stat()
        return _compute_file_digest(path, stat.st_size, stat.st_mtime_ns)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None


@lru_cache(maxsize=64)
def _compute_file_digest(path: Path, size: int, time: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
