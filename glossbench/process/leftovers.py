"""Threads and processes that plug-ins leave running, and that would keep this process from ending."""

import os
import signal
import sys
import threading
from contextlib import suppress
from pathlib import Path


def leave(code: object) -> None:
    """End the process if threads of plug-ins would keep it alive, such as those of a pool; otherwise do nothing."""
    if any("is_of_plugin" in vars(thread) for thread in threading.enumerate()):
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError, AttributeError):
                stream.flush()
        os._exit(code if isinstance(code, int) else 0 if code is None else 1)


def find_children() -> set[int]:
    """Ids of the processes that this one has started; empty if the system does not list them."""
    found = set()
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError, ValueError, IndexError):
            # The name of the program, in parentheses, may contain any character.
            if int(path.read_text(errors="replace").rpartition(")")[2].split()[1]) == os.getpid():
                found.add(int(path.parent.name))
    return found


def end_children(but: set[int]) -> None:
    """End the processes that this one has started, except those in `but`, torch's compilers and multiprocessing's
    tracker, which ends with this process; without it the next process that starts others says that it died.
    """
    for pid in find_children() - but:
        with suppress(OSError):
            command = Path(f"/proc/{pid}/cmdline").read_bytes()
            if b"_inductor" not in command and b"resource_tracker" not in command:
                os.kill(pid, signal.SIGKILL)
                os.waitpid(pid, 0)
