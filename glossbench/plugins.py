"""Plug-ins: modules of anyone, which register what they bring when they are imported."""

import importlib
import sys
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import module_from_spec
from pathlib import Path
from types import ModuleType

from glossbench.errors import InputError
from glossbench.import_closure import hash_of, is_installed, local_files

SOURCE = "__source_hash__"  # of a loaded plug-in: what its files were then


class NoSuchModule(InputError):
    """A name that no folder nor installed distribution has a module of."""


def import_plugin(name: str, folder: Path | None = None) -> ModuleType:
    """A module by its dotted name: one of a folder, such as the study's, else of the working folder, else installed.

    Both folders come behind what is installed on sys.path, for what the plug-in imports itself. A plug-in whose files
    changed is loaded again, and so is what another study of this process has under the same names from elsewhere.

    Raises:
        NoSuchModule: with where it was looked for.
        InputError: a file of these folders has the name of a module of Python, or of an installed one that is loaded.
    """
    places = list(dict.fromkeys([*([folder] if folder else []), Path.cwd()]))
    _put_on_path(places)
    top = name.partition(".")[0]
    spec = next(filter(None, (_spec(top, place) for place in places)), None)
    if spec is not None:
        _load(top, spec)
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{name}.".startswith(f"{error.name}."):
            raise  # of something else that the plug-in imports
        where = " nor ".join(map(str, places))
        told = (
            f"not in {where}, nor installed" if spec is None else f"{top} is {spec.origin}, which has none of this name"
        )
        raise NoSuchModule(f"no such module: {told}") from None


def origin(name: str) -> str:
    """The file of a plug-in that is loaded."""
    return str(getattr(sys.modules.get(name), "__file__", None) or "no file")


def _put_on_path(places: list[Path]) -> None:
    """Behind what is installed and what stands before it, ahead of folders of other studies."""
    at = 1 + max((i for i, place in enumerate(sys.path) if place and is_installed(Path(place))), default=-1)
    for place in reversed([str(place) for place in places]):
        if place not in sys.path[:at]:
            sys.path[at:] = [place, *(other for other in sys.path[at:] if other != place)]


def _spec(top: str, place: Path) -> ModuleSpec | None:
    """How a module of a folder is loaded, if the folder has a file or package of this name."""
    PathFinder.invalidate_caches()
    spec = PathFinder.find_spec(top, [str(place)])
    return spec if spec is not None and spec.has_location else None


def _load(top: str, spec: ModuleSpec) -> None:
    """Put the module or package of a folder in sys.modules, unless it is there as its files are now."""
    file = Path(spec.origin or "")
    if is_installed(file):
        return
    if top in sys.stdlib_module_names:
        raise InputError(f"{file} has the name of a module of Python itself; rename it")
    loaded, ours = sys.modules.get(top), local_files(top, file)
    source = hash_of(ours)
    if _file_of(loaded) == file.resolve() and vars(loaded).get(SOURCE, source) == source:
        return
    if is_installed(_file_of(loaded)):
        raise InputError(f"{file} has the name of an installed module that is loaded already; rename it")
    for each in list(sys.modules):
        if (
            each == top
            or each.startswith(f"{top}.")
            or (each in ours and not is_installed(_file_of(sys.modules[each])))
        ):
            del sys.modules[each]
    module = module_from_spec(spec)
    setattr(module, SOURCE, source)
    sys.modules[top] = module
    assert spec.loader is not None
    try:
        spec.loader.exec_module(module)
    except BaseException:
        sys.modules.pop(top, None)
        raise


def _file_of(module: ModuleType | None) -> Path | None:
    stated = getattr(module, "__file__", None)
    return Path(stated).resolve() if isinstance(stated, str) else None
