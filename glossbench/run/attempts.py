"""Marks of cells that have begun. A cell that ends the process is tried again last, and passed over in the end."""

import json
import os
import socket
from contextlib import suppress
from typing import Any

from glossbench.errors import InputError
from glossbench.run.store import Store

FOLDER = "begun"  # of the marks
TRIES = 2  # with a plug-in: the user, or another program that took the memory, may have ended the process once
OUR_TRIES = 5  # without a plug-in: it is more likely that something else ended the process


class Attempt:
    """A mark in the store of the results while some work is done; it stays if the process ends during the work.

    Args:
        store: where the results lie.
        key: the key of the work.
        tries: how often the work may end the process before it is passed over.
        marks: the names in the folder of marks, if they are known: what is not there is not read.
    """

    def __init__(self, store: Store, key: str, tries: int = TRIES, marks: frozenset[str] | None = None) -> None:
        self._store, self._name = store, f"{FOLDER}/{key}.begun"
        self._tries = tries
        self._is_ours = False
        self.ended = self._count_before() if marks is None or self._name in marks else 0

    def _count_before(self) -> int:
        """How often the process ended during this work; 0 if another run is doing it now."""
        try:
            mark = json.loads(self._store.get(self._name))
            times, host, pid = int(mark["times"]), str(mark["host"]), int(mark["pid"])
        except (FileNotFoundError, NotADirectoryError):
            return 0
        except InputError:
            raise
        except (OSError, ValueError, KeyError, TypeError):  # half-written, because the process ended during the write
            return 1
        return 0 if host == socket.gethostname() and pid != os.getpid() and is_alive(pid) else times

    @property
    def is_hopeless(self) -> bool:
        """Whether the work ended the process so often that it is passed over."""
        return self.ended >= self._tries

    @property
    def told(self) -> str:
        """Why the work is passed over."""
        return f"the process ended {self.ended} times here, killed or out of memory: skipped"

    def begin(self) -> None:
        """Write the mark."""
        if not self._is_ours:
            self._is_ours = True
            mark: dict[str, Any] = {"times": self.ended + 1, "host": socket.gethostname(), "pid": os.getpid()}
            self._store.put(self._name, json.dumps(mark).encode(), lasts=False)

    def end(self) -> None:
        """Remove the mark: the work has ended, with or without success, and the process still runs."""
        if self._is_ours or self.ended:
            self._store.remove(self._name)


def is_alive(pid: int) -> bool:
    if os.name != "posix" or pid <= 0:
        return False
    try:
        os.kill(pid, 0)
    except PermissionError:
        return True
    except (OSError, OverflowError):
        return False
    return True


def remove_marks(store: Store) -> None:
    """Remove the marks of this process, which is about to end itself."""
    for name in store.list(f"{FOLDER}/"):
        with suppress(OSError, ValueError, KeyError, TypeError):
            mark = json.loads(store.get(name))
            if (mark["host"], mark["pid"]) == (socket.gethostname(), os.getpid()):
                store.remove(name)
    store.prune(FOLDER)
