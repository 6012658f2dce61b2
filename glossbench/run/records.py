"""What a run keeps in its store: files with checksums, and a list of those that this program wrote."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from io import BytesIO
from typing import Any

import pandas

from glossbench.errors import InputError
from glossbench.run.manifest import Manifest
from glossbench.run.store import Store
from glossbench.strict_json import seal, unseal


@dataclass(frozen=True)
class Records:
    """The files of a run in a store. They may be damaged; only files of this program are written over."""

    store: Store

    @property
    def manifest(self) -> Manifest:
        """The list of files that this program wrote, and of the study's cells."""
        return Manifest.read(self.store)

    def own(self, *names: str) -> None:
        """Record in the manifest that files are this program's, before they are written.

        Raises:
            InputError: one of them exists and was not written by glossbench.
        """
        manifest = self.manifest
        manifest.check_foreign(self.store, names)
        self.store.check_writable(names[0])
        if not set(names) <= set(manifest.files):
            replace(manifest, files={**manifest.files, **dict.fromkeys(names)}).write(self.store)

    def keep_only(self, ending: str, folder: str, names: Collection[str]) -> None:
        """Record the files written into a sub-folder; remove those with this ending that this program wrote earlier."""
        manifest = self.manifest
        written = [f"{folder}/{name}" for name in names]
        old = [n for n in manifest.files if n not in written and re.fullmatch(rf"{folder}/\w+{re.escape(ending)}", n)]
        for name in old:
            self.store.remove(name)
        if old or not set(written) <= set(manifest.files):
            files = {name: digest for name, digest in manifest.files.items() if name not in old}
            replace(manifest, files={**files, **dict.fromkeys(written)}).write(self.store)
        if old:
            self.store.prune(folder)

    def write(self, name: str, text: str) -> None:
        """Write a text to a file, completely or not at all."""
        self.store.put(name, text.encode("utf-8"))

    def write_with(self, name: str, data: dict[str, Any], files: Mapping[str, bytes], lasts: bool = True) -> int:
        """Write other files, and last a mapping as JSON, with checksums of itself and of these; the bytes of all.

        Args:
            lasts: whether to wait for the disk (`Store.put`).
        """
        for other, content in files.items():
            self.store.put(other, content, lasts)
        digests = {other: sha256(content).hexdigest() for other, content in files.items()}
        text = seal({**data, "files": digests})
        self.store.put(name, text.encode("utf-8"), lasts)
        return len(text) + sum(map(len, files.values()))

    def read(self, name: str) -> dict[str, Any]:
        """The mapping that `write_with` wrote; ValueError if its file is damaged."""
        data = unseal(self.store.get(name))
        data.pop("files", None)
        return data

    def compute_checksum(self, name: str) -> str | None:
        """SHA-256 of a file; None if it cannot be read."""
        try:
            return sha256(self.store.get(name)).hexdigest()
        except OSError:
            return None

    def find_damage(self, name: str) -> str:
        """The damage to a file that `write_with` wrote, or to the files that it names: "" if there is none.

        A missing file, and results of older versions, which have no checksums, count as undamaged.
        """
        try:
            stated = unseal(self.store.get(name)).get("files", {})
            found = (other for other, digest in stated.items() if self.compute_checksum(other) != digest)
            return next(map(self.explain_fault, found), "")
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

    def read_table(self, name: str) -> pandas.DataFrame | None:
        """The table in a file; None if it is damaged."""
        try:
            return None if self.is_altered(name) else pandas.read_parquet(BytesIO(self.store.get(name)))
        except InputError:
            raise
        except (OSError, ValueError):
            return None

    def explain_fault(self, name: str) -> str:
        """The message that a file is damaged or missing."""
        return f"{self.store.locate(name)} is {'damaged' if self.store.has(name) else 'missing'}"


def encode_table(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """Rows as Parquet."""
    coded = BytesIO()
    pandas.DataFrame(rows).to_parquet(coded, index=False)
    return coded.getvalue()
