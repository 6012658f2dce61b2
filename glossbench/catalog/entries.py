"""The catalogue of public inputs: a name -> a verified file on this machine."""

import hashlib
import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml

from glossbench.catalog.folders import cache_folder, data_folders
from glossbench.errors import InputError, nearest

KINDS = {"environment": "an environment", "brdf": "a measured or fitted BRDF", "mesh": "a mesh"}


@dataclass(frozen=True)
class Entry:
    """A public file.

    Attributes:
        name: in studies and on the command line.
        kind: environment, brdf or mesh.
        file: its name on disk.
        url: where it comes from, pinned to a commit.
        sha256: of its bytes.
        bytes: its size.
        licence: what its authors allow, as they state it.
        stresses: what it is good for in a study.
        reading: of an environment, how its file is to be understood: options of the light `file`.
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

    def local(self) -> Path | None:
        """The file where it is here already, below GLOSSBENCH_DATA or fetched; its hash is checked."""
        for folder in data_folders():
            for path in sorted(folder.rglob(self.file)):
                if path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == self.sha256:
                    return path
        return None


def entries(kind: str | None = None) -> list[Entry]:
    """The catalogue, or those of its entries that are of one kind."""
    if kind is not None and kind not in KINDS:
        raise InputError(f"unknown kind {kind!r}{nearest(kind, KINDS)}")
    text = (files("glossbench.data") / "catalog.yaml").read_text(encoding="utf-8")
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # in C where it was built: seven times as fast
    return [Entry(**item) for item in yaml.load(text, loader) if kind in (None, item["kind"])]


def entry(name: str) -> Entry:
    """One entry; InputError with the nearest name when there is none."""
    known = {e.name: e for e in entries()}
    if name not in known:
        raise InputError(f"the catalogue has no {name!r}{nearest(name, known)}")
    return known[name]


def fetch_once(name: str) -> Path:
    """`fetch` for what asks again and again: the file is looked for and verified once a process."""
    return _fetched(name, tuple(data_folders()))


@lru_cache(maxsize=64)
def _fetched(name: str, folders: tuple[Path, ...]) -> Path:
    return fetch(name)


def fetch(name: str, progress: Callable[[int], None] = lambda n: None) -> Path:
    """The verified file of a name, brought here if it is not: whole or not at all.

    Args:
        progress: told the bytes that are here, while they arrive.

    Raises:
        InputError: unknown name, no network, or bytes that have not the catalogue's hash.
    """
    wanted = entry(name)
    here = wanted.local()
    if here is not None:
        return here
    from glossbench.catalog.download import download, host  # what a file that is here already need not wait for

    logging.getLogger("glossbench").warning(
        "%s is not here: fetching %.1f MB from %s", wanted.file, wanted.bytes / 1e6, host(wanted.url)
    )
    return download(wanted.url, cache_folder() / wanted.file, wanted.sha256, wanted.bytes, progress)
