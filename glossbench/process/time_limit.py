"""A limit on the seconds of some work: Python's own code is interrupted, and where that fails the process ends."""

import faulthandler
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

GRACE = 2.0  # seconds that interrupted work has to end


@contextmanager
def time_limit(seconds: float, give_up: Callable[[], None]) -> Iterator[None]:
    """Raises TimeoutError in the block once it has lasted `seconds`, or ends the process if the block lasts on.

    The alarm signal reaches Python's own code in the main thread. Native code does not heed it, other threads and
    some systems have none, and work may swallow what is raised in it: after GRACE another thread calls `give_up`
    and ends the process with exit code 1. Native code that lets no other thread run is ended after GRACE once more,
    with a traceback and without `give_up`.
    """
    done = threading.Event()

    def watch() -> None:
        if not done.wait(seconds + GRACE):
            try:
                give_up()
            finally:
                os._exit(1)

    has_alarm = hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGALRM, lambda *_: _interrupt(seconds)) if has_alarm else None
    threading.Thread(target=watch, daemon=True).start()
    if sys.__stderr__ is not None:
        faulthandler.dump_traceback_later(seconds + 2 * GRACE, exit=True, file=sys.__stderr__)
    try:
        if has_alarm:
            signal.setitimer(signal.ITIMER_REAL, seconds)
        yield
    finally:
        if has_alarm:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)
        done.set()
        faulthandler.cancel_dump_traceback_later()


def _interrupt(seconds: float) -> None:
    raise TimeoutError(f"took more than the time limit of {seconds:g} s")
