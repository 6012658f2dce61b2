"""Names of the catalogue in registries: one registered class per file, and a hint if a name is of another kind."""

import sys
from collections.abc import Iterable
from typing import TypeVar

from glossbench.catalog.entries import KINDS, Entry, list_entries
from glossbench.documentation import read_documentation
from glossbench.options import Options
from glossbench.registry import Registry

T = TypeVar("T", bound=Options)


def explain_catalog_name(name: str) -> str:
    """The end of an error message if the catalogue has this name as another kind of thing, else an empty string."""
    return next(
        (f"; the catalogue has {KINDS[each.kind]} of this name" for each in list_entries() if each.name == name), ""
    )


def register_entries(registry: Registry[T], base: type[T], stated: Iterable[Entry], documented: type[T]) -> None:
    """Registers one subclass of base per file of the catalogue, so that its name works like any other name.

    Args:
        documented: the class whose docstring describes the options, after its first paragraph.
    """
    options = read_documentation(documented).partition("\n\n")[2]
    for each in stated:
        about = f"{each.stresses[0].upper()}{each.stresses[1:]}: {each.file} of the catalogue.\n\n{options}"
        members = {"__doc__": about, "__module__": base.__module__, "__qualname__": each.name}
        made = registry.register(each.name)(type(each.name, (base,), members))
        setattr(sys.modules[base.__module__], each.name, made)  # where pickle looks for it, on a worker, too
