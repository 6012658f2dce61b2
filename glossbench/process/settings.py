"""Settings that a whole process shares, each with a function that reads it and one that restores it."""

import ctypes
import gc
import locale
import logging
import os
import random
import signal
import sys
import threading
import warnings
from collections.abc import Callable
from contextlib import suppress
from operator import sub
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import overrides
from torch.utils import _python_dispatch

_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGALRM", "SIGHUP", "SIGPIPE", "SIGCHLD")
                 if hasattr(signal, name))  # fmt: skip


def _put_environment(before: dict[str, str]) -> None:
    os.environ.clear()
    os.environ.update(before)


def _read_umask() -> int:
    now = os.umask(0o077)
    os.umask(now)
    return now


def _read_handlers() -> dict[int, Any]:
    """Handlers of the signals that end a process; empty in a thread that cannot change them."""
    if threading.current_thread() is not threading.main_thread():
        return {}
    return {number: signal.getsignal(number) for number in _SIGNALS}


def _put_handlers(before: dict[int, Any]) -> None:
    for number, handler in before.items():
        if handler is not None:
            signal.signal(number, handler)


def _read_blocked() -> set[int]:
    return set(signal.pthread_sigmask(signal.SIG_BLOCK, [])) if hasattr(signal, "pthread_sigmask") else set()


def _read_limits() -> dict[int, tuple[int, int]]:
    try:
        import resource
    except ImportError:  # this system does not have it
        return {}
    names = ("RLIMIT_AS", "RLIMIT_CPU", "RLIMIT_DATA", "RLIMIT_FSIZE", "RLIMIT_NOFILE", "RLIMIT_STACK")
    return {getattr(resource, name): resource.getrlimit(getattr(resource, name)) for name in names}


def _put_limits(before: dict[int, tuple[int, int]]) -> None:
    import resource

    for number, limits in before.items():
        resource.setrlimit(number, limits)


def _put_filters(before: list[Any]) -> None:
    warnings.filters[:] = before  # type: ignore[index]


def _read_logging() -> tuple[int, list[logging.Handler], int]:
    root = logging.getLogger()
    return root.level, list(root.handlers), logging.root.manager.disable


def _put_logging(before: tuple[int, list[logging.Handler], int]) -> None:
    level, handlers, disabled = before
    logging.getLogger().setLevel(level)
    logging.getLogger().handlers[:] = handlers
    logging.disable(disabled)


def _put_device(before: torch.device) -> None:
    torch.set_default_device(None if before == torch.device("cpu") else before)


def _count_modes() -> tuple[int, int]:
    """The number of open blocks that see all calculations of torch and may change them."""
    return torch._C._len_torch_function_stack(), len(_python_dispatch._get_current_dispatch_mode_stack())


def _put_modes(before: tuple[int, int]) -> None:
    pops: tuple[Callable[[], Any], ...] = overrides._pop_mode, _python_dispatch._pop_mode
    for pop, n in zip(pops, map(sub, _count_modes(), before), strict=True):
        for _ in range(n):
            pop()


def _load_mathematics() -> ctypes.CDLL | None:
    """The C library that reads and sets the rounding mode of the processor."""
    for name in ("libm.so.6", "libm.dylib"):
        with suppress(OSError):
            return ctypes.CDLL(name)
    return None


_MATHEMATICS = _load_mathematics()


def _read_rounding() -> int:
    return int(_MATHEMATICS.fegetround()) if _MATHEMATICS else 0


def _put_rounding(before: int) -> None:
    if _MATHEMATICS:
        _MATHEMATICS.fesetround(before)


_TIMERS = tuple(getattr(signal, name) for name in ("ITIMER_VIRTUAL", "ITIMER_PROF") if hasattr(signal, name))


def _read_timers() -> list[tuple[float, float]]:
    """Timers that count processor time. The timer of the clock belongs to the time limit."""
    return [signal.getitimer(timer) for timer in _TIMERS]


def _put_timers(before: list[tuple[float, float]]) -> None:
    for timer, values in zip(_TIMERS, before, strict=True):
        signal.setitimer(timer, *values)


_ENTERED: list[torch.inference_mode] = []  # keeps the objects alive, because a mode ends with its object


def _put_inference(before: bool) -> None:
    _ENTERED.append(torch.inference_mode(before))
    _ENTERED[-1].__enter__()


def _read_determinism() -> tuple[bool, bool]:
    return torch.are_deterministic_algorithms_enabled(), torch.is_deterministic_algorithms_warn_only_enabled()


def _flushes() -> bool:
    """Whether this processor treats the smallest numbers as zero."""
    smallest = torch.full((1,), 1e-40, dtype=torch.float32, device="cpu")
    return not bool((smallest * torch.ones(1, dtype=torch.float32, device="cpu")).item())


class Setting(NamedTuple):
    """Something that the whole process shares: its name, a function that reads it, and one that restores it."""

    what: str
    get: Callable[[], Any]
    put: Callable[[Any], Any]


SETTINGS = (
    Setting("torch's device", torch.get_default_device, _put_device),
    Setting("torch's modes", _count_modes, _put_modes),  # must precede every setting that computes
    Setting("how numbers are rounded", _read_rounding, _put_rounding),
    Setting("the working folder", os.getcwd, os.chdir),
    Setting("the environment", lambda: dict(os.environ), _put_environment),
    Setting("the locale", lambda: locale.setlocale(locale.LC_ALL), lambda v: locale.setlocale(locale.LC_ALL, v)),
    Setting("the mode of new files", _read_umask, os.umask),
    Setting("signals", _read_handlers, _put_handlers),
    Setting("timers", _read_timers, _put_timers),
    Setting("blocked signals", _read_blocked, lambda v: signal.pthread_sigmask(signal.SIG_SETMASK, v)),
    Setting("limits", _read_limits, _put_limits),
    Setting("tracing", sys.gettrace, sys.settrace),
    Setting("profiling", sys.getprofile, sys.setprofile),
    Setting("the interval of threads", sys.getswitchinterval, sys.setswitchinterval),
    Setting("the garbage collector", gc.isenabled, lambda v: gc.enable() if v else gc.disable()),
    Setting("warnings", lambda: list(warnings.filters), _put_filters),
    Setting("logging", _read_logging, _put_logging),
    Setting("numpy's errors", np.geterr, lambda v: np.seterr(**v)),
    Setting("torch's type", torch.get_default_dtype, torch.set_default_dtype),
    Setting("torch's threads", torch.get_num_threads, torch.set_num_threads),
    Setting("torch's gradients", torch.is_grad_enabled, torch.set_grad_enabled),
    Setting("torch's inference mode", torch.is_inference_mode_enabled, _put_inference),
    Setting("torch's anomalies", torch.is_anomaly_enabled, torch.set_anomaly_enabled),
    Setting(
        "torch's algorithms", _read_determinism, lambda v: torch.use_deterministic_algorithms(v[0], warn_only=v[1])
    ),
    Setting("torch's precision", torch.get_float32_matmul_precision, torch.set_float32_matmul_precision),
    Setting(
        "torch's autocast", lambda: torch.is_autocast_enabled("cpu"), lambda v: torch.set_autocast_enabled("cpu", v)
    ),
    Setting("torch's small numbers", _flushes, torch.set_flush_denormal),
)
# These are always restored: comparing them takes as long as restoring them.
GENERATORS = (
    Setting("random", random.getstate, random.setstate),
    Setting("numpy's generator", np.random.get_state, np.random.set_state),
    Setting("torch's generator", torch.get_rng_state, torch.set_rng_state),
)
