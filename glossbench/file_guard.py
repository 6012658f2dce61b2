"""Files that are read twice, for their contents and for their hash, and must not change in between."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from glossbench.errors import InputError


@contextmanager
def unchanged(path: Path) -> Iterator[None]:
    """Raise InputError if the file is replaced or written to during the block."""
    before = _read_identity(path)
    yield
    if _read_identity(path) != before:
        raise InputError(f"{path}: was changed while it was read; run it again")


def _read_identity(path: Path) -> tuple[int, ...]:
    try:
        stat = path.stat()
    except OSError:  # the function that reads the file reports this error
        return ()
    return stat.st_dev, stat.st_ino, stat.st_size, stat.st_mtime_ns
