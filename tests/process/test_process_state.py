"""What a plug-in changes of the process is put back."""

import ctypes
import json
import locale
import os
import random
import signal
import subprocess
import sys
import threading
import time
import warnings
from contextlib import suppress
from pathlib import Path, PurePath

import numpy as np
import OpenEXR
import pyarrow.parquet
import pytest
import torch
from PIL import Image
from torch.overrides import TorchFunctionMode

from glossbench.digests import compute_digest
from glossbench.process.state import ProcessRestorer
from glossbench.process.time_limit import time_limit
from glossbench.shading.costs import Timing, time_work
from glossbench.shading.method import METHODS, Method

KEPT: list[object] = []


def mode_of_files() -> int:
    """Which permissions new files lack."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


def infer() -> None:
    """Enter inference mode, and never leave it."""
    KEPT.append(torch.inference_mode())
    KEPT[-1].__enter__()


class Zero(TorchFunctionMode):
    """All that torch computes is zero."""

    def __torch_function__(self, func, types, args=(), kwargs=None):
        return func(*args, **(kwargs or {})) * 0 if func is torch.Tensor.mul else func(*args, **(kwargs or {}))


CHANGES = {
    "the working folder": (os.getcwd, lambda: os.chdir("/")),
    "a function of json": (lambda: json.dumps, lambda: setattr(json, "dumps", None)),
    "a function that is gone": (lambda: vars(os).get("replace"), lambda: delattr(os, "replace")),
    "a builtin": (lambda: open, lambda: setattr(__import__("builtins"), "open", None)),
    "a member of this package": (lambda: Method.supports, lambda: setattr(Method, "supports", None)),
    "a method of tensors": (lambda: torch.Tensor.mean, lambda: setattr(torch.Tensor, "mean", None)),
    "a library that writes tables": (
        lambda: pyarrow.parquet.write_table, lambda: setattr(pyarrow.parquet, "write_table", None),
    ),
    "the recursion limit": (sys.getrecursionlimit, lambda: sys.setrecursionlimit(200)),
    "standard output": (lambda: sys.stdout, lambda: setattr(sys, "stdout", None)),
    "the environment": (lambda: os.environ.get("HOME"), lambda: os.environ.clear()),
    "what an interrupt does": (
        lambda: signal.getsignal(signal.SIGINT), lambda: signal.signal(signal.SIGINT, lambda *_: None),
    ),
    "blocked signals": (
        lambda: signal.pthread_sigmask(signal.SIG_BLOCK, []),
        lambda: signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGUSR1]),
    ),
    "the mode of new files": (mode_of_files, lambda: os.umask(0o777)),
    "the locale": (lambda: locale.setlocale(locale.LC_ALL), lambda: locale.setlocale(locale.LC_ALL, "POSIX")),
    "warnings": (lambda: list(warnings.filters), lambda: warnings.simplefilter("ignore")),
    "random": (random.getstate, lambda: random.seed(5)),
    "numpy's generator": (lambda: np.random.get_state()[1].tolist(), lambda: np.random.seed(5)),  # noqa: NPY002
    "numpy's errors": (np.geterr, lambda: np.seterr(all="raise")),
    "torch's generator": (lambda: torch.get_rng_state().tolist(), lambda: torch.manual_seed(5)),
    "torch's type": (torch.get_default_dtype, lambda: torch.set_default_dtype(torch.float64)),
    "torch's device": (torch.get_default_device, lambda: torch.set_default_device("meta")),
    "torch's gradients": (torch.is_grad_enabled, lambda: torch.set_grad_enabled(not torch.is_grad_enabled())),
    "torch's inference mode": (torch.is_inference_mode_enabled, infer),
    "a function mode of torch": (lambda: float(torch.ones(1).mul(2)), lambda: Zero().__enter__()),
    "how numbers are rounded": (lambda: sum([1.0, 2.0**-60]), lambda: ctypes.CDLL("libm.so.6").fesetround(0x800)),
    "a timer": (lambda: signal.getitimer(signal.ITIMER_PROF), lambda: signal.setitimer(signal.ITIMER_PROF, 1000)),
    "a module that is gone": (lambda: sys.modules.get("json.encoder"), lambda: sys.modules.pop("json.encoder")),
    "a registered name that is gone": (lambda: sorted(METHODS._classes), lambda: METHODS._classes.clear()),
    "a method of paths": (lambda: Path("a") / "b", lambda: setattr(PurePath, "__truediv__", lambda *_: None)),
    "a library of images": (lambda: OpenEXR.File, lambda: setattr(OpenEXR, "File", None)),
    "a method of a library's class": (lambda: Image.Image.save, lambda: setattr(Image.Image, "save", None)),
    "torch's threads": (torch.get_num_threads, lambda: torch.set_num_threads(torch.get_num_threads() + 1)),
}  # fmt: skip


@pytest.mark.parametrize("what", CHANGES)
def test_what_is_changed_is_put_back(what):
    read, change = CHANGES[what]
    before = read()

    with ProcessRestorer("mine"):
        change()
        changed = read() != before if what != "a builtin" else True

    assert read() == before
    assert changed or what == "the locale"  # which may be that already


def test_it_is_put_back_where_the_block_raises():
    before = os.getcwd()

    with suppress(ValueError), ProcessRestorer("mine"):
        os.chdir("/")
        raise ValueError

    assert os.getcwd() == before


def test_threads_that_are_left_do_not_keep_the_process_alive():
    stop = threading.Event()
    with ProcessRestorer("mine"):
        thread = threading.Thread(target=stop.wait, daemon=False)
        thread.start()

    assert thread.daemon
    other = threading.Thread(target=stop.wait)
    other.start()
    stop.set()
    assert not other.daemon


def test_the_watch_over_a_time_limit_is_not_left():
    """A command that ended right after the block took such a thread for one of the plug-in."""
    for _ in range(50):
        with ProcessRestorer("mine"), time_limit(60, lambda: None):
            pass

        assert not [thread for thread in threading.enumerate() if "is_of_plugin" in vars(thread)]


LEFT = """
import os, subprocess, sys, threading, time
from concurrent.futures import ThreadPoolExecutor
from glossbench.process.leftovers import find_children, end_children, leave
from glossbench.process.state import ProcessRestorer
from glossbench.process.time_limit import time_limit
running = find_children()
with ProcessRestorer("mine"):
    ThreadPoolExecutor().submit(time.sleep, 1000)
    threading.Thread(target=time.sleep, args=(1000,)).start()
    child = subprocess.Popen(["sleep", "1000"])
    if os.fork() == 0:
        time.sleep(0.1)
    else:
        sys.stdout.close()
        os.close(2)
