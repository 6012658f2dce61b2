"""Runs on Dask: the bytes of a serial run, whatever happens to the processes, and nothing that is left running."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from glossbench.errors import InputError
from glossbench.run.results import Results
from glossbench.run.runner import Progress, run_study
from glossbench.study.study import load_study
from oracles.clusters import processes_of_runs, started_by_hand
from oracles.flat_studies import registered, remains, study_in

pytest.importorskip("distributed", reason="pip install 'glossbench[distributed]'")

PLUGIN = """
import os, signal, time
from pathlib import Path
from glossbench.shading.method import METHODS, Method, stage
import torch

def first_time(name):
    try:
        (Path(__file__).parent / name).touch(exist_ok=False)
        return (Path(__file__).parent / "faults").exists()
    except FileExistsError:
        return False

@METHODS.register("faulty")
class Faulty(Method):
    samples: int = 1
    seed: int = 0

    def supports(self, material, scene):
        return "nine" if self.samples == 9 else None

    @stage
    def mean_light(self, light):
        return light.faces.mean((0, 1, 2))

    def shade(self, points, material, mean_light):
        time.sleep(float(os.environ.get("SLOW", 0)))
        if self.samples == 2 and first_time("killed"):
            os.kill(os.getpid(), signal.SIGKILL)
        if self.samples == 3:
            raise RuntimeError("planted")
        if self.samples == 4 and first_time("worker_killed"):
            os.kill(os.getppid(), signal.SIGKILL)
            time.sleep(60)
        return mean_light.expand(len(points), 3) * self.samples
"""
HANGS = """
        if self.samples == 5:
            while True:
                try:
                    time.sleep(60)
                except TimeoutError:
                    pass
"""
STUDY = """
title: T
light: {gradient: {resolution: 16}}
material: {ggx: {alpha: 0.5}}
view: {sphere: {resolution: 8}}
methods:
  - faulty: {samples: [9, 1, 2, 3, 4, 5]}
  - regular_sampling: {samples: 4}
reference: {relative_error: 0.05}
time_limit: 30
plugins: [dask_test_plugin]
"""
RUN = """
import sys
from glossbench.run.runner import run_study
from glossbench.study.study import load_study
if __name__ == "__main__":
    run_study(load_study(sys.argv[1]), sys.argv[2], dask=sys.argv[3] if len(sys.argv) > 3 else None)
