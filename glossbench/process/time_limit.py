"""A time limit for some work: Python code is interrupted; if that fails, the process ends."""

import faulthandler
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

GRACE = 2.0  # seconds in which interrupted work must end
SOON = 0.02  # seconds after which an import that is under way is looked at again
_IMPORTER = "<frozen importlib._bootstrap>"  # the file that its frames name


@contextmanager
def time_limit(seconds: float, give_up: Callable[[], None]) -> Iterator[None]:
    """Raise TimeoutError in the block after `seconds`, or end the process if the block continues.

    The alarm signal interrupts Python code in the main thread. It does not interrupt native code, other threads and
    some systems do not have it, and the work may catch the error. Therefore, after another GRACE seconds, a second
    thread calls `give_up` and ends the process with exit code 1. If native code does not let that thread run, the
    process ends after another GRACE seconds, with a traceback and without `give_up`.
    """
    done = threading.Event()

    def watch() -> None:
        if not done.wait(seconds + GRACE):
            try:
                give_up()
            finally:
                os._exit(1)

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    if sys.__stderr__ is not None:
        faulthandler.dump_traceback_later(seconds + 2 * GRACE, exit=True, file=sys.__stderr__)
    try:
        with alarm(seconds):
            yield
    finally:
        done.set()
        watcher.join()  # a thread that was started among plug-ins must not look like one of theirs (leftovers.leave)
        faulthandler.cancel_dump_traceback_later()


@contextmanager
def alarm(seconds: float) -> Iterator[None]:
    """Raise TimeoutError in Python code of the block after `seconds`; not in other threads, nor on some systems.

    An import that is under way ends first: of a module that is half-made, parts would stay, and the next import fail.
    """
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return
    n_imports = count_imports(sys._getframe())

    def interrupt(_: int, frame: FrameType | None) -> None:
        if count_imports(frame) > n_imports:
            signal.setitimer(signal.ITIMER_REAL, SOON)
        else:
            raise TimeoutError(f"took more than the time limit of {seconds:g} s")

    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        signal.setitimer(signal.ITIMER_REAL, seconds)
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def count_imports(frame: FrameType | None) -> int:
    """How many frames of Python's importer are on a stack."""
    n = 0
    while frame is not None:
        n += frame.f_code.co_filename == _IMPORTER
        frame = frame.f_back
    return n
