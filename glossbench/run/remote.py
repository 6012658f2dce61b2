"""Any address that fsspec knows as a store: an object store such as S3, a web folder, another machine, memory."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

from glossbench.errors import InputError, WriteError


@dataclass(frozen=True)
class RemoteStore:
    """The files below an address as a store (`Store`).

    An object store shows a new file only when it is complete. Elsewhere the checksum tells a half-written file.

    Attributes:
        address: protocol://place, as fsspec writes it, such as s3://bucket/results.
    """

    address: str

    @cached_property
    def _root(self) -> tuple[Any, str]:
        """The file system of fsspec, and the path of this store in it."""
        protocol = self.address.partition("://")[0]
        try:
            import fsspec

            # Other processes write, too: what is there is asked each time.
            return fsspec.core.url_to_fs(self.address, use_listings_cache=False)
        except ImportError as error:
            raise InputError(
                f"{self.address}: {protocol}:// needs a package that is not installed: {error}; "
                "pip install 'glossbench[distributed]' has fsspec itself"
            ) from None
        except (ValueError, OSError) as error:
            raise InputError(f"{self.address}: {_one_line(error)}") from None

    def __getstate__(self) -> dict[str, Any]:
        return {"address": self.address}

    def locate(self, name: str) -> str:
        return f"{self.address}/{name}"

    def create(self) -> None:
        system, root = self._root
        try:
            for name in ("cells", "images", "references", "begun"):
                system.makedirs(f"{root}/{name}", exist_ok=True)
        except Exception as error:  # each file system has its own classes
            raise InputError(f"cannot write results to {self.address}: {_one_line(error)}") from None

    def check_writable(self, name: str) -> None:
        pass  # only a write can tell

    def has(self, name: str) -> bool:
        system, root = self._root
        with self._reading(name):
            return bool(system.isfile(f"{root}/{name}"))

    def get(self, name: str) -> bytes:
        system, root = self._root
        with self._reading(name):
            return bytes(system.cat_file(f"{root}/{name}"))

    def put(self, name: str, data: bytes, lasts: bool = True) -> None:
        system, root = self._root
        try:
            system.pipe_file(f"{root}/{name}", bytes(data))
        except Exception as error:
            raise WriteError(self.locate(name), _one_line(error)) from error

    def remove(self, name: str) -> None:
        system, root = self._root
        try:
            system.rm_file(f"{root}/{name}")
        except FileNotFoundError:
            pass
        except Exception as error:
            raise WriteError(self.locate(name), _one_line(error)) from error

    def list(self, prefix: str) -> list[str]:
        system, root = self._root
        with self._reading(prefix):
            found = system.glob(f"{root}/{prefix}*")
        return sorted(path[len(root) + 1 :] for path in found)

    def prune(self, folder: str) -> None:
        pass  # most have no empty folders

    @contextmanager
    def file(self, name: str) -> Iterator[Path]:
        with TemporaryDirectory(prefix="glossbench-") as folder:
            path = Path(folder) / PurePosixPath(name).name
            with suppress(FileNotFoundError):
                path.write_bytes(self.get(name))
            yield path

    @contextmanager
    def _reading(self, name: str) -> Iterator[None]:
        """A file that is missing raises FileNotFoundError; a store that does not answer stops the run."""
        try:
            yield
        except FileNotFoundError:
            raise
        except Exception as error:
            raise InputError(f"{self.locate(name)}: cannot be read: {_one_line(error)}") from error


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
