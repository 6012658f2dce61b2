"""Provenance: the versions, the source and the machine that results come from."""

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

from glossbench.import_closure import hash_of, local_files

version = cache(metadata.version)  # which reads a file

# What decides the numbers: a change of any of these files makes every cell new.
NUMERICS = (
    "brdf", "envmap", "scene", "metrics", "shading", "truth", "prefilter", "channels.py", "directions.py",
    "factorization.py", "options.py", "run/measuring.py", "run/tuning.py", "process/surroundings.py",
)  # fmt: skip


@cache
def numerics_hash() -> str:
    """SHA-256 of the source that decides the numbers, and of the versions of what computes and decodes them."""
    names = ("scipy", "scikit-image", "flip-evaluator", "OpenImageIO", "trimesh", "embreex")
    versions = [torch.__version__, *map(version, names)]
    digest = hashlib.sha256(" ".join(versions).encode())
    package = Path(__file__).parent
    for part in NUMERICS:
        for path in sorted((package / part).rglob("*.py")) if (package / part).is_dir() else [package / part]:
            digest.update(path.read_bytes())
    return digest.hexdigest()


def source_hash(cls: type) -> str:
    """SHA-256 of the source of a class and its bases; of a plug-in's, of its package and of all that it imports.

    What it imports counts where it is not installed: see `local_files`. A class without a file, as of a notebook,
    hashes to something new each time: its cells are never taken for others.
    """
    digest = hashlib.sha256()
    for base in cls.__mro__:
        if base.__module__ == "builtins":
            continue
        file = getattr(sys.modules.get(base.__module__), "__file__", None)
        if file is None or not Path(file).is_file():
            return f"no source {uuid4().hex}"
        package = base.__module__.partition(".")[0]
        if package == "glossbench" or package in sys.stdlib_module_names:
            digest.update(Path(file).read_bytes())
            continue
        digest.update(hash_of(local_files(base.__module__, Path(file))).encode())
    return digest.hexdigest()


def glossbench_version() -> str:
    """Version of the installed package."""
    try:
        return version("glossbench")
    except metadata.PackageNotFoundError:
        return "not installed"


def system_information() -> dict[str, Any]:
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
        "glossbench": glossbench_version(),
        "python": platform.python_version(),
        **{name.lower(): version(name) for name in names},
        "platform": platform.platform(terse=True),
        "processor": processor(),
        "cores": os.cpu_count(),
        "threads": torch.get_num_threads(),
        "cuda": torch.cuda.get_device_name() if torch.cuda.is_available() else "none",
    }


@cache
def processor() -> str:
    """The processor's name, as the system tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def provenance(device: str, started: datetime, plugins: Mapping[str, str] = MappingProxyType({})) -> dict[str, Any]:
    """Where results come from; of plug-ins, the file of each."""
    return {
        **system_information(),
        "device": device,
        "started": started.isoformat(timespec="seconds"),
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": " ".join(["glossbench", *sys.argv[1:]]) if Path(sys.argv[0]).name == "glossbench" else "Python",
        "source_hash": numerics_hash(),
        **({"plugins": dict(plugins)} if plugins else {}),
    }
