"""Values that the Tab key offers. Names are read from source files, because importing torch would take seconds."""

import re
from collections.abc import Callable
from importlib.metadata import entry_points
from importlib.resources import files
from pathlib import Path

from glossbench.catalog.entries import list_entries
from glossbench.study.study_files import find_study_files

_REGISTERED = re.compile(r'^@([A-Z]+)S\.register\("(\w+)"\)', re.MULTILINE)
_GROUPS = {
    "figure": "figures",
    "method": "methods",
    "material": "brdfs",
    "light": "lights",
    "view": "views",
    "metric": "metrics",
}


def list_registered(kind: str | None = None) -> list[str]:
    """Names of one kind, or of all kinds, that the source of the package registers or that entry points declare.

    For an entry point its name is used, without a look into its module: a module has the name of its method.
    """
    names = ("glossbench.reports",) if kind == "figure" else ("glossbench", "glossbench.methods")
    packages = [Path(str(files(package))) for package in names]
    sources = [path.read_text(encoding="utf-8") for package in packages for path in package.rglob("*.py")]
    found = {name for text in sources for of, name in _REGISTERED.findall(text) if kind in (None, of.lower())}
    for of in (kind,) if kind else set(_GROUPS) - {"figure"}:
        found |= entry_points(group=f"glossbench.{_GROUPS[of]}").names
    return sorted(found)


def complete_from(names: Callable[[], list[str]]) -> Callable[[str], list[str]]:
    """A completion function for typer: the names that begin with the typed text. If none does, shells offer files."""
    return lambda incomplete: [name for name in names() if name.startswith(incomplete)]


studies = complete_from(lambda: list(find_study_files()))
methods = complete_from(lambda: list_registered("method"))
lights = complete_from(
    lambda: sorted({*list_registered("light"), *(e.name for e in list_entries("environment"))} - {"file"})
)
catalogue = complete_from(lambda: [entry.name for entry in list_entries()])
results = complete_from(lambda: sorted(str(path.parent) for path in Path("results").glob("*/cells.parquet")))
reports = complete_from(lambda: sorted(entry_points(group="glossbench.reports").names))
figures = complete_from(lambda: list_registered("figure"))
everything = complete_from(
    lambda: sorted({*list_registered(), *find_study_files(), *(entry.name for entry in list_entries())})
)
