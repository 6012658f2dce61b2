"""What a module is made of: its file, and the files that it imports, at any depth, of anyone and of glossbench."""

import hashlib
import sys
import sysconfig
from collections.abc import Iterator
from functools import lru_cache
from importlib.machinery import BYTECODE_SUFFIXES, EXTENSION_SUFFIXES
from pathlib import Path

from glossbench import source_tree
from glossbench.source_imports import Imported, source_of

ENDINGS = (".py", *EXTENSION_SUFFIXES, *BYTECODE_SUFFIXES)
OWN = Path(__file__).resolve().parent


@lru_cache(maxsize=4096)
def is_installed(path: Path | None) -> bool:
    """Whether a file or folder is of Python, of an installed distribution or of glossbench: versions tell of these."""
    if path is None:
        return False
    resolved = path.resolve()
    if {"site-packages", "dist-packages"} & set(resolved.parts):
        return True
    roots = [Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib")]
    return any(resolved.is_relative_to(root) for root in (*roots, OWN)) or resolved.suffix == ".zip"


def source_files(module: str, file: Path) -> dict[str, Path]:
    """The files that decide what a module computes, by name: glossbench's own among them.

    Of a module of anyone these are `local_files`, and what those import of glossbench.
    """
    tree = source_tree.GLOSSBENCH
    if tree.has(module):
        return tree.closure([Imported(module)])
    local = local_files(module, file)
    imports = [each for name, path in local.items() for each in source_of(path, _package(name, path)).imports]
    return local | tree.closure(imports)


def local_files(module: str, file: Path) -> dict[str, Path]:
    """The files that a module is made of, by name: its own, its package's, and all that these import.

    An import is what the source says (`source_of`). It is looked for beside the module that imports, from the folder of
    its outermost package, then in the places of sys.path; what is installed is left out. Data that a module reads are
    not seen.
    """
    found = {module: file}
    depth = module.count(".") + (file.stem == "__init__")
    if depth:
        outermost = file.parents[depth - 1]
        found |= {_name(path, outermost.parent): path for path in sorted(outermost.rglob("*.py"))}
    waiting = list(found.items())
    while waiting:
        module, file = waiting.pop()
        package = _package(module, file)
        root = file.parents[module.count(".") + (package == module)]
        for imported in source_of(file, package).imports:
            for each, path in _resolved(imported.dotted, root):
                if each not in found:
                    found[each] = path
                    waiting.append((each, path))
    return found


def hash_of(files: dict[str, Path]) -> str:
    """SHA-256 of modules by name and content, wherever they lie."""
    digest = hashlib.sha256()
    for name, path in sorted(files.items()):
        stat = path.stat()
        digest.update(f"{name} {_digest(path, stat.st_size, stat.st_mtime_ns)}\n".encode())
    return digest.hexdigest()


def _package(module: str, file: Path) -> str:
    """The package that relative imports of a module start from."""
    return module if file.name.startswith("__init__.") else module.rpartition(".")[0]


def _name(path: Path, place: Path) -> str:
    """The dotted name of a file below a place of sys.path."""
    parts = path.relative_to(place).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _resolved(name: str, root: Path) -> Iterator[tuple[str, Path]]:
    """The files of a dotted name and of the packages that it is in, where they are not installed."""
    parts = name.split(".")
    if parts[0] in sys.stdlib_module_names or parts[0] == "glossbench":
        return
    places = [root, *(Path(place) for place in sys.path if place and not is_installed(Path(place)))]
    for place in places:
        files = [(".".join(parts[:i]), _file_of(place.joinpath(*parts[:i]))) for i in range(1, len(parts) + 1)]
        known = [(each, file) for each, file in files if file is not None]
        if known:
            yield from known
            return


def _file_of(stem: Path) -> Path | None:
    """The file of a module, or of a package, at a path without ending."""
    candidates = [stem / "__init__.py", *(stem.with_name(stem.name + ending) for ending in ENDINGS)]
    return next((each for each in candidates if each.is_file() and not is_installed(each)), None)


@lru_cache(maxsize=1024)
def _digest(path: Path, size: int, time: int) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