end_children(but=running)
print("on output")
print("on error", file=sys.stderr)
print(len(find_children() - running))
leave(7)
"""


def test_a_process_with_all_of_it_ends_with_its_code_and_its_streams():
    started = time.monotonic()

    done = subprocess.run([sys.executable, "-c", LEFT], capture_output=True, text=True, timeout=100)

    assert done.stdout == "on output\n0\n"
    assert done.stderr == "on error\n"
    assert done.returncode == 7
    assert time.monotonic() - started < 90


STARTED_TWICE = """
import multiprocessing, os
from glossbench.process.leftovers import find_children, end_children
if __name__ == "__main__":
    for _ in range(2):
        running = find_children()
        worker = multiprocessing.get_context("spawn").Process(target=os.getpid)
        worker.start()
        worker.join()
        end_children(but=running)
"""


def test_a_process_may_start_others_after_its_children_were_ended(tmp_path):
    (tmp_path / "twice.py").write_text(STARTED_TWICE)

    done = subprocess.run([sys.executable, tmp_path / "twice.py"], capture_output=True, text=True, timeout=100)

    assert (done.returncode, done.stderr) == (0, "")


def test_bytes_written_through_numpy_change_the_digest():
    tensor = torch.zeros(4)
    value = {"a": (tensor, np.zeros(3)), "b": [None, "text"]}
    before = compute_digest(value)

    assert compute_digest(value) == before
    tensor.numpy()[1] = 1
    assert compute_digest(value) != before
    tensor.numpy()[1] = 0
    value["a"][1][2] = 1
    assert compute_digest(value) != before


def test_a_time_is_the_median_of_several_runs_with_the_fastest_and_the_slowest():
    seconds = iter([0.0, 0.03, 0.06, 0.0, 0.03, 0.03, 0.03, 0.03])

    _, timing = time_work(lambda: time.sleep(next(seconds)))

    assert timing.runs >= 3
    assert 0.03 <= timing.median < 0.06 <= timing.high
    assert timing.low < 0.03
    assert 0 <= timing.busy <= 1


def test_without_patience_work_runs_once():
    calls = []

    _, timing = time_work(lambda: calls.append(1), patience=0)

    assert (len(calls), timing.runs) == (1, 1)
    assert timing.low == timing.median == timing.high
    assert np.isnan(Timing().median)
