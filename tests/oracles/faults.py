"""Faults of real processes: each must end as stated, and the same command must then leave the bytes of a serial run.

python tests/oracles/faults.py FOLDER [FAULT ...]
"""

import argparse
import ctypes
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path

from glossbench.commands.printing import say
from glossbench.run.results import Results
from oracles.clusters import processes_of_runs, started_by_hand
from oracles.flat_studies import remains
from oracles.kills import started, wait_for_cells

PLUGIN = '''
import os, signal, time
from pathlib import Path
import torch
from glossbench.shading.method import METHODS, Method

@METHODS.register("faulty")
class Faulty(Method):
    """One radiance everywhere, slowly; some numbers of samples are faults, if a file says so."""
    samples: int = 1
    seed: int = 0

    def shade(self, points, material):
        time.sleep(0.1)
        faults = Path(__file__).parent / "faults"
        if self.samples == 3 and faults.exists() and "memory" in faults.read_text():
            os.kill(os.getppid(), signal.SIGKILL)
            os.kill(os.getpid(), signal.SIGKILL)
        if self.samples == 4:
            torch.empty(10**15)
        return torch.full((len(points), 3), float(self.samples))
'''
STUDY = """
title: Faults
light: {gradient: {resolution: 16}}
material: {ggx: {alpha: [[0.4, 0.4], [0.5, 0.5]]}}
view: {sphere: {resolution: 16}}
methods:
  - faulty: {samples: [1, 2, 3, 4, 5, 6]}
  - regular_sampling: {samples: [4, 5]}
reference: {relative_error: 0.05}
plugins: [faulty_plugin]
"""
N_CELLS, N_BEFORE = 16, 2  # of the study, and done before a fault
CAP_DAC_OVERRIDE, PR_CAPBSET_DROP = 1, 24


class Ground:
    """The study, and what a serial run without a fault leaves of it."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self.study = folder, folder / "faults.yaml"
        self.study.write_text(STUDY)
        (folder / "faulty_plugin.py").write_text(PLUGIN)
        assert started(self.study, folder / "whole").wait() == 0
        self.expected = remains(folder / "whole")

    @contextmanager
    def running(self, name: str, *words: str, prepare: Callable[[], None] | None = None):
        """A run of the command in mid-run: (its process, its folder)."""
        where = self.folder / name
        process = subprocess.Popen(
            [sys.executable, "-m", "glossbench", "run", self.study, "-o", where, *words],
            stderr=subprocess.PIPE, text=True, preexec_fn=prepare,
        )  # fmt: skip
        wait_for_cells(process, where, N_BEFORE)
        yield process, where

    def ends_with_one_line(self, process, where: Path, words: str) -> bool:
        """Whether it ends with bad input, one line and no process; and whether the same command makes it whole."""
        before = {path: path.read_bytes() for path in where.glob("cells/*.json")}
        told = [line for line in process.communicate(timeout=120)[1].splitlines() if line.startswith("error")]
        say(f"  exit code {process.returncode}, {len(before)} of {N_CELLS} cells, {told}")
        time.sleep(10)  # a process that has lost its parent waits so long for its cell
        n_left = len(processes_of_runs())
        are_kept = all(path.read_bytes() == content for path, content in before.items())
        assert started(self.study, where).wait() == 0
        is_same = remains(where) == self.expected
        say(f"  cells kept: {are_kept}; processes left: {n_left}; same bytes after the same command: {is_same}")
        ended = process.returncode == 2 and len(told) == 1 and words in told[0]
        return ended and are_kept and not n_left and is_same and len(before) >= N_BEFORE


def scheduler(ground: Ground) -> bool:
    """The scheduler is killed."""
    (ground.folder / "cluster").mkdir()
    with (
        started_by_hand(ground.folder / "cluster", 2) as cluster,
        ground.running("scheduler", "--dask", cluster.address) as (process, where),
    ):
        cluster.scheduler.kill()
        return ground.ends_with_one_line(process, where, "the scheduler or its workers are gone")


def run_itself(ground: Ground) -> bool:
    """A run on processes of this machine, in which the scheduler is, is killed: its workers end, too."""
    with ground.running("run_itself", "--dask", "local:2") as (process, where):
        process.kill()
        process.wait()
        time.sleep(10)
        n_left = len(processes_of_runs())
        assert started(ground.study, where, "local:2").wait() == 0
        say(f"  processes left: {n_left}; same bytes: {remains(where) == ground.expected}")
        return not n_left and remains(where) == ground.expected


def memory(ground: Ground) -> bool:
    """One cell ends its worker with all its processes each time, as a batch system does that runs out of memory.

    The scheduler gives up a batch with its first worker. The cell fails with the reason, and all others are done.
    """
    (ground.folder / "small_cluster").mkdir()
    (ground.folder / "faults").write_text("memory")
    variables = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0"}
    with started_by_hand(ground.folder / "small_cluster", 2, **variables) as cluster:
        ended = started(ground.study, ground.folder / "memory", cluster.address).wait()
    (ground.folder / "faults").unlink()
    cells = Results(ground.folder / "memory").cells
    failed = cells[cells["status"] == "failed"]
    for reason in failed["reason"]:
        say(f"  {reason.strip().splitlines()[-1]}")
    n_guilty = int(failed["reason"].str.contains("the process ended 2 times here, killed or out of memory").sum())
    # Two more ask for more memory than there is and fail at once.
    return ended == 0 and n_guilty == 2 and len(failed) == 4 and len(cells) == N_CELLS


def read_only(ground: Ground) -> bool:
    """The folder of the results cannot be written any more."""
    return all([_read_only(ground, "read_only"), _read_only(ground, "read_only_on_dask", "--dask", "local:2")])


def _read_only(ground: Ground, name: str, *words: str) -> bool:
    def obey() -> None:  # also as root, who may write anywhere
        ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE)

    with ground.running(name, *words, prepare=obey) as (process, where):
        folders = [where, *(path for path in where.iterdir() if path.is_dir())]
        for folder in folders:
            folder.chmod(0o555)
        process.wait(timeout=120)
        for folder in folders:
            folder.chmod(0o755)
        return ground.ends_with_one_line(process, where, "cannot be written")


def disk_full(ground: Ground) -> bool:
    """Workers can write no file of more than 3.2 kB: cells and references are smaller, and a traceback is not."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (3200, resource.RLIM_INFINITY))

    (ground.folder / "full_cluster").mkdir()
    with (
        started_by_hand(ground.folder / "full_cluster", 2, limit) as cluster,
        ground.running("disk_full", "--dask", cluster.address) as (process, where),
    ):
        return ground.ends_with_one_line(process, where, "cannot be written: File too large")


FAULTS = {each.__name__: each for each in (scheduler, run_itself, memory, read_only, disk_full)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("faults", nargs="*", metavar="FAULT", help=f"of {', '.join(FAULTS)} (default: all)")
    given = parser.parse_args()
    ground, failed = Ground(given.folder), []
    for name in given.faults or FAULTS:
        say(f"{name}: {FAULTS[name].__doc__.splitlines()[0]}")
        began = time.monotonic()
        is_good = FAULTS[name](ground)
        say(f"  {'as it must be' if is_good else 'NOT AS IT MUST BE'}, {time.monotonic() - began:.0f} s")
        failed += [] if is_good else [name]
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
