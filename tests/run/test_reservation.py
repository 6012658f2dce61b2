"""Two runs and one store: the second is refused, unless the first was killed."""

import json
import os
import subprocess
import sys
import threading

import pytest

from glossbench.errors import InputError
from glossbench.run import reservation
from glossbench.run.folder import Folder
from glossbench.run.reservation import NAME, reserved


@pytest.fixture
def store(tmp_path, monkeypatch):
    monkeypatch.setattr(reservation, "BEAT", 0.02)
    monkeypatch.setattr(reservation, "PATIENCE", 1.0)
    return Folder(tmp_path)


def left_by(store, **changes):
    """The record of another run."""
    record = {"machine": "0" * 12, "host": "elsewhere", "pid": 7, "run": "r", "beat": 3} | changes
    store.put(NAME, json.dumps(record).encode())


def test_a_second_run_is_refused_while_the_first_one_lives(store):
    with (
        reserved(store),
        pytest.raises(InputError, match=rf"another run writes to .*: process {os.getpid()} on .*; wait for its end"),
        reserved(store),
    ):
        pass

    assert not store.has(NAME)


@pytest.mark.parametrize("record", ["silent elsewhere", "dead here", "damaged"])
def test_the_store_of_a_killed_run_is_free(store, record):
    if record == "silent elsewhere":
        left_by(store)
    elif record == "dead here":
        process = subprocess.Popen([sys.executable, "-c", ""])
        process.wait()
        left_by(store, machine=reservation.identify_machine(), pid=process.pid)
    else:
        store.put(NAME, b'{"mach')

    with reserved(store):
        assert json.loads(store.get(NAME))["pid"] == os.getpid()

    assert not store.has(NAME)


def test_a_run_of_another_machine_lives_as_long_as_its_number_changes(store):
    """No clock is compared: its numbers go down."""
    has_ended = threading.Event()

    def beat():
        number = 0
        while not has_ended.wait(0.01):
            number -= 1
            left_by(store, beat=number)

    left_by(store)
    thread = threading.Thread(target=beat)
    thread.start()
    try:
        with pytest.raises(InputError, match="process 7 on elsewhere"), reserved(store):
            pass
    finally:
        has_ended.set()
        thread.join()


def test_the_clock_of_the_machine_may_go_backwards(store, monkeypatch):
    import time

    left_by(store)
    now = [1e9]
    monkeypatch.setattr(time, "time", lambda: now.append(now[-1] - 3600) or now[-1])

    with reserved(store):
        pass

    assert not store.has(NAME)
