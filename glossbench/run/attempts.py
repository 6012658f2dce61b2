"""Cells that were begun: what ends the process in mid-cell is tried again, last of all, and passed over in the end."""

import json
import os
import socket
from contextlib import suppress
from pathlib import Path
from typing import Any

TRIES = 2  # of a plug-in: one end may have been the user's, or another program's hunger for memory
OUR_TRIES = 5  # of what no plug-in takes part in: somebody else who ends the process is more likely


class Attempt:
    """A mark in the folder of results while some work goes on, which stays where the process ends meanwhile.

    Args:
        folder: of the marks.
        key: of the work.
        tries: how often it may end the process before it is passed over.
    """

    def __init__(self, folder: Path, key: str, tries: int = TRIES) -> None:
        self._path = folder / f"{key}.begun"
        self._tries = tries
        self._is_ours = False
        self.ended = self._before()

    def _before(self) -> int:
        """How often the process ended in this work; 0 where another run is still at it."""
        try:
            mark = json.loads(self._path.read_text(encoding="utf-8"))
            times, host, pid = int(mark["times"]), str(mark["host"]), int(mark["pid"])
        except (FileNotFoundError, NotADirectoryError):
            return 0
        except (OSError, ValueError, KeyError, TypeError):  # half-written: the process ended just then
            return 1
        return 0 if host == socket.gethostname() and pid != os.getpid() and _is_alive(pid) else times

    @property
    def is_hopeless(self) -> bool:
        """Whether it ended the process so often that it is passed over."""
        return self.ended >= self._tries

    @property
    def told(self) -> str:
        """Why it is passed over."""
        return f"the process ended {self.ended} times in here, killed or for want of memory: passed over"

    def begin(self) -> None:
        """Leave the mark."""
        if not self._is_ours:
            self._is_ours = True
            mark: dict[str, Any] = {"times": self.ended + 1, "host": socket.gethostname(), "pid": os.getpid()}
            self._path.parent.mkdir(exist_ok=True)
            self._path.write_text(json.dumps(mark), encoding="utf-8")

    def end(self) -> None:
        """Remove the mark: the work has ended, well or not, and this process has not."""
        if self._is_ours or self.ended:
            self._path.unlink(missing_ok=True)
            with suppress(OSError):  # other marks are there
                self._path.parent.rmdir()


def _is_alive(pid: int) -> bool:
    if os.name != "posix" or pid <= 0:
        return False
    try:
        os.kill(pid, 0)
    except PermissionError:
        return True
    except (OSError, OverflowError):
        return False
    return True


def remove_marks(folder: Path) -> None:
    """Remove the marks of this process, which is about to end by its own will."""
    for path in folder.glob("*.begun"):
        with suppress(OSError, ValueError, KeyError, TypeError):
            if json.loads(path.read_text(encoding="utf-8"))["pid"] == os.getpid():
                path.unlink()
    with suppress(OSError):
        folder.rmdir()
