"""Files that are read twice, for what they hold and for their hash, and must be the same both times."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from glossbench.errors import InputError


@contextmanager
def unchanged(path: Path) -> Iterator[None]:
    """InputError if the file is replaced or written to meanwhile."""
    before = _identity(path)
    yield
    if _identity(path) != before:
        raise InputError(f"{path}: was changed while it was read; run it again")


def _identity(path: Path) -> tuple[int, ...]:
    try:
        stat = path.stat()
    except OSError:  # whoever reads it says so
        return ()
    return stat.st_dev, stat.st_ino, stat.st_size, stat.st_mtime_ns
