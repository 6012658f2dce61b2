"""A folder that this program writes results to: what is in it may be damaged, or come from a stranger."""

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
from glossbench.errors import CannotWrite, InputError
from glossbench.run.manifest import NAME, Manifest
from glossbench.strict_json import sealed, unsealed


@dataclass(frozen=True)
class Folder:
    """A folder of results. No link leads out of it, and only what this program wrote is written over.

    Attributes:
        root: its path, which itself may be a link.
    """

    root: Path

    def path(self, name: str) -> Path:
        """Of a file or folder in it; InputError for one that a link leads out of it, for a device and a pipe."""
        path = self.root / name
        real = Path(os.path.realpath(path))
        if not real.is_relative_to(os.path.realpath(self.root)):
            raise InputError(f"{path} leads out of the folder of results, to {real}; glossbench follows no such link")
        if os.path.lexists(real) and stat.S_IFMT(real.lstat().st_mode) not in (stat.S_IFREG, stat.S_IFDIR):
            raise InputError(f"{path} is a device or a pipe; a folder of results holds files")
        return path

    @property
    def manifest(self) -> Manifest:
        """Which files are this program's, and which cells the study has."""
        self.path(NAME)
        return Manifest.read(self.root)

    def create(self) -> None:
        """Make the folders of a run, or say why they cannot be made; remove what a killed run left half-written."""
        try:
            os.fspath(self.root).encode()
            for name in ("", "cells", "images", "references"):
                folder = self.path(name)
                if folder.exists() and not folder.is_dir():
                    raise NotADirectoryError(0, os.strerror(errno.ENOTDIR))
                folder.mkdir(parents=True, exist_ok=True)
                if not os.access(folder, os.W_OK | os.X_OK):
                    raise PermissionError(0, "it may only be read; name another folder by -o")
                remove_abandoned(folder)
        except UnicodeEncodeError:
            raise InputError(f"cannot write results to {str(self.root)!a}: the name is not UTF-8") from None
        except OSError as error:
            raise InputError(f"cannot write results to {self.root}: {error.strerror}") from None

    def own(self, *names: str) -> None:
        """State that files will be this program's, before they are written; InputError for one of somebody else."""
        manifest = self.manifest
        manifest.check_foreign(self.root, names)
        if not os.access(self.root, os.W_OK | os.X_OK):
            raise CannotWrite(self.root / names[0], "the folder may only be read")
        if not set(names) <= set(manifest.files):
            replace(manifest, files={**manifest.files, **dict.fromkeys(names)}).write(self.root)

    def keep_only(self, ending: str, folder: str, names: Collection[str]) -> None:
        """State what was written into a sub-folder; remove what this program wrote there earlier, with that ending."""
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
        """Write a text under a name, whole or not at all."""
        with replacing(self.path(name)) as part:
            part.write_text(text, encoding="utf-8")

    def write_with(self, name: str, data: dict[str, Any], files: Iterable[str]) -> None:
        """Write a mapping as JSON, with checksums of itself and of other files, which are there already."""
        self.write(name, sealed({**data, "files": {other: self.checksum(other) for other in files}}))

    def read(self, name: str) -> dict[str, Any]:
        """What `write_with` wrote; ValueError where it is damaged."""
        data = unsealed(self.path(name).read_bytes())
        data.pop("files", None)
        return data

    def checksum(self, name: str) -> str | None:
        """SHA-256 of a file; None where there is none."""
        try:
            with self.path(name).open("rb") as file:
                return file_digest(file, "sha256").hexdigest()
        except OSError:
            return None

    def damage(self, name: str) -> str:
        """What is wrong with what `write_with` wrote, and with its files: "" where all is as it was.

        Of what is not there, and of older results, which have no checksums, nothing is known to be wrong.
        """
        try:
            stated = unsealed(self.path(name).read_bytes()).get("files", {})
            return next((self.fault(other) for other, sha256 in stated.items() if self.checksum(other) != sha256), "")
        except FileNotFoundError:
            return ""
        except InputError:
            raise
        except (OSError, ValueError, AttributeError, TypeError):
            return self.fault(name)

    def is_altered(self, name: str) -> bool:
        """Whether a file of a finished run is not what the run wrote."""
        checksum = self.manifest.files.get(name)
        return checksum is not None and self.checksum(name) != checksum

    def write_table(self, name: str, rows: Sequence[Mapping[str, Any]]) -> None:
        """Write rows as Parquet; by a file that is open, for a name may look like an address."""
        with replacing(self.path(name)) as part, part.open("wb") as file:
            pandas.DataFrame(rows).to_parquet(file, index=False)

    def table(self, name: str) -> pandas.DataFrame | None:
        """The table that was written under a name; None where it is damaged."""
        try:
            with self.path(name).open("rb") as file:
                return None if self.is_altered(name) else pandas.read_parquet(file)
        except InputError:
            raise
        except (OSError, ValueError):
            return None

    def fault(self, name: str) -> str:
        """That a file is damaged, or not there."""
        return f"{self.root / name} is {'damaged' if self.path(name).is_file() else 'missing'}"
