"""Files that are written whole or not at all."""

import os
import re
import signal
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from threading import current_thread, main_thread
from uuid import uuid4

from glossbench.errors import WriteError

ABANDONED = 86_400.0  # seconds without a change after which a half-written file has no writer, on any machine
_PART = re.compile(r"\.glossbench-([0-9a-f]{12})-(\d{1,10})-[0-9a-f]{32}(\.\w{1,8})?")


@contextmanager
def replacing(path: Path, lasts: bool = True) -> Iterator[Path]:
    """A temporary path to write to. It replaces `path` when the block succeeds, so `path` is never half-written.

    The data are on the disk before the file gets its name, so a power failure leaves either the old file or the new.
    Within the block, a signal that asks the process to end raises KeyboardInterrupt, and the temporary file is removed.

    Args:
        lasts: False does not wait for the disk: a power failure soon after may leave a file that is not whole.

    Raises:
        WriteError: the disk is full, or the folder does not exist or cannot be written.
    """
    # The temporary name has the same length for every path. It keeps the ending, from which writers know the format.
    ending = path.suffix if re.fullmatch(r"\.\w{1,8}", path.suffix, re.ASCII) else ""
    part = path.with_name(f".glossbench-{identify_machine()}-{os.getpid()}-{uuid4().hex}{ending}")
    try:
        with interrupted_by_signals():
            yield part
        if lasts:
            _to_disk(part)
        os.replace(part, path)
        if lasts:
            with suppress(OSError):  # some systems cannot open a folder
                _to_disk(path.parent)
    except BaseException as error:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise WriteError(path, error.strerror or str(error)) from error
        raise


@contextmanager
def interrupted_by_signals() -> Iterator[None]:
    """Within the block, SIGTERM and SIGHUP (a closed terminal) raise KeyboardInterrupt, unless they have a handler."""
    ours = []
    if current_thread() is main_thread():
        asking = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
        ours = [number for number in asking if signal.getsignal(number) is signal.SIG_DFL]
    for number in ours:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number in ours:
            signal.signal(number, signal.SIG_DFL)


def remove_abandoned(folder: Path) -> None:
    """Remove half-written files of killed writers from a folder, but not from its subfolders.

    A file that another process still writes stays.
    """
    for part in folder.iterdir():
        if _is_abandoned(part):
            part.unlink(missing_ok=True)


def _is_abandoned(part: Path) -> bool:
    """Whether a path is a half-written file of glossbench whose writer has ended.

    The writer has ended if it was a process of this machine that does not run, or if the file has not changed for
    `ABANDONED` seconds. Processes of other machines and containers cannot be seen from here.
    """
    name = _PART.fullmatch(part.name)
    if name is None or part.is_symlink() or not part.is_file():
        return False
    with suppress(OSError):
        if time.time() - part.stat().st_mtime > ABANDONED:
            return True
    if os.name != "posix" or name[1] != identify_machine():
        return False
    try:
        os.kill(int(name[2]), 0)
    except ProcessLookupError:
        return True
    except (PermissionError, OverflowError):
        return False
    return False


@cache
def identify_machine() -> str:
    """Hash of the place in which process ids are unique: this start of this machine, and this container."""
    known = [socket.gethostname()]
    with suppress(OSError):  # only Linux has these
        known.append(Path("/proc/sys/kernel/random/boot_id").read_text())
        known.append(os.readlink("/proc/self/ns/pid"))
    return sha256(" ".join(known).encode()).hexdigest()[:12]


def _to_disk(path: Path) -> None:
    opened = os.open(path, os.O_RDONLY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)
