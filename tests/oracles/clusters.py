"""Clusters of Dask as users start them by hand: a scheduler and workers in processes of their own, on loopback."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple


class Cluster(NamedTuple):
    """The address and the process of the scheduler, and the process above the workers."""

    address: str
    scheduler: "subprocess.Popen[bytes]"
    workers: "subprocess.Popen[bytes]"


@contextmanager
def started_by_hand(
    folder: Path, n_workers: int, prepare: Callable[[], None] | None = None, **variables: str
) -> Iterator[Cluster]:
    """A cluster that is ended with the block.

    Args:
        folder: an empty one.
        prepare: called in the process above the workers before it begins.
        variables: of the environment of all its processes.
    """
    stated = folder / "scheduler.json"

    def start(name: str, *words: str, **more: object) -> "subprocess.Popen[bytes]":
        return subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.dask_{name}", "--no-dashboard", "--scheduler-file", str(stated),
             *words],
            cwd=folder, env={**os.environ, **variables}, stderr=subprocess.DEVNULL, **more,
        )  # fmt: skip

    scheduler = start("scheduler", "--host", "127.0.0.1", "--port", "0")
    workers = start(
        "worker", "--nworkers", str(n_workers), "--nthreads", "1", "--memory-limit", "0", preexec_fn=prepare
    )
    try:
        while not (stated.exists() and stated.read_text()):
            assert scheduler.poll() is None
            time.sleep(0.02)
        yield Cluster(json.loads(stated.read_text())["address"], scheduler, workers)
    finally:
        for process in (workers, scheduler):
            process.terminate()
            process.wait()


def processes_of_runs() -> set[int]:
    """Processes that compute cells."""
    found = set()
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = path.read_bytes().split(b"\0")
        except OSError:
            continue
        if b"glossbench.run.cell_process" in words:
            found.add(int(path.parent.name))
    return found
