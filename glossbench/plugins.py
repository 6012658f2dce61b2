"""Plug-ins: modules of anyone, which register what they bring when they are imported."""

import importlib
import sys
from pathlib import Path
from types import ModuleType


def import_plugin(name: str, folder: Path | None = None) -> ModuleType:
    """A module by its dotted name: an installed one, or of the working folder or another one, such as the study's.

    These folders stay behind all others on sys.path: a plug-in may import more of its own later.
    """
    for place in (Path.cwd(), folder):
        if place is not None and str(place) not in sys.path:
            sys.path.append(str(place))
    return importlib.import_module(name)
