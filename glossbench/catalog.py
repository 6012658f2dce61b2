"""The catalogue of public inputs: a name -> a verified file on this machine."""

import hashlib
import os
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import pooch
import yaml

from glossbench.envmap.lights import DATA_VARIABLE
from glossbench.errors import InputError, nearest


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
    """

    name: str
    kind: str
    file: str
    url: str
    sha256: str
    bytes: int
    licence: str
    stresses: str

    def local(self) -> Path | None:
        """The file where it is here already, below GLOSSBENCH_DATA or fetched; its hash is checked."""
        folder = os.environ.get(DATA_VARIABLE)
        places = sorted(Path(folder).rglob(self.file)) if folder and Path(folder).is_dir() else []
        for path in [*places, cache_folder() / self.file]:
            if path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == self.sha256:
                return path
        return None


def cache_folder() -> Path:
    """Where fetched files lie."""
    return Path(pooch.os_cache("glossbench"))


def entries() -> list[Entry]:
    """The whole catalogue."""
    text = (files("glossbench.data") / "catalog.yaml").read_text(encoding="utf-8")
    return [Entry(**item) for item in yaml.safe_load(text)]


def entry(name: str) -> Entry:
    """One entry; InputError with the nearest name when there is none."""
    known = {e.name: e for e in entries()}
    if name not in known:
        raise InputError(f"the catalogue has no {name!r}{nearest(name, known)}")
    return known[name]


def fetch(name: str) -> Path:
    """The verified file of a name, brought here if it is not: whole or not at all.

    Raises:
        InputError: unknown name, no network, or bytes that have not the catalogue's hash.
    """
    wanted = entry(name)
    here = wanted.local()
    if here is not None:
        return here
    try:
        return Path(
            pooch.retrieve(wanted.url, known_hash=f"sha256:{wanted.sha256}", fname=wanted.file, path=cache_folder())
        )
    except (OSError, ValueError) as error:
        first = str(error).splitlines()[0]
        raise InputError(
            f"cannot fetch {name}: {type(error).__name__}: {first}; a folder that holds {wanted.file} may be named by "
            f"{DATA_VARIABLE}"
        ) from None
