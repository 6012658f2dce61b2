"""Compiling kernels, each in a process of its own."""

import logging
import os
import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, lru_cache
from pathlib import Path
from typing import NamedTuple

from torch import Tensor

from glossbench.shading.kernels import artefacts
from glossbench.shading.kernels.arguments import Form
from glossbench.shading.kernels.artefacts import COMPILER, Artefact
from glossbench.shading.kernels.kernel import Kernel
from glossbench.shading.kernels.programs import Part

SECONDS = 25.0  # of a compilation, if none has been measured
PATIENCE = 3600.0  # seconds after which a compilation has failed; on a busy machine it takes many minutes
failed: set[str] = set()  # keys of kernels that this process could not compile
_log = logging.getLogger("glossbench")


class Call(NamedTuple):
    """A kernel and its arguments.

    Attributes:
        form: form of its arguments.
        tensors: tensors of its arguments.
        pairs: number of points times samples of all calls with such arguments.
        key: key of the compiled program.
        part: which part of the kernel the program is.
    """

    kernel: Kernel
    form: Form
    tensors: Sequence[Tensor]
    pairs: int
    key: str
    part: Part = "whole"

    @property
    def is_on_cpu(self) -> bool:
        """Whether all tensors are in main memory."""
        return all(t.device.type == "cpu" for t in self.tensors)


def compile_seconds() -> float:
    """Processor seconds that a compilation takes: the mean of those in the cache."""
    return _mean_seconds(*artefacts.state())


@lru_cache(maxsize=1)
def _mean_seconds(place: Path, changed: int) -> float:
    found = [artefact.seconds for artefact in artefacts.every()]
    return sum(found) / len(found) if found else SECONDS


@cache
def has_compiler() -> bool:
    """Whether there is a C++ compiler; if there is none, a warning of one line says so."""
    compiler = next((c for c in ("g++", "clang++", "c++", "cl") if shutil.which(c)), None)
    if compiler is None:
        _log.warning("no C++ compiler found: kernels run eagerly, 5 to 10 times slower")
    return compiler is not None


def build_all(calls: Iterable[Call], tell: Callable[[Call], None] = lambda call: None) -> list[Artefact | None]:
    """Compile kernels, one on each core at a time, while `calls` finds the next ones.

    Args:
        tell: called with each that is done.
    """

    def build_one(call: Call) -> Artefact | None:
        artefact = build(call)
        tell(call)
        return artefact

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(build_one, calls))


def build(call: Call) -> Artefact | None:
    """Compile a kernel. If this fails, a warning of one line says so."""
    types = [(t.dtype, tuple(t.shape)) for t in call.tensors]
    request = pickle.dumps(sys.path) + pickle.dumps((call.kernel.place, call.form, types, call.key, call.part))
    why = ""
    try:
        done = subprocess.run(
            [sys.executable, "-c", f"from {COMPILER} import main; main()"],
            input=request, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, timeout=PATIENCE,
        )  # fmt: skip
        why = (done.stderr.decode(errors="replace").strip().splitlines() or [f"exit code {done.returncode}"])[-1]
    except subprocess.TimeoutExpired:
        why = f"it takes more than {PATIENCE:.0f} s"
    artefact = artefacts.find(call.key, call.tensors)
    if artefact is None:
        failed.add(call.key)
        _log.warning("%s is not compiled and runs eagerly: %s", call.kernel.name, why)
    return artefact
