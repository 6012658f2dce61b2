"""Where the results of a run lie: files with names, in a folder or at any address that fsspec knows."""

from contextlib import AbstractContextManager
from pathlib import Path
from typing import Protocol


class Store(Protocol):
    """Files by name, such as cells/KEY.json. Each is put whole or not at all, and replaces an earlier one.

    A file that is missing raises FileNotFoundError, as in a folder. A store can be pickled.
    """

    @property
    def address(self) -> str:
        """What a user writes to name it."""

    def locate(self, name: str) -> Path | str:
        """The path or address of a file, which may not exist."""

    def create(self) -> None:
        """Make it ready for a run, and remove files that a killed run left half-written. InputError if that fails."""

    def check_writable(self, name: str) -> None:
        """WriteError if it is known that a file cannot be written."""

    def has(self, name: str) -> bool:
        """Whether there is a file of this name."""

    def get(self, name: str) -> bytes:
        """The content of a file."""

    def put(self, name: str, data: bytes, lasts: bool = True) -> None:
        """Write a file; WriteError if that fails, for example because the disk is full.

        Args:
            lasts: False for a file with a checksum that can be made again: the disk is not waited for.
        """

    def remove(self, name: str) -> None:
        """Remove a file, if it exists; WriteError if that fails."""

    def list(self, prefix: str) -> list[str]:
        """The names that begin with a sub-folder and, after it, these characters, sorted: "images/KEY_"."""

    def prune(self, folder: str) -> None:
        """Remove a sub-folder if it is empty."""

    def file(self, name: str) -> AbstractContextManager[Path]:
        """Within the block, a local file with the content of this one, if it exists, for libraries that read files."""


def open_store(where: "Path | str | Store") -> Store:
    """The store at a path, or at an address with ://; one of files of this machine is a folder."""
    from glossbench.run.folder import Folder
    from glossbench.run.remote import RemoteStore

    if not isinstance(where, Path | str):
        return where
    if isinstance(where, Path) or "://" not in where:
        return Folder(Path(where))
    protocol, _, path = where.partition("://")
    return Folder(Path(path)) if protocol in ("file", "local") else RemoteStore(where.rstrip("/"))