"""


@pytest.fixture
def study(tmp_path, monkeypatch):
    """A study of a method in a file beside it."""
    monkeypatch.delitem(sys.modules, "dask_test_plugin", raising=False)
    (tmp_path / "dask_test_plugin.py").write_text(PLUGIN)
    (tmp_path / "s.yaml").write_text(STUDY)
    return load_study(tmp_path / "s.yaml")


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """A scheduler and two workers that were started by hand."""
    with started_by_hand(tmp_path_factory.mktemp("cluster"), 2) as cluster:
        yield cluster


def test_processes_that_are_killed_leave_the_bytes_of_a_serial_run(study, tmp_path, cluster):
    before = processes_of_runs()
    # In a process of its own, because tests change what a traceback shows.
    subprocess.run([sys.executable, "-c", RUN, tmp_path / "s.yaml", tmp_path / "serial"], check=True)
    expected = remains(tmp_path / "serial")
    for name in ("killed", "worker_killed"):
        (tmp_path / name).unlink(missing_ok=True)
    (tmp_path / "faults").touch()
    seen, told = [], []

    results = run_study(
        study, tmp_path / "dask", dask=cluster.address, progress=Progress(cell=seen.append, doing=told.append)
    )

    assert (tmp_path / "killed").exists()
    assert (tmp_path / "worker_killed").exists()
    assert remains(results.folder) == expected
    assert sorted(results.cells["status"]) == ["done"] * 5 + ["failed", "skipped"]
    assert sorted(row["key"] for row in seen) == sorted(results.cells["key"])
    assert any(" | tcp://" in text for text in told)
    assert not (results.folder / "begun").exists()
    assert processes_of_runs() <= before


def test_a_scheduler_that_is_killed_ends_the_run_with_one_line_and_what_is_done_stays(tmp_path, cluster):
    before = processes_of_runs()
    with registered():
        study = study_in(tmp_path, methods="{regular_sampling: {samples: [4, 5, 6, 7, 8, 9, 10]}}")
    kept, killed = [], []

    def kill(row):
        if not killed:
            killed.append(time.monotonic())
            cluster.scheduler.kill()
            kept.extend((path, path.read_bytes()) for path in (tmp_path / "r").glob("cells/*.json"))

    with pytest.raises(InputError, match=r"the scheduler or its workers are gone .*; cells that are done are kept"):
        run_study(study, tmp_path / "r", dask=cluster.address, progress=Progress(cell=kill))

    # Measured 0.2 s; Dask tries to reach the scheduler for 30 s.
    assert time.monotonic() - killed[0] < 15
    assert kept
    assert all(path.read_bytes() == content for path, content in kept)
    cluster.workers.wait(timeout=60)  # workers end with their scheduler
    assert processes_of_runs() <= before


def test_a_cell_that_cannot_be_interrupted_fails_alone_and_an_interrupted_run_leaves_no_process(study, tmp_path):
    before = processes_of_runs()
    before_planted = "        if self.samples == 3"
    (tmp_path / "dask_test_plugin.py").write_text(PLUGIN.replace(before_planted, HANGS[1:] + before_planted))
    (tmp_path / "s.yaml").write_text(STUDY.replace("time_limit: 30", "time_limit: 2"))
    folder = tmp_path / "r"

    process = subprocess.Popen(
        [sys.executable, "-c", RUN, tmp_path / "s.yaml", folder, "local:1"], env=os.environ | {"SLOW": "1"},
        stderr=subprocess.PIPE, text=True,
        # A shell starts what it runs in the background with an interrupt that is ignored.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    while not list(folder.glob("cells/*.json")):
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    assert "KeyboardInterrupt" in process.communicate(timeout=60)[1]
    assert processes_of_runs() <= before
    assert not list(folder.glob("begun/*"))
    kept = {path: path.read_bytes() for path in folder.glob("cells/*.json")}

    run_study(load_study(tmp_path / "s.yaml"), folder, dask="local:1")

    rows = [json.loads(path.read_text()) for path in folder.glob("cells/*.json")]
    hung = [row for row in rows if "took more than the time limit of 2 s" in row["reason"]]
    assert [json.loads(row["options"])["samples"] for row in hung] == [5]
    assert 0 < len(kept) < len(rows) == 7
    assert all(path.read_bytes() == content for path, content in kept.items())
    assert processes_of_runs() <= before


@pytest.mark.parametrize(
    ("dask", "words"),
    [
        ("local:0", r"local:N needs a number of processes from 1 to 1024, got 'local:0'"),
        ("cluster", r"must be local:N, or an address such as tcp://host:8786, got 'cluster'"),
    ],
)
def test_an_address_that_is_none_is_one_line_and_nothing_is_written(study, tmp_path, dask, words):
    with pytest.raises(InputError, match=words):
        run_study(study, tmp_path / "r", dask=dask)

    assert not (tmp_path / "r").exists()


def test_memory_is_no_store_for_several_processes(study):
    with pytest.raises(InputError, match="the memory of one process is not a store"):
        run_study(study, "memory://x", dask="local:2")


def test_results_of_nothing_new_start_no_worker(study, tmp_path, monkeypatch):
    run_study(study, tmp_path / "r")
    monkeypatch.setattr("glossbench.run.runner.run_on_dask", lambda *_: 1 / 0)

    assert len(run_study(study, tmp_path / "r", dask="local:2").cells) == len(Results(tmp_path / "r").cells)
