"""One run at a time in a store: a second one is refused in one line."""

import json
import os
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any
from uuid import uuid4

from glossbench.atomic import identify_machine
from glossbench.errors import InputError
from glossbench.run.attempts import FOLDER, is_alive
from glossbench.run.store import Store

NAME = f"{FOLDER}/run.json"
BEAT = 4.0  # seconds between two signs of life
PATIENCE = 3 * BEAT


@contextmanager
def reserved(store: Store) -> Iterator[None]:
    """Within the block, the store belongs to this run.

    A record in the store names the process, and is written again every BEAT seconds with a new number. Who finds a
    record watches it: if the number changes, that run lives, and this one is refused. If it does not change for
    PATIENCE seconds, or if it is of this machine and its process has ended, that run was killed. So no clock is
    compared with that of another machine, and none is used that can be set.

    Raises:
        InputError: another run writes to this store.
    """
    _wait_for_end(store)
    ours: dict[str, Any] = {
        "machine": identify_machine(), "host": socket.gethostname(), "pid": os.getpid(), "run": uuid4().hex, "beat": 0,
    }  # fmt: skip
    has_ended = threading.Event()

    def beat() -> None:
        while not has_ended.wait(BEAT):
            ours["beat"] += 1
            # A plug-in may do anything to this process meanwhile; the next beat comes.
            with suppress(Exception):
                store.put(NAME, json.dumps(ours).encode(), lasts=False)

    thread = threading.Thread(target=beat, daemon=True)
    try:
        store.put(NAME, json.dumps(ours).encode())
        if _read(store).get("run") != ours["run"]:
            raise _make_error(store, _read(store))
        thread.start()
        yield
    finally:
        has_ended.set()
        if thread.is_alive():
            thread.join()
        # A store that fails now has ended the run already, and the record of a process that has ended binds nobody.
        with suppress(InputError):
            if _read(store).get("run") == ours["run"]:
                store.remove(NAME)


def _wait_for_end(store: Store) -> None:
    """Return when no other run uses the store; InputError as soon as it is seen that one does."""
    first = found = _read(store)
    began = time.monotonic()
    while found and time.monotonic() - began < PATIENCE:
        if found.get("machine") == identify_machine() and not is_alive(int(found.get("pid", 0))):
            return
        if found != first:
            raise _make_error(store, found)
        time.sleep(BEAT / 10)
        found = _read(store)


def _read(store: Store) -> dict[str, Any]:
    """The record; empty if there is none, or a damaged one."""
    try:
        found = json.loads(store.get(NAME))
        return found if isinstance(found, dict) else {}
    except InputError:
        raise
    except (OSError, ValueError):
        return {}


def _make_error(store: Store, found: dict[str, Any]) -> InputError:
    return InputError(
        f"another run writes to {store.address}: process {found.get('pid')} on {found.get('host')}; "
        "wait for its end, or choose another folder with -o"
    )
