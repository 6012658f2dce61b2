"""Files that appear whole or not at all: order of writes, signals, and which half-written files are removed."""

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from glossbench.atomic import ABANDONED, interrupted_by_signals, remove_abandoned, replacing
from glossbench.errors import WriteError


def test_what_was_written_has_its_name_and_nothing_else_is_left(tmp_path):
    with replacing(tmp_path / "a.json") as part:
        part.write_text("new")

    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"a.json": "new"}


def write_half(path: Path, then) -> None:
    with replacing(path) as part:
        part.write_text("half")
        then()


def test_a_block_that_raises_leaves_the_old_content_and_nothing_else(tmp_path):
    (tmp_path / "a.json").write_text("old")

    with pytest.raises(KeyError):
        write_half(tmp_path / "a.json", lambda: {}[3])

    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"a.json": "old"}


def test_the_old_content_can_be_read_until_the_block_ends(tmp_path):
    (tmp_path / "a.json").write_text("old")

    with replacing(tmp_path / "a.json") as part:
        part.write_text("new")
        meanwhile = (tmp_path / "a.json").read_text()

    assert meanwhile == "old"


@pytest.mark.parametrize(("name", "ending"), [("a.exr", ".exr"), ("a", ""), ("a." + "x" * 40, ""), ("a.é", "")])
def test_a_half_written_file_is_hidden_and_has_the_ending_that_writers_know(tmp_path, name, ending):
    with replacing(tmp_path / name) as part:
        part.touch()

    assert part.parent == tmp_path
    assert part.name.startswith(".glossbench-")
    assert part.suffix == ending


def test_content_is_on_the_disk_before_it_has_its_name_and_the_name_after(tmp_path, monkeypatch):
    events, rename = [], os.replace
    monkeypatch.setattr(os, "fsync", lambda opened: events.append(Path(os.readlink(f"/proc/self/fd/{opened}")).name))
    monkeypatch.setattr(os, "replace", lambda *paths: (events.append("replace"), rename(*paths)))

    with replacing(tmp_path / "a.json") as part:
        part.touch()

    assert events == [part.name, "replace", tmp_path.name]


def test_a_missing_folder_is_one_line_with_the_path(tmp_path):
    path = tmp_path / "gone" / "a.json"

    with pytest.raises(WriteError) as caught, replacing(path) as part:
        part.write_text("new")

    assert str(caught.value) == f"{path}: cannot be written: No such file or directory"
    assert caught.value.path == path


# Signals.


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_that_ends_the_process_interrupts_the_write_and_nothing_is_left(tmp_path, number):
    before = signal.signal(number, signal.SIG_DFL)
    try:
        with pytest.raises(KeyboardInterrupt):
            write_half(tmp_path / "a.json", lambda: signal.raise_signal(number))

        assert list(tmp_path.iterdir()) == []
        assert signal.getsignal(number) is signal.SIG_DFL
    finally:
        signal.signal(number, before)


@pytest.mark.parametrize("handler", [signal.SIG_IGN, lambda number, frame: None], ids=["ignored", "another's"])
def test_the_signal_handler_of_the_program_is_kept(handler):
    before = signal.signal(signal.SIGTERM, handler)
    try:
        with interrupted_by_signals():
            meanwhile = signal.getsignal(signal.SIGTERM)

        assert meanwhile is handler
        assert signal.getsignal(signal.SIGTERM) is handler
    finally:
        signal.signal(signal.SIGTERM, before)


# What killed writers left.


@pytest.fixture
def left_by(tmp_path):
    """Makes a half-written file as a process with this number leaves it; its name, which may be changed first."""
    with replacing(tmp_path / "a.json") as part:
        part.touch()

    def make(pid: int, change=lambda name: name, age: float = 0.0) -> Path:
        path = tmp_path / change(part.name.replace(f"-{os.getpid()}-", f"-{pid}-"))
        path.write_text("half")
        os.utime(path, (time.time() - age,) * 2)
        return path

    (tmp_path / "a.json").unlink()
    return make


@pytest.fixture(scope="module")
def dead():
    """The number of a process that has ended."""
    with subprocess.Popen(["true"]) as process:
        process.wait()
    return process.pid


def test_what_a_dead_process_left_is_removed(tmp_path, left_by, dead):
    left_by(dead)

    remove_abandoned(tmp_path)

    assert list(tmp_path.iterdir()) == []


def elsewhere(name: str) -> str:
    """The same name with another machine in it."""
    start, machine, rest = name.split("-", 2)
    return "-".join([start, "0" * len(machine), rest])


def test_what_a_living_process_writes_stays(tmp_path, left_by):
    path = left_by(os.getpid())

    remove_abandoned(tmp_path)

    assert path.exists()


def test_what_a_process_of_another_machine_writes_stays_for_a_day(tmp_path, left_by, dead):
    young = left_by(dead, elsewhere, age=0.9 * ABANDONED)
    remove_abandoned(tmp_path)
    assert young.exists()

    old = left_by(dead, elsewhere, age=1.1 * ABANDONED)
    remove_abandoned(tmp_path)
    assert not old.exists()


@pytest.mark.parametrize("change", [lambda name: f"{name}.old", lambda name: name[1:], lambda name: f"my{name}"])
def test_a_file_with_another_name_stays_however_old(tmp_path, left_by, dead, change):
    path = left_by(dead, change, age=2 * ABANDONED)

    remove_abandoned(tmp_path)

    assert path.exists()


def test_folders_and_links_of_such_a_name_stay(tmp_path, left_by, dead):
    link = left_by(dead)
    link.unlink()
    link.symlink_to("nothing")

    folder = left_by(dead, lambda name: name.replace(".json", ".yaml"))
    folder.unlink()
    folder.mkdir()
    remove_abandoned(tmp_path)

    assert link.is_symlink()
    assert folder.is_dir()
