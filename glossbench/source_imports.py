"""The imports in the source of a file. They are read from the text; the file is not run."""

import ast
from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

CALLS = ("import_module", "__import__")


class ImportedName(NamedTuple):
    """An imported module, or a name imported from it, which may be a module too; the name is empty for the module."""

    module: str
    name: str = ""

    @property
    def dotted(self) -> str:
        """Module and name as one dotted name."""
        return f"{self.module}.{self.name}".strip(".")


class Source(NamedTuple):
    """The imports of a file, at any depth of its code.

    Attributes:
        imports: all imports except those under `if TYPE_CHECKING`.
        names: the names that imports outside of functions and classes bind, including those under `if TYPE_CHECKING`.
    """

    imports: tuple[ImportedName, ...]
    names: dict[str, ImportedName]


def read_source(file: Path, package: str) -> Source:
    """The imports of a file of this package; empty if the file is not Python or cannot be parsed.

    It finds `import a.b`, `from a import b`, relative imports, imports inside functions, and literal names that are
    passed to import_module. It does not find computed names.
    """
    stat = file.stat()
    return _read_source(file, package, stat.st_size, stat.st_mtime_ns)


@lru_cache(maxsize=4096)
def _read_source(file: Path, package: str, size: int, time: int) -> Source:
    if file.suffix != ".py":
        return Source((), {})
    text = file.read_bytes()
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError):
        return Source((), {})
    imports = {each for node in _walk_statements(tree.body) for _, each in _find_bound(node, package)}
    if any(call.encode() in text for call in CALLS):
        imports |= set(_find_import_calls(tree))
    names = {name: each for node in _walk_outermost(tree.body) for name, each in _find_bound(node, package)}
    return Source(tuple(sorted(imports)), names)


def _walk_statements(body: Iterable[ast.AST]) -> Iterator[ast.AST]:
    """All statements except those under `if TYPE_CHECKING`.

    Expressions do not contain statements, so most of the tree is not visited.
    """
    for node in body:
        if isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING"):
            yield from _walk_statements(node.orelse)
            continue
        yield node
        for block in ("body", "orelse", "finalbody", "handlers", "cases"):
            inner = getattr(node, block, None)
            yield from _walk_statements(inner) if isinstance(inner, list) else ()


def _walk_outermost(body: Iterable[ast.AST]) -> Iterator[ast.AST]:
    for node in body:
        yield from _walk_outermost([*node.body, *node.orelse]) if isinstance(node, ast.If) else [node]


def _find_bound(node: ast.AST, package: str) -> Iterator[tuple[str, ImportedName]]:
    """The names that an import statement binds, and what they mean."""
    if isinstance(node, ast.Import):
        for alias in node.names:
            yield alias.asname or alias.name.partition(".")[0], ImportedName(alias.name)
    elif isinstance(node, ast.ImportFrom):
        outer = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level and package else []
        module = ".".join([*outer, *([node.module] if node.module else [])])
        for alias in node.names:
            yield alias.asname or alias.name, ImportedName(module, alias.name)


def _find_import_calls(tree: ast.AST) -> Iterator[ImportedName]:
    """Literal names that are passed to import_module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in CALLS:
            literal = [arg.value for arg in node.args[:1] if isinstance(arg, ast.Constant)]
            yield from (ImportedName(name) for name in literal if isinstance(name, str) and not name.startswith("."))
