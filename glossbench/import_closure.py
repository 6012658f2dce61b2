"""What a module of anyone is made of: its file, and the files beside it that it imports, at any depth."""

import ast
import hashlib
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from functools import lru_cache
from importlib.machinery import BYTECODE_SUFFIXES, EXTENSION_SUFFIXES
from pathlib import Path

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


def local_files(module: str, file: Path) -> dict[str, Path]:
    """The files that a module is made of, by name: its own, its package's, and all that these import.

    An import is what the source says: `import a.b`, `from a import b`, relative ones, those inside functions, and a
    literal name handed to import_module. It is looked for beside the module that imports, from the folder of its
    outermost package, then in the places of sys.path; what is installed is left out. A name that is computed, and data
    that a module reads, are not seen.
    """
    found = {module: file}
    depth = module.count(".") + (file.stem == "__init__")
    if depth:
        outermost = file.parents[depth - 1]
        found |= {_name(path, outermost.parent): path for path in sorted(outermost.rglob("*.py"))}
    waiting = list(found.items())
    while waiting:
        module, file = waiting.pop()
        is_package = file.name.startswith("__init__.")
        root = file.parents[module.count(".") + is_package]
        package = module if is_package else module.rpartition(".")[0]
        stat = file.stat()
        for name in _imports(file, package, stat.st_size, stat.st_mtime_ns):
            for each, path in _resolved(name, root):
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
def _imports(file: Path, package: str, size: int, time: int) -> tuple[str, ...]:
    """Names of all modules that a file may import; `from a import b` counts as a.b, for b may be a module."""
    if file.suffix != ".py":
        return ()
    try:
        tree = ast.parse(file.read_bytes())
    except (SyntaxError, ValueError, RecursionError):
        return ()
    return tuple(sorted(set(_named(ast.walk(tree), package))))


def _named(nodes: Iterable[ast.AST], package: str) -> Iterator[str]:
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            outer = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level and package else []
            module = ".".join([*outer, *([node.module] if node.module else [])])
            yield from (f"{module}.{alias.name}".strip(".") for alias in node.names)
        elif isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in ("import_module", "__import__"):
            literal = [arg.value for arg in node.args[:1] if isinstance(arg, ast.Constant)]
            yield from (name for name in literal if isinstance(name, str) and not name.startswith("."))


@lru_cache(maxsize=1024)
def _digest(path: Path, size: int, time: int) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
