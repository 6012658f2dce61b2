"""Files that appear whole or not at all."""

import os
import re
import signal
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path
from threading import current_thread, main_thread
from uuid import uuid4

from glossbench.errors import CannotWrite

ABANDONED = 86_400.0  # seconds without a change after which a half-written file has no writer, wherever that was
_PART = re.compile(r"\.glossbench-([0-9a-f]{12})-(\d{1,10})-[0-9a-f]{32}(\.\w{1,8})?")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path to write to, that takes the place of `path` when all went well: never a half-written file.

    What was written is on the disk before it bears its name, so that a loss of power leaves the old file or the new.
    Signals that ask a process to end are KeyboardInterrupts meanwhile, and leave no half-written file.

    Raises:
        CannotWrite: a full disk, a folder that is gone or cannot be written.
    """
    # As short for every name, and with its ending, by which writers know a format.
    ending = path.suffix if re.fullmatch(r"\.\w{1,8}", path.suffix, re.ASCII) else ""
    part = path.with_name(f".glossbench-{_here()}-{os.getpid()}-{uuid4().hex}{ending}")
    try:
        with interrupted_when_asked():
            yield part
        _to_disk(part)
        os.replace(part, path)
        with suppress(OSError):  # some systems open no folders
            _to_disk(path.parent)
    except OSError as error:
        raise CannotWrite(path, error.strerror or str(error)) from error
    finally:
        with suppress(OSError):  # what was wrong is said already
            part.unlink(missing_ok=True)


@contextmanager
def interrupted_when_asked() -> Iterator[None]:
    """SIGTERM, and SIGHUP of a closed terminal, raise KeyboardInterrupt in the block where nobody else handles them."""
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
    """Remove what killed writers left half-written in a folder, not below it; never what another still writes."""
    for part in folder.iterdir():
        if _is_abandoned(part):
            part.unlink(missing_ok=True)


def _is_abandoned(part: Path) -> bool:
    """Whether it is one of ours, half-written, and its writer is no more: a dead process of this machine, or long ago.

    A process of another machine or container cannot be seen from here.
    """
    name = _PART.fullmatch(part.name)
    if name is None or part.is_symlink() or not part.is_file():
        return False
    with suppress(OSError):
        if time.time() - part.stat().st_mtime > ABANDONED:
            return True
    if os.name != "posix" or name[1] != _here():
        return False
    try:
        os.kill(int(name[2]), 0)
    except ProcessLookupError:
        return True
    except (PermissionError, OverflowError):
        return False
    return False


def _here() -> str:
    """Where process ids are those of this process: the machine since it started, and the container."""
    known = [socket.gethostname()]
    with suppress(OSError):  # what other systems do not have
        known.append(Path("/proc/sys/kernel/random/boot_id").read_text())
        known.append(os.readlink("/proc/self/ns/pid"))
    return sha256(" ".join(known).encode()).hexdigest()[:12]


def _to_disk(path: Path) -> None:
    opened = os.open(path, os.O_RDONLY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)
