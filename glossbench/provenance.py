"""Provenance: the versions, the source and the machine that produced results."""

import hashlib
import os
import platform
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from pathlib import Path
from types import MappingProxyType
from typing import Any
from uuid import uuid4

import torch

from glossbench import source_tree
from glossbench.import_closure import find_source_files, hash_of
from glossbench.source_imports import ImportedName

version = cache(metadata.version)  # cached, because metadata.version reads a file

# Libraries that compute and decode for glossbench: with another version of one of them, every cell is new.
COMPUTING = ("torch", "scipy", "scikit-image", "flip-evaluator", "OpenImageIO", "trimesh", "embreex")


@cache
def compute_code_hash(*modules: str) -> str:
    """SHA-256 of the import closure of modules of glossbench, and of the versions of the libraries in `COMPUTING`."""
    closure = source_tree.GLOSSBENCH.find_closure(map(ImportedName, modules))
    return hashlib.sha256(" ".join([hash_of(closure), *map(version, COMPUTING)]).encode()).hexdigest()


def compute_source_hash(cls: type) -> str:
    """SHA-256 of the source of a class and its bases: of their modules, and of all that these import.

    The imports of a plug-in count if they are not installed or if they belong to glossbench: see `find_source_files`. A
    class without a file, such as one from a notebook, gets a new hash in each process, so its cells are never reused.
    """
    files: dict[str, Path] = {}
    for base in cls.__mro__:
        top = base.__module__.partition(".")[0]
        if top in sys.stdlib_module_names or (top == "glossbench" and base.__module__ in files):
            continue
        file = getattr(sys.modules.get(base.__module__), "__file__", None)
        if file is None or not Path(file).is_file():
            return _without_source(base)
        files |= find_source_files(base.__module__, Path(file))
    return hash_of(files)


@cache
def _without_source(cls: type) -> str:
    return f"no source {uuid4().hex}"


def read_version() -> str:
    """Version of the installed package."""
    try:
        return version("glossbench")
    except metadata.PackageNotFoundError:
        return "not installed"


def collect_system_information() -> dict[str, Any]:
    """Versions and hardware, for reports and for bug reports."""
    names = (
        "numpy",
        "scipy",
        "torch",
        "scikit-image",
        "matplotlib",
        "OpenEXR",
        "OpenImageIO",
        "pydantic",
        "pandas",
    )
    return {
        "glossbench": read_version(),
        "python": platform.python_version(),
        **{name.lower(): version(name) for name in names},
        "platform": platform.platform(terse=True),
        "processor": read_processor(),
        "cores": os.cpu_count(),
        "threads": torch.get_num_threads(),
        "cuda": torch.cuda.get_device_name() if torch.cuda.is_available() else "none",
    }


@cache
def read_processor() -> str:
    """The processor's name, as reported by the system."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def collect_provenance(
    device: str, started: datetime, source: str, plugins: Mapping[str, str] = MappingProxyType({})
) -> dict[str, Any]:
    """The origin of results.

    Args:
        source: hash of the code that measured them.
        plugins: the file of each plug-in, by name.
    """
    return {
        **collect_system_information(),
        "device": device,
        "started": started.isoformat(timespec="seconds"),
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": " ".join(["glossbench", *sys.argv[1:]]) if Path(sys.argv[0]).name == "glossbench" else "Python",
        "source_hash": source,
        **({"plugins": dict(plugins)} if plugins else {}),
    }
