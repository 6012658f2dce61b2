"""Cells that end the process: tried twice, then passed over, and every other cell is made."""

import json
import os
import signal
import socket
import sys

import pytest
import torch

from glossbench.envmap.formats.files import write_exr
from glossbench.envmap.lights.light import LIGHTS, Light
from glossbench.metrics import METRICS, Metric
from glossbench.run.attempts import Attempt
from glossbench.run.executor import Executor
from glossbench.run.folder import Folder
from glossbench.run.results import Results
from glossbench.run.runner import Progress, run_study
from glossbench.run.study_lights import ChangedInput
from glossbench.shading.method import METHODS, Method
from glossbench.study.study import load_study

STUDY = """
title: T
light: LIGHT
material: {ggx: {alpha: 0.5}}
view: {sphere: {resolution: 4}}
methods: [{shown: {level: [1, 2, 3]}}]
reference: {relative_error: 0.2}
metrics: METRICS
"""
DEAD = 1 << 22  # more than any process of this system


class Shown(Method):
    """One radiance everywhere."""

    name = "shown"
    level: int = 1
    samples: int = 5

    def shade(self, points):
        return torch.full((len(points), 3), float(self.level))


class Gone(Light):
    """An invalid light."""

    name = "gone"

    def cubemap(self):
        return gone()


class Odd(Metric):
    """An invalid metric."""

    name = "odd"
    formula = unit = "1"

    def __call__(self, image, truth):
        return "many"


def gone():
    """What the light does."""
    sys.exit(0)


@pytest.fixture
def study_of(tmp_path, monkeypatch):

    def make(light="constant", metrics="[rms]"):
        (tmp_path / "s.yaml").write_text(STUDY.replace("LIGHT", light).replace("METRICS", metrics))
        return load_study(tmp_path / "s.yaml")

    with METHODS.isolated(), LIGHTS.isolated(), METRICS.isolated():
        for registry, cls in ((METHODS, Shown), (LIGHTS, Gone), (METRICS, Odd)):
            registry.register(cls.name)(cls)
        yield make


@pytest.fixture
def killed(study_of, tmp_path, monkeypatch):
    """Runs a study whose second cell ends the process so many times, as the marks that are left then say."""

    def run(times, pid=DEAD, **arguments):
        marks = []

        def shade(self, points):
            if self.level == 2 and not marks:
                [path] = (tmp_path / "r" / "begun").glob("*.begun")
                marks.append((path, json.loads(path.read_text())))
                raise KeyboardInterrupt
            return torch.full((len(points), 3), float(self.level))

        with monkeypatch.context() as patch:
            patch.setattr(Shown, "shade", shade)
            with pytest.raises(KeyboardInterrupt):
                run_study(study_of(), tmp_path / "r")
        [(path, mark)] = marks
        assert not path.parent.exists()  # an interrupt does not count
        path.parent.mkdir()
        path.write_text(json.dumps(mark | {"times": times, "pid": pid}))
        return run_study(study_of(), tmp_path / "r", **arguments).cells

    return run


def test_a_cell_that_ended_the_process_once_is_tried_again(killed, tmp_path):
    assert list(killed(1)["status"]) == ["done"] * 3
    assert not (tmp_path / "r" / "begun").exists()


def test_a_cell_that_ended_the_process_twice_is_passed_over_and_the_next_is_made(killed, tmp_path):
    cells = killed(2)

    assert list(cells["status"]) == ["done", "failed", "done"]
    assert cells["reason"][1].startswith("the process ended 2 times here,")
    assert "--rerun-failed" in cells["reason"][1]
    assert not (tmp_path / "r" / "begun").exists()


def test_it_is_skipped_until_it_is_requested(killed, study_of, tmp_path):
    killed(2)

    kept = run_study(study_of(), tmp_path / "r").cells
    again = run_study(study_of(), tmp_path / "r", rerun_failed=True).cells
    after = run_study(study_of(), tmp_path / "r").cells

    assert list(kept["status"]) == ["done", "failed", "done"]
    assert list(again["status"]) == list(after["status"]) == ["done"] * 3


def test_a_mark_of_another_running_run_does_not_count(killed):
    assert list(killed(2, pid=os.getppid())["status"]) == ["done"] * 3


def test_a_half_written_mark_counts_once(tmp_path):
    (tmp_path / "begun").mkdir()
    (tmp_path / "begun" / "k.begun").write_text('{"tim')

    assert Attempt(Folder(tmp_path), "k").ended == 1


# Inputs that fail, or are not what they were


def test_a_light_that_leaves_fails_its_own_cells_alone(study_of, tmp_path):
    for _ in range(2):
        cells = run_study(study_of(light="[gone, constant]"), tmp_path / "r").cells

        assert list(cells["status"]) == ["failed"] * 3 + ["done"] * 3
        assert "SystemExit" in cells["reason"][0]


