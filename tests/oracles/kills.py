"""Kill runs at random moments, resume them, and compare what they leave with an undisturbed serial run, byte by byte.

python tests/oracles/kills.py STUDY FOLDER --serial 50 --workers 20
"""

import argparse
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

from glossbench.commands.printing import say
from oracles.flat_studies import remains

RUN = """
import sys
from glossbench.run.runner import run_study
from glossbench.study.study import load_study
if __name__ == "__main__":
    run_study(load_study(sys.argv[1]), sys.argv[2], dask=sys.argv[3] if len(sys.argv) > 3 else None)
"""


def started(study: Path, folder: Path, *dask: str) -> "subprocess.Popen[bytes]":
    """A run in a process group of its own."""
    return subprocess.Popen([sys.executable, "-c", RUN, study, folder, *dask], start_new_session=True)


def processes(of: int) -> list[int]:
    """The processes below this one that compute cells or carry batches."""
    parents = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(path.parent.name)] = int(path.read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
    below, found = {of}, []
    while new := [pid for pid, parent in parents.items() if parent in below and pid not in below]:
        below.update(new)
        found += new
    return [pid for pid in found if b"resource_tracker" not in Path(f"/proc/{pid}/cmdline").read_bytes()]


def wait_for_cells(process: "subprocess.Popen[bytes]", folder: Path, n: int) -> None:
    while process.poll() is None and len(list(folder.glob("cells/*.json"))) < n:
        time.sleep(0.02)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--serial", type=int, default=0)
    parser.add_argument("--workers", type=int, default=0)
    given = parser.parse_args()
    rng, same = random.Random(0), []
    whole = given.folder / "whole"
    began = time.monotonic()
    assert started(given.study, whole).wait() == 0
    expected, seconds = remains(whole), time.monotonic() - began
    n_cells = len(list(whole.glob("cells/*.json")))
    for i in range(given.serial):
        folder = given.folder / f"serial_{i}"
        process = started(given.study, folder)
        wait_for_cells(process, folder, rng.randrange(n_cells))
        time.sleep(rng.uniform(0, 2 * seconds / n_cells))
        process.kill()
        process.wait()
        n_left = len(list(folder.glob("cells/*.json")))
        assert started(given.study, folder).wait() == 0
        same.append(remains(folder) == expected)
        say(f"serial run {i}: killed with {n_left} of {n_cells} cells, same bytes: {same[-1]}")
    n_killed = 0
    while n_killed < given.workers:
        folder = given.folder / f"workers_{n_killed}"
        process = started(given.study, folder, "local:2")
        for _ in range(2):
            wait_for_cells(process, folder, rng.randrange(n_cells))
            time.sleep(rng.uniform(0, 1))
            if process.poll() is None and (below := processes(process.pid)):
                os.kill(rng.choice(below), signal.SIGKILL)
                n_killed += 1
        assert process.wait() == 0
        same.append(remains(folder) == expected)
        say(f"{n_killed} processes of workers killed, same bytes: {same[-1]}")
    say(f"{sum(same)} of {len(same)} runs left the bytes of the undisturbed run")
    sys.exit(not all(same))


if __name__ == "__main__":
    main()
