"""Compiling kernels, each in a process of its own."""

import logging
import os
import pickle
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache, lru_cache
from pathlib import Path
from threading import Lock
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

    If it is interrupted, it ends the compilers that run and begins no other.

    Args:
        tell: called with each that is done.
    """
    processes = _Processes()

    def build_one(call: Call) -> Artefact | None:
        artefact = build(call, processes)
        tell(call)
        return artefact

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        try:
            return list(pool.map(build_one, calls))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            processes.end()
            raise


class _Processes:
    """Compilers, each in a group of its own with the programs that it calls, which end together."""

    def __init__(self) -> None:
        self.have_ended = False
        self._lock = Lock()
        self._every: list[subprocess.Popen[bytes]] = []

    def add(self, process: "subprocess.Popen[bytes]") -> None:
        with self._lock:
            self._every.append(process)
            if self.have_ended:
                _end(process)

    def end(self) -> None:
        with self._lock:
            self.have_ended = True
            for process in self._every:
                _end(process)


def _end(process: "subprocess.Popen[bytes]") -> None:
    if process.poll() is None:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGTERM) if hasattr(os, "killpg") else process.kill()


def build(call: Call, processes: _Processes | None = None) -> Artefact | None:
    """Compile a kernel. If this fails, a warning of one line says so.

    Args:
        processes: those with which its compiler ends.
    """
    processes = processes or _Processes()
    types = [(t.dtype, tuple(t.shape)) for t in call.tensors]
    request = pickle.dumps(sys.path) + pickle.dumps((call.kernel.place, call.form, types, call.key, call.part))
    why = ""
    try:
        with subprocess.Popen(
            [sys.executable, "-c", f"from {COMPILER} import main; main()"],
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True,
        ) as process:  # fmt: skip
            processes.add(process)
            try:
                _, told = process.communicate(request, PATIENCE)
            finally:
                _end(process)
        why = (told.decode(errors="replace").strip().splitlines() or [f"exit code {process.returncode}"])[-1]
    except subprocess.TimeoutExpired:
        why = f"it takes more than {PATIENCE:.0f} s"
    artefact = artefacts.find(call.key, call.tensors)
    if artefact is None and not processes.have_ended:
        failed.add(call.key)
        _log.warning("%s is not compiled and runs eagerly: %s", call.kernel.name, why)
    return artefact