def test_a_light_that_is_another_thing_fails_its_own_cells_alone(study_of, tmp_path, monkeypatch):
    monkeypatch.setitem(globals(), "gone", lambda: 7)

    cells = run_study(study_of(light="[gone, constant]"), tmp_path / "r").cells

    assert list(cells["status"]) == ["failed"] * 3 + ["done"] * 3
    assert "cubemap must return a CubeMap of float32, got 7" in cells["reason"][0]


def test_a_metric_that_is_not_a_number_fails_the_cells_with_its_name(study_of, tmp_path):
    cells = run_study(study_of(metrics="[rms, odd]"), tmp_path / "r").cells

    assert list(cells["status"]) == ["failed"] * 3
    assert cells["reason"][0].endswith("metric odd must return a number, got 'many'\n")


def test_a_light_that_is_replaced_in_mid_run_stops_it_and_each_image_lies_under_its_own_key(study_of, tmp_path):
    for name, level in (("a", 1.0), ("b", 2.0)):
        write_exr(tmp_path / f"{name}.exr", torch.full((4, 8, 3), level))
    study = study_of(light="[{file: a.exr, resolution: 2}, {file: b.exr, resolution: 2}]")

    def replace(row):
        write_exr(tmp_path / "b.exr", torch.full((4, 8, 3), 9.0))

    with pytest.raises(ChangedInput, match=r"b\.exr: has changed while the study ran; run it again$"):
        run_study(study, tmp_path / "r", progress=Progress(cell=replace))
    cells = run_study(study, tmp_path / "r").cells

    means = [Results(tmp_path / "r").reference(key).max() for key in cells["reference_key"]]
    assert means[3] / means[0] == pytest.approx(9, rel=0.2)


def test_an_option_called_samples_is_a_budget_only_if_the_method_says_so(study_of, tmp_path):
    cells = run_study(study_of(), tmp_path / "r").cells

    assert list(cells["budget"]) == [""] * 3
    assert list(cells["n_samples"]) == [1] * 3


@pytest.fixture
def ended(study_of, tmp_path, monkeypatch):
    """Levels in the order in which a run shades them, after the process ended so often in a cell, by its level."""

    def run(times, tries=2):
        cells, order = study_of().cells(), []
        monkeypatch.setattr("glossbench.run.attempts.TRIES", tries)
        monkeypatch.setattr("glossbench.run.cell_keys.TRIES", tries)
        executor = Executor(study_of(), Results(tmp_path / "r"), Progress())
        executor.results.create()
        known = {cell.method.level: executor.keys.identify(cell).spelled for cell in cells}
        (tmp_path / "r" / "begun").mkdir(exist_ok=True)
        for level, n in times.items():
            mark = {"times": n, "host": socket.gethostname(), "pid": DEAD}
            (tmp_path / "r" / "begun" / f"{known[level]}.begun").write_text(json.dumps(mark))

        def shade(self, points):
            order.append(self.level)
            return torch.full((len(points), 3), float(self.level))

        monkeypatch.setattr(Shown, "shade", shade)
        return order, run_study(study_of(), tmp_path / "r").cells

    return run


def test_what_ended_the_process_most_often_comes_last_but_keeps_its_place_in_the_table(ended):
    order, cells = ended({1: 2, 2: 1}, tries=5)

    assert order == [3, 2, 1]
    assert [json.loads(options)["level"] for options in cells["options"]] == [1, 2, 3]


def test_a_cell_without_plug_ins_is_tried_more_often(ended, monkeypatch):
    monkeypatch.setattr("glossbench.run.cell_items.is_foreign", lambda cls: False)

    assert list(ended({1: 4, 2: 5})[1]["status"]) == ["done", "failed", "done"]


@pytest.mark.skipif(os.name != "posix", reason="no such signals")
@pytest.mark.parametrize("number", ["SIGTERM", "SIGHUP"])
def test_a_terminated_run_is_interrupted_and_leaves_no_mark(study_of, tmp_path, monkeypatch, number):
    def shade(self, points):
        os.kill(os.getpid(), getattr(signal, number))
        return torch.ones(len(points), 3)

    monkeypatch.setattr(Shown, "shade", shade)
    before = signal.signal(getattr(signal, number), signal.SIG_DFL)  # under nohup SIGHUP is ignored, and stays so
    try:
        with pytest.raises(KeyboardInterrupt):
            run_study(study_of(), tmp_path / "r")

        assert not (tmp_path / "r" / "begun").exists()
        assert signal.getsignal(getattr(signal, number)) is signal.SIG_DFL
    finally:
        signal.signal(getattr(signal, number), before)
