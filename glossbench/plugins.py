"""Plug-ins: modules from outside glossbench, which register their classes when they are imported."""

import importlib
import sys
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import module_from_spec
from pathlib import Path
from types import ModuleType

from glossbench.errors import InputError
from glossbench.import_closure import find_local_files, hash_of, is_installed

SOURCE = "__source_hash__"  # attribute of a loaded plug-in: the hash of its files at that time


class NoSuchModule(InputError):
    """No folder and no installed distribution has a module of this name."""


def import_plugin(name: str, folder: Path | None = None) -> ModuleType:
    """Import a module by its dotted name: from `folder` (such as the study's), the working folder, or as installed.

    The module is looked for in this order. Both folders are put on sys.path after installed distributions, for the
    imports of the plug-in itself. A plug-in is loaded again if its files changed, or if another study of this process
    loaded a module of the same name from another place.

    Raises:
        NoSuchModule: no such module; the error says where it was looked for.
        InputError: a file of these folders has the name of a module of Python, or of an installed module that is
            loaded already.
    """
    places = list(dict.fromkeys([*([folder] if folder else []), Path.cwd()]))
    _put_on_path(places)
    top = name.partition(".")[0]
    spec = next(filter(None, (_find_spec(top, place) for place in places)), None)
    if spec is not None:
        _load(top, spec)
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{name}.".startswith(f"{error.name}."):
            raise  # another module, which the plug-in imports, is missing
        where = " nor ".join(map(str, places))
        told = (
            f"not in {where}, nor installed" if spec is None else f"{top} is {spec.origin}, which does not contain it"
        )
        raise NoSuchModule(f"no such module: {told}") from None


def find_origin(name: str) -> str:
    """The file of a loaded plug-in."""
    return str(getattr(sys.modules.get(name), "__file__", None) or "no file")


def _put_on_path(places: list[Path]) -> None:
    """Put folders on sys.path: after all installed distributions, and before folders of other studies."""
    at = 1 + max((i for i, place in enumerate(sys.path) if place and is_installed(Path(place))), default=-1)
    for place in reversed([str(place) for place in places]):
        if place not in sys.path[:at]:
            sys.path[at:] = [place, *(other for other in sys.path[at:] if other != place)]


def _find_spec(top: str, place: Path) -> ModuleSpec | None:
    """The import specification of a module in a folder; None if the folder does not have a module of this name."""
    PathFinder.invalidate_caches()
    spec = PathFinder.find_spec(top, [str(place)])
    return spec if spec is not None and spec.has_location else None


def _load(top: str, spec: ModuleSpec) -> None:
    """Load a module or package of a folder into sys.modules, unless it is there already with unchanged files."""
    file = Path(spec.origin or "")
    if is_installed(file):
        return
    if top in sys.stdlib_module_names:
        raise InputError(f"{file} has the name of a module of Python itself; rename it")
    loaded, ours = sys.modules.get(top), find_local_files(top, file)
    source = hash_of(ours)
    if _find_file(loaded) == file.resolve() and vars(loaded).get(SOURCE, source) == source:
        return
    if is_installed(_find_file(loaded)):
        raise InputError(f"{file} has the name of an installed module that is loaded already; rename it")
    for each in list(sys.modules):
        if (
            each == top
            or each.startswith(f"{top}.")
            or (each in ours and not is_installed(_find_file(sys.modules[each])))
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


def _find_file(module: ModuleType | None) -> Path | None:
    stated = getattr(module, "__file__", None)
    return Path(stated).resolve() if isinstance(stated, str) else None
