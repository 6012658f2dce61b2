"""The catalogue of public inputs: from a name to a verified file on this machine."""

import hashlib
import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml

from glossbench.catalog.folders import cache_folder, find_data_folders
from glossbench.errors import InputError, suggest_nearest

KINDS = {"environment": "an environment", "brdf": "a measured or fitted BRDF", "mesh": "a mesh"}


@dataclass(frozen=True)
class Entry:
    """A public file.

    Attributes:
        name: its name in studies and on the command line.
        kind: environment, brdf or mesh.
        file: its file name on disk.
        url: its source, pinned to a commit.
        sha256: the hash of its bytes.
        bytes: its size [bytes].
        licence: what its authors allow, in their words.
        stresses: why it is useful in a study, in a few words.
        reading: for an environment, how to read its file: options of the light `file`.
    """

    name: str
    kind: str
    file: str
    url: str
    sha256: str
    bytes: int
    licence: str
    stresses: str
    reading: dict[str, Any] = field(default_factory=dict)

    def find_local(self) -> Path | None:
        """The file if it is below GLOSSBENCH_DATA or was fetched before, and its hash is right; otherwise None."""
        for folder in find_data_folders():
            for path in sorted(folder.rglob(self.file)):
                if path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == self.sha256:
                    return path
        return None


def list_entries(kind: str | None = None) -> list[Entry]:
    """All entries of the catalogue, or those of one kind."""
    if kind is not None and kind not in KINDS:
        raise InputError(f"unknown kind {kind!r}{suggest_nearest(kind, KINDS)}")
    text = (files("glossbench.data") / "catalog.yaml").read_text(encoding="utf-8")
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the C loader, if it was built, is seven times as fast
    return [Entry(**item) for item in yaml.load(text, loader) if kind in (None, item["kind"])]


def find_entry(name: str) -> Entry:
    """The entry of a name; an unknown name raises InputError with the nearest name."""
    known = {e.name: e for e in list_entries()}
    if name not in known:
        raise InputError(f"the catalogue has no {name!r}{suggest_nearest(name, known)}")
    return known[name]


def fetch_once(name: str) -> Path:
    """`fetch` for repeated calls: the file is searched and verified once per process."""
    return _fetch_from(name, tuple(find_data_folders()))


@lru_cache(maxsize=64)
def _fetch_from(name: str, folders: tuple[Path, ...]) -> Path:
    return fetch(name)


def fetch(name: str, progress: Callable[[int], None] = lambda n: None) -> Path:
    """The verified file of a name. If it is not on this machine, it is downloaded, whole or not at all.

    Args:
        progress: is called with the number of bytes received so far.

    Raises:
        InputError: the name is unknown, the network fails, or the hash of the bytes is not the catalogue's.
    """
    wanted = find_entry(name)
    here = wanted.find_local()
    if here is not None:
        return here
    from glossbench.catalog.download import download, host  # imported here: a file found above does not need them

    logging.getLogger("glossbench").warning(
        "%s is not here: fetching %.1f MB from %s", wanted.file, wanted.bytes / 1e6, host(wanted.url)
    )
    return download(wanted.url, cache_folder() / wanted.file, wanted.sha256, wanted.bytes, progress)
