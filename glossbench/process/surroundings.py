"""The state of the process around a call: numbers do not depend on it, and a call does not change it.

torch and numpy have switches for the whole process or for a thread: the default type and device, autocast, the action
at an overflow. The public functions run with the values of a new process, whatever the caller has set.
"""

import ctypes
import os
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch


class Switch(NamedTuple):
    """A switch of the whole process: the value under which numbers are computed, and functions to read and set it."""

    ours: Any
    read: Callable[[], Any]
    set: Callable[[Any], None]


def _set_determinism(mode: tuple[bool, bool]) -> None:
    torch.use_deterministic_algorithms(mode[0], warn_only=mode[1])


SWITCHES = (
    Switch(torch.float32, torch.get_default_dtype, torch.set_default_dtype),
    Switch("highest", torch.get_float32_matmul_precision, torch.set_float32_matmul_precision),
    Switch(
        (False, False),
        lambda: (torch.are_deterministic_algorithms_enabled(), torch.is_deterministic_algorithms_warn_only_enabled()),
        _set_determinism,
    ),
)
NUMPY = {"divide": "warn", "over": "warn", "under": "ignore", "invalid": "warn"}


class _SwitchHolder:
    """The switches of the process: the first thread to enter a call sets them, the last one to leave restores them."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.n_threads = 0
        self.found: list[tuple[Switch, Any]] = []

    def take(self) -> None:
        with self.lock:
            self.n_threads += 1
            if self.n_threads == 1:
                self.found = [(switch, value) for switch in SWITCHES if (value := switch.read()) != switch.ours]
                for switch, _ in self.found:
                    switch.set(switch.ours)

    def leave(self) -> None:
        with self.lock:
            self.n_threads -= 1
            if self.n_threads == 0:
                for switch, value in self.found:
                    switch.set(value)
                self.found = []


_held = _SwitchHolder()
_this_thread = threading.local()
_has_computed = False


@contextmanager
def settled() -> Iterator[None]:
    """The block, or the decorated function, runs with the state of a new process; then the old state returns.

    During the block, other threads also see the changed switches of the whole process.
    """
    if getattr(_this_thread, "is_within", False):
        yield
        return
    global _has_computed
    _has_computed = _this_thread.is_within = True
    try:
        _held.take()
        try:
            with ExitStack() as stack:
                if torch.get_default_device().type != "cpu":
                    stack.enter_context(torch.device("cpu"))
                if torch.is_inference_mode_enabled():  # tensors kept for later calls could not be used outside it
                    stack.enter_context(torch.inference_mode(False))
                if not torch.is_grad_enabled():
                    stack.enter_context(torch.enable_grad())
                for device in ("cpu", "cuda"):
                    if torch.is_autocast_enabled(device):
                        stack.enter_context(torch.autocast(device, enabled=False))
                if np.geterr() != NUMPY:
                    stack.enter_context(np.errstate(**NUMPY))  # type: ignore[arg-type]
                yield
        finally:
            _held.leave()
    finally:
        _this_thread.is_within = False


def _reset_forked_child() -> None:
    """In a forked child, restore the switches that threads of the parent have set, and compute with one thread.

    The threads of the parent do not exist in the child. OpenMP's threads do not survive a fork either, so work given to
    them would never end. torch and FLIP each have their own OpenMP library; both are set to one thread.
    """
    global _held
    if not _has_computed:
        return
    left, _held = _held, _SwitchHolder()
    if getattr(_this_thread, "is_within", False):
        _held.n_threads, _held.found = 1, left.found
    else:
        for switch, value in left.found:
            switch.set(value)
    torch.set_num_threads(1)
    with suppress(OSError, AttributeError):  # other systems than Linux do not fork by default
        for path in dict.fromkeys(
            re.findall(r"/\S*/lib(?:g|i|)omp\S*", os.fsdecode(Path("/proc/self/maps").read_bytes()))
        ):
            ctypes.CDLL(path).omp_set_num_threads(1)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_reset_forked_child)
