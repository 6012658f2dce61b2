"""A folder to which this program writes results. Its files may be damaged, or written by another program."""

import errno
import os
import re
import stat
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import file_digest
from pathlib import Path
from typing import Any

import pandas

from glossbench.atomic import remove_abandoned, replacing
from glossbench.errors import InputError, WriteError
from glossbench.run.manifest import NAME, Manifest
from glossbench.strict_json import seal, unseal


@dataclass(frozen=True)
class Folder:
    """A folder of results. Links out of it are not followed, and only files of this program are overwritten.

    Attributes:
        root: its path, which may itself be a link.
    """

    root: Path

    def path(self, name: str) -> Path:
        """The path of a file or folder in it; InputError for a link that leads out of it, a device or a pipe."""
        path = self.root / name
        real = Path(os.path.realpath(path))
        if not real.is_relative_to(os.path.realpath(self.root)):
            raise InputError(f"{path} leads out of the folder of results, to {real}; glossbench does not follow it")
        if os.path.lexists(real) and stat.S_IFMT(real.lstat().st_mode) not in (stat.S_IFREG, stat.S_IFDIR):
            raise InputError(f"{path} is a device or a pipe; a folder of results holds files")
        return path

    @property
    def manifest(self) -> Manifest:
        """The list of files that this program wrote, and of the study's cells."""
        self.path(NAME)
        return Manifest.read(self.root)

    def create(self) -> None:
        """Make the folders of a run, and remove files that a killed run left half-written.

        Raises:
            InputError: a folder cannot be made or written.
        """
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
        except UnicodeEncodeError:
            raise InputError(f"cannot write results to {str(self.root)!a}: the name is not UTF-8") from None
        except OSError as error:
            raise InputError(f"cannot write results to {self.root}: {error.strerror}") from None

    def own(self, *names: str) -> None:
        """Record in the manifest that files are this program's, before they are written.

        Raises:
            InputError: one of them exists and was not written by glossbench.
        """
        manifest = self.manifest
        manifest.check_foreign(self.root, names)
        if not os.access(self.root, os.W_OK | os.X_OK):
            raise WriteError(self.root / names[0], "the folder is read-only")
        if not set(names) <= set(manifest.files):
            replace(manifest, files={**manifest.files, **dict.fromkeys(names)}).write(self.root)

    def keep_only(self, ending: str, folder: str, names: Collection[str]) -> None:
        """Record the files written into a sub-folder; remove those with this ending that this program wrote earlier."""
        manifest = self.manifest
        written = [f"{folder}/{name}" for name in names]
        old = [n for n in manifest.files if n not in written and re.fullmatch(rf"{folder}/\w+{re.escape(ending)}", n)]
        for name in old:
            self.path(name).unlink(missing_ok=True)
        if old or not set(written) <= set(manifest.files):
            files = {name: sha256 for name, sha256 in manifest.files.items() if name not in old}
            replace(manifest, files={**files, **dict.fromkeys(written)}).write(self.root)
        if old and self.path(folder).is_dir() and not any(self.path(folder).iterdir()):
            self.path(folder).rmdir()

    def write(self, name: str, text: str) -> None:
        """Write a text to a file, completely or not at all."""
        with replacing(self.path(name)) as part:
            part.write_text(text, encoding="utf-8")

    def write_with(self, name: str, data: dict[str, Any], files: Iterable[str]) -> None:
        """Write a mapping as JSON, with checksums of itself and of other files, which must exist already."""
        self.write(name, seal({**data, "files": {other: self.compute_checksum(other) for other in files}}))

    def read(self, name: str) -> dict[str, Any]:
        """What `write_with` wrote; ValueError if the file is damaged."""
        data = unseal(self.path(name).read_bytes())
        data.pop("files", None)
        return data

    def compute_checksum(self, name: str) -> str | None:
        """SHA-256 of a file; None if it cannot be read."""
        try:
            with self.path(name).open("rb") as file:
                return file_digest(file, "sha256").hexdigest()
        except OSError:
            return None

    def find_damage(self, name: str) -> str:
        """The damage to a file that `write_with` wrote, or to the files that it names: "" if there is none.

        A missing file, and results of older versions, which have no checksums, count as undamaged.
        """
        try:
            stated = unseal(self.path(name).read_bytes()).get("files", {})
            return next(
                (
                    self.explain_fault(other)
                    for other, sha256 in stated.items()
                    if self.compute_checksum(other) != sha256
                ),
                "",
            )
        except FileNotFoundError:
            return ""
        except InputError:
            raise
        except (OSError, ValueError, AttributeError, TypeError):
            return self.explain_fault(name)

    def is_altered(self, name: str) -> bool:
        """Whether a file of a finished run has changed since the run wrote it."""
        checksum = self.manifest.files.get(name)
        return checksum is not None and self.compute_checksum(name) != checksum

    def write_table(self, name: str, rows: Sequence[Mapping[str, Any]]) -> None:
        """Write rows as Parquet; into an open file, because pandas may take a name for an address."""
        with replacing(self.path(name)) as part, part.open("wb") as file:
            pandas.DataFrame(rows).to_parquet(file, index=False)

    def read_table(self, name: str) -> pandas.DataFrame | None:
        """The table in a file; None if it is damaged."""
        try:
            with self.path(name).open("rb") as file:
                return None if self.is_altered(name) else pandas.read_parquet(file)
        except InputError:
            raise
        except (OSError, ValueError):
            return None

    def explain_fault(self, name: str) -> str:
        """The message that a file is damaged or missing."""
        return f"{self.root / name} is {'damaged' if self.path(name).is_file() else 'missing'}"
