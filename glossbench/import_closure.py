"""The files that a module consists of: its own, and all that it imports at any depth, from plug-ins and glossbench."""

import hashlib
import os
import sys
import sysconfig
from collections.abc import Iterator
from functools import lru_cache
from importlib.machinery import BYTECODE_SUFFIXES, EXTENSION_SUFFIXES
from pathlib import Path

from glossbench import source_tree
from glossbench.source_imports import ImportedName, read_source

ENDINGS = (".py", *EXTENSION_SUFFIXES, *BYTECODE_SUFFIXES)
OWN = Path(__file__).resolve().parent


@lru_cache(maxsize=4096)
def is_installed(path: Path | None) -> bool:
    """Whether a file or folder belongs to Python, to an installed distribution or to glossbench.

    Results name the versions of these, so their files need not be hashed one by one.
    """
    if path is None:
        return False
    resolved = path.resolve()
    if {"site-packages", "dist-packages"} & set(resolved.parts):
        return True
    roots = [Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib")]
    return any(resolved.is_relative_to(root) for root in (*roots, OWN)) or resolved.suffix == ".zip"


def find_source_files(module: str, file: Path) -> dict[str, Path]:
    """The files that decide what a module computes, by module name, including files of glossbench.

    For a module outside glossbench these are `find_local_files`, and the files of glossbench that those import.
    """
    tree = source_tree.GLOSSBENCH
    if tree.has(module):
        return tree.find_closure([ImportedName(module)])
    local = find_local_files(module, file)
    imports = [each for name, path in local.items() for each in read_source(path, _find_package(name, path)).imports]
    return local | tree.find_closure(imports)


def find_local_files(module: str, file: Path) -> dict[str, Path]:
    """The files that a module consists of, by module name: its own, those of its package, and all that these import.

    Imports are found in the source text (`read_source`). Each is looked for in the folder that holds the outermost
    package of the importing module, then in the places of sys.path. Installed modules are left out. Data files that a
    module reads are not found.
    """
    found = {module: file}
    depth = module.count(".") + (file.stem == "__init__")
    if depth:
        outermost = file.parents[depth - 1]
        found |= {_name(path, outermost.parent): path for path in sorted(outermost.rglob("*.py"))}
    waiting, places = list(found.items()), _Places()
    while waiting:
        module, file = waiting.pop()
        package = _find_package(module, file)
        root = file.parents[module.count(".") + (package == module)]
        for imported in read_source(file, package).imports:
            for each, path in places.resolve(imported.dotted, root):
                if each not in found:
                    found[each] = path
                    waiting.append((each, path))
    return found


def hash_of(files: dict[str, Path]) -> str:
    """SHA-256 of the names and contents of modules; it does not depend on their folders."""
    digest = hashlib.sha256()
    for name, path in sorted(files.items()):
        stat = path.stat()
        digest.update(f"{name} {_compute_digest(path, stat.st_size, stat.st_mtime_ns)}\n".encode())
    return digest.hexdigest()


def _find_package(module: str, file: Path) -> str:
    """The package at which relative imports of a module start."""
    return module if file.name.startswith("__init__.") else module.rpartition(".")[0]


def _name(path: Path, place: Path) -> str:
    """The dotted name of a file below a place of sys.path."""
    parts = path.relative_to(place).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


class _Places:
    """Where the modules of plug-ins are: a root, then the folders of sys.path that hold no installed modules.

    The names in a folder are read once, because most imported names are in none of them.
    """

    def __init__(self) -> None:
        paths = [Path(place) for place in sys.path if place]
        self._places = [place for place in paths if not is_installed(place)]
        self._names: dict[Path, set[str]] = {}

    def resolve(self, name: str, root: Path) -> Iterator[tuple[str, Path]]:
        """The files of a dotted name and of the packages that contain it, if they are not installed."""
        parts = name.split(".")
        if parts[0] in sys.stdlib_module_names or parts[0] == "glossbench":
            return
        for place in (root, *self._places):
            if parts[0] not in self._list_names(place):
                continue
            stems = {".".join(parts[:i]): place.joinpath(*parts[:i]) for i in range(1, len(parts) + 1)}
            files = [(each, self._find_file(stem)) for each, stem in stems.items()]
            known = [(each, file) for each, file in files if file is not None]
            if known:
                yield from known
                return

    def _find_file(self, stem: Path) -> Path | None:
        """The file of a module or package, from its path without the ending; None if there is no such file."""
        if stem.name not in self._list_names(stem.parent):
            return None
        candidates = [stem / "__init__.py", *(stem.with_name(stem.name + ending) for ending in ENDINGS)]
        return next((each for each in candidates if each.is_file() and not is_installed(each)), None)

    def _list_names(self, place: Path) -> set[str]:
        """The names of a folder's modules and packages; none of a place that cannot be read."""
        if place not in self._names:
            try:
                self._names[place] = {entry.partition(".")[0] for entry in os.listdir(place)}
            except OSError:
                self._names[place] = set()
        return self._names[place]


@lru_cache(maxsize=1024)
def _compute_digest(path: Path, size: int, time: int) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
