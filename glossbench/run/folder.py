"""A folder as a store. Its files may be damaged, or written by another program."""

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from glob import escape
from pathlib import Path

from glossbench.atomic import remove_abandoned, replacing
from glossbench.errors import InputError, WriteError


@dataclass(frozen=True)
class Folder:
    """A folder as a store (`Store`). Links out of it are not followed.

    Attributes:
        root: its path, which may itself be a link.
    """

    root: Path

    @property
    def address(self) -> str:
        return str(self.root)

    def path(self, name: str) -> Path:
        """The path of a file or folder in it; InputError for a link that leads out of it, a device or a pipe."""
        path = self.root / name
        real, root = os.path.realpath(path), os.path.realpath(self.root)
        if real != root and not real.startswith(os.path.join(root, "")):
            raise InputError(f"{path} leads out of the folder of results, to {real}; glossbench does not follow it")
        if os.path.lexists(real) and stat.S_IFMT(os.lstat(real).st_mode) not in (stat.S_IFREG, stat.S_IFDIR):
            raise InputError(f"{path} is a device or a pipe; a folder of results holds files")
        return path

    def locate(self, name: str) -> Path:
        return self.root / name

    def create(self) -> None:
        try:
            os.fspath(self.root).encode()
            for name in ("", "cells", "images", "references"):
                folder = self.path(name)
                if folder.exists() and not folder.is_dir():
                    raise NotADirectoryError(0, os.strerror(errno.ENOTDIR))
                folder.mkdir(parents=True, exist_ok=True)
                if not os.access(folder, os.W_OK | os.X_OK):
                    raise PermissionError(0, "it is read-only; choose another folder with -o")
                remove_abandoned(folder)
            if self.path("begun").is_dir():
                remove_abandoned(self.path("begun"))
        except UnicodeEncodeError:
            raise InputError(f"cannot write results to {str(self.root)!a}: the name is not UTF-8") from None
        except OSError as error:
            raise InputError(f"cannot write results to {self.root}: {error.strerror}") from None

    def check_writable(self, name: str) -> None:
        if not os.access(self.root, os.W_OK | os.X_OK):
            raise WriteError(self.root / name, "the folder is read-only")

    def has(self, name: str) -> bool:
        return os.path.lexists(self.root / name)

    def get(self, name: str) -> bytes:
        return self.path(name).read_bytes()

    def put(self, name: str, data: bytes, lasts: bool = True) -> None:
        path = self.path(name)
        if not path.parent.is_dir():
            with suppress(OSError):  # the write itself fails then
                path.parent.mkdir()
        with replacing(path, lasts) as part:
            part.write_bytes(data)

    def remove(self, name: str) -> None:
        path = self.path(name)
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise WriteError(path, error.strerror or str(error)) from error

    def list(self, prefix: str) -> list[str]:
        folder, _, start = prefix.rpartition("/")
        return sorted(f"{folder}/{path.name}" for path in self.path(folder).glob(f"{escape(start)}*"))

    def prune(self, folder: str) -> None:
        with suppress(OSError):  # it is missing, or holds files
            self.path(folder).rmdir()

    @contextmanager
    def file(self, name: str) -> Iterator[Path]:
        yield self.path(name)
