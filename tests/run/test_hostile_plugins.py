"""Plug-ins that misbehave: their cell fails with a reason, the run continues, and no other cell changes."""

import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from glossbench.errors import MethodError
from glossbench.process.time_limit import GRACE, time_limit
from glossbench.run.results import Results
from glossbench.run.runner import Progress, run_study
from glossbench.shading.method import METHODS
from glossbench.study.study import Study, load_study
from oracles.forks import Ended, ran

TIMES = [
    "stage_seconds", "update_seconds", "shade_seconds", "shade_seconds_low", "shade_seconds_high", "shade_runs", "busy",
    "reference_seconds",
]  # fmt: skip
# `how` is code of a method's body: it sees self, points, material and the stages.
PLUGIN = """
import contextlib, hashlib, sys, time
import numpy as np
import torch
from glossbench.shading.method import METHODS, Method, stage
from glossbench.prefilter.stages import pyramid


class Custom(BaseException):
    pass


@METHODS.register("hostile")
class Hostile(Method):
    samples: int = 2

    pyramid = pyramid
    mip_filter = "box"
    projection = "cube"

    @stage
    def own(self, light, pyramid):
        {stage}
        return light.faces.mean()

    def supports(self, material, scene):
        {supports}

    def n_samples(self, material):
        return {n_samples}

    def shade(self, points, material, light, pyramid, own):
        image = torch.ones(len(points), 3)
        {shade}
        return image


@METHODS.register("decent")
class Decent(Method):
    samples: int = 2

    pyramid = pyramid
    mip_filter = "box"
    projection = "cube"

    def shade(self, points, material, light, pyramid):
        value = light.faces.mean() + pyramid.texels.mean() + points.n.x.square().mean()
        return value.expand(len(points), 3).contiguous()
"""
STUDY = """
title: T
light: {gradient: {resolution: 8}}
material: {ggx: {alpha: 0.5}}
view: {sphere: {resolution: 4}}
methods: METHODS
reference: {relative_error: 0.2}
metrics: [rms, mean_error]
time_limit: LIMIT
plugins: [hostile_plugin]
"""


BETWEEN, ALONE = "[decent, hostile, {decent: {samples: 3}}]", "[decent, {decent: {samples: 3}}]"


@pytest.fixture
def study_of(tmp_path, monkeypatch):
    """Makes a study of decent cells before and after a hostile one, whose body is given."""
    with METHODS.isolated():
        yield maker(tmp_path, monkeypatch)


def maker(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Study]:
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def make(shade="pass", stage="pass", supports="return None", n_samples="self.samples", limit=60.0, methods=BETWEEN):
        code = PLUGIN.format(shade=shade, stage=stage, supports=supports, n_samples=n_samples)
        (folder / "hostile_plugin.py").write_text(code)
        monkeypatch.delitem(sys.modules, "hostile_plugin", raising=False)
        path = folder / "s.yaml"
        path.write_text(STUDY.replace("METHODS", methods).replace("LIMIT", str(limit)))
        return load_study(path)

    return make


def decent_cells(folder: Path) -> list[tuple[str, bytes]]:
    """Columns, except times, and the image of each decent cell; keys differ with the plug-in's source."""
    results = Results(folder)
    cells = results.cells
    images = [(folder / "images" / f"{key}.exr").read_bytes() for key in cells["key"][cells["method"] == "decent"]]
    rows = cells[cells["method"] == "decent"].drop(columns=[*TIMES, "key"])
    return [*zip(rows.to_json(orient="records", lines=True).splitlines(), images, strict=True)]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The decent cells of a run without the hostile one."""
    folder = tmp_path_factory.mktemp("undisturbed")
    with pytest.MonkeyPatch.context() as patch:
        return decent_cells(run_study(maker(folder, patch)(methods=ALONE), folder / "r").folder)


# Body of shade, and the last line of the reason.
FAULTS = {
    "raises": ("raise ValueError('a\\nb')", "b"),
    "raises what is no Exception": ("raise Custom('mine')", "hostile_plugin.Custom: mine"),
    "leaves": ("sys.exit(0)", "SystemExit: 0"),
    "raises half a character": ("raise ValueError(chr(0xD800))", "ValueError: \\ud800"),
    "recurses": ("self.shade(points, material, light, pyramid, own)", "RecursionError"),
    "runs out of memory": ("torch.empty(1 << 60)", "RuntimeError"),
    "runs out of numpy's memory": ("np.ones(1 << 50)", "Unable to allocate"),
    "raises MemoryError": ("raise MemoryError", "MemoryError"),
    "NaN": ("image[1, 2] = float('nan')", "MethodError: hostile.shade: 1 points are not finite"),
    "infinity": ("image[1, 2] = float('inf')", "MethodError: hostile.shade: 1 points are not finite"),
    "another shape": ("image = image.T", "must return (12, 3) float32, got (3, 12) float32"),
    "one point": ("image = image[:1]", "must return (12, 3) float32, got (1, 3) float32"),
    "another type": ("image = image.double()", "must return (12, 3) float32, got (12, 3) float64"),
    "complex": ("image = image + 0j", "must return (12, 3) float32, got (12, 3) complex64"),
    "an array": ("image = image.numpy()", "must return a tensor, got ndarray"),
    "nothing": ("return None", "must return a tensor, got NoneType"),
    "another device": ("image = image.to('meta')", "must return a tensor on cpu, got meta"),
    "writes into the light": ("light.faces.mul_(0)", "hostile.shade writes into 'light'"),
    "writes into a view of the light": ("light.faces[0].add_(1)", "hostile.shade writes into 'light'"),
    "writes into the light's memory": ("light.faces.numpy()[:] *= 2", "hostile writes into the light"),
    "writes into the points": ("points.n.x.add_(1)", "hostile.shade writes into 'points'"),
    "writes into the pyramid": ("pyramid.texels.zero_()", "hostile.shade writes into 'pyramid'"),
    "writes into the material": (
        "object.__setattr__(material, 'alpha', (0.9, 0.9))",
        "hostile writes into ggx, which other cells read",
    ),
    "writes and raises": ("light.faces.numpy()[:] *= 2; raise ValueError('then')", "ValueError: then"),
}


@pytest.fixture(scope="module")
def faulty(tmp_path_factory):
    """A run of one hostile cell for each fault with a decent cell after each."""
    budgets = range(1, len(FAULTS) + 1)
    methods = [f"{{{name}: {{samples: {n}}}}}" for n in budgets for name in ("hostile", "decent")]
    shade = "".join(
        f"if self.samples == {n}:\n            {code}\n        "
        for n, (code, _) in zip(budgets, FAULTS.values(), strict=True)
    )
    with METHODS.isolated(), pytest.MonkeyPatch.context() as patch:
        make = maker(tmp_path_factory.mktemp("faulty"), patch)
        return run_study(make(shade, methods=f"[{', '.join(methods)}]"), tmp_path_factory.mktemp("r") / "r")


@pytest.mark.parametrize("fault", FAULTS)
def test_a_hostile_cell_fails_with_its_reason(faulty, fault):
    cells = faulty.cells[faulty.cells["method"] == "hostile"].reset_index()
    row = [*FAULTS].index(fault)

    assert cells["status"][row] == "failed"
    assert cells["reason"][row].startswith("Traceback")
    assert FAULTS[fault][1] in cells["reason"][row].splitlines()[-1]


def test_the_cells_after_hostile_ones_have_the_same_bytes(faulty, undisturbed):
    """All show the same image, whichever samples they state, and so do those that run alone."""
    after = decent_cells(faulty.folder)

    assert len(after) == len(FAULTS)
    assert {without_options(cell) for cell in after} == {without_options(cell) for cell in undisturbed}
    stated = [json.loads(json.loads(row)["options"])["samples"] for row, _ in after]
    assert stated == [*range(1, len(FAULTS) + 1)]


def without_options(cell: tuple[str, bytes]) -> tuple[str, bytes]:
    """A decent cell without its options, which change nothing else."""
    row, image = cell
    return json.dumps({name: value for name, value in json.loads(row).items() if name != "options"}), image


def test_a_stage_that_writes_into_another_stage_is_named(study_of, tmp_path, undisturbed):
    results = run_study(study_of(stage="pyramid.texels.zero_()"), tmp_path / "r")

    assert "hostile.own writes into 'pyramid'" in results.cells["reason"][1]
    assert decent_cells(results.folder) == undisturbed


def test_without_the_check_the_others_would_be_wrong(study_of, tmp_path, undisturbed, monkeypatch):
    """Twin of the above: the counters of tensors unread, and the cell after the hostile one is another."""
    study = study_of("pyramid.texels.zero_()")
    monkeypatch.setattr("glossbench.shading.stage_cache.find_tensors", lambda value: iter(()))
    monkeypatch.setattr("glossbench.shading.stage_cache.compute_digest", lambda *values: 0)

    results = run_study(study, tmp_path / "r")

    assert list(results.cells["status"]) == ["done"] * 3
    assert decent_cells(results.folder)[0] == undisturbed[0]
    assert decent_cells(results.folder)[1] != undisturbed[1]


def test_a_light_that_is_written_to_unseen_would_be_wrong(study_of, tmp_path, undisturbed, monkeypatch):
    """Twin of the above: the light's bytes uncompared."""
    study = study_of("light.faces.numpy()[:] *= 2")
    monkeypatch.setattr("glossbench.run.study_lights.compute_digest", lambda *values: 0)

    results = run_study(study, tmp_path / "r")

    assert decent_cells(results.folder)[1] != undisturbed[1]


def test_radiance_that_wants_a_gradient_is_taken_without_it(study_of, tmp_path):
    results = run_study(study_of("image.requires_grad_()"), tmp_path / "r")

    assert list(results.cells["status"]) == ["done"] * 3


@pytest.mark.parametrize("supports", ["raise SystemExit(3)", "raise ValueError", "time.sleep(100)"])
def test_supports_that_fails_fails_its_cell_alone(study_of, tmp_path, undisturbed, supports):
    results = run_study(study_of(supports=supports, limit=1), tmp_path / "r")

    assert list(results.cells["status"]) == ["done", "failed", "done"]
    assert decent_cells(results.folder) == undisturbed


def test_a_reason_that_is_not_text_becomes_text(study_of, tmp_path):
    results = run_study(study_of(supports="return 7"), tmp_path / "r")

    assert list(results.cells["status"]) == ["done", "skipped", "done"]
    assert results.cells["reason"][1] == "7"


@pytest.mark.parametrize("n_samples", ["torch.ones(3)", "'many'", "None"])
def test_a_number_of_samples_that_is_not_a_whole_number_fails_the_cell(study_of, tmp_path, n_samples):
    results = run_study(study_of(n_samples=n_samples), tmp_path / "r")

    assert list(results.cells["status"]) == ["done", "failed", "done"]


def test_an_interrupt_inside_a_cell_is_an_interrupt(study_of, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        run_study(study_of("raise KeyboardInterrupt"), tmp_path / "r")

    assert len(list((tmp_path / "r" / "cells").iterdir())) == 1


@pytest.mark.parametrize(
    ("shade", "limit", "error", "words"),
    [
        ("raise ValueError('x')", 60, ValueError, "x"),
        ("sys.exit(0)", 60, MethodError, r"hostile raised SystemExit\(0\)"),
        ("time.sleep(100)", 1, TimeoutError, "took more than the time limit of 1 s"),
    ],
)
def test_fail_fast_ends_with_an_error_whatever_was_raised(study_of, tmp_path, shade, limit, error, words):
    with pytest.raises(error, match=words):
        run_study(study_of(shade, limit=limit), tmp_path / "r", fail_fast=True)

    assert len(list((tmp_path / "r" / "cells").iterdir())) == 1


def test_a_full_disk_is_one_line(study_of, tmp_path, monkeypatch):
    study = study_of()
    really = Results.add_cell

    def full(self, row, image, half_vectors):
        if row["method"] == "hostile":
            monkeypatch.setattr(
                os, "replace", lambda *paths: (_ for _ in ()).throw(OSError(28, "No space left on device"))
            )
        really(self, row, image, half_vectors)

    monkeypatch.setattr(Results, "add_cell", full)

    with pytest.raises(ValueError, match=r"^[^\n]*cannot be written: No space left on device$"):
        run_study(study, tmp_path / "r")


# Time

HANGS = {
    "a loop": "while True: pass",
    "sleep": "time.sleep(1000)",
    "a stage's loop": None,
    "many short calls into native code": "while True: torch.ones(100).sum()",
}


@pytest.mark.parametrize("hang", HANGS)
def test_a_cell_that_hangs_is_interrupted_and_the_run_continues(study_of, tmp_path, undisturbed, hang):
    body = {"shade": HANGS[hang]} if HANGS[hang] else {"stage": "while True: pass"}
    study = study_of(**body, limit=1)
    started = time.perf_counter()

    results = run_study(study, tmp_path / "r")

    assert list(results.cells["status"]) == ["done", "failed", "done"]
    assert results.cells["reason"][1].endswith("TimeoutError: took more than the time limit of 1 s\n")
    assert "hostile_plugin.py" in results.cells["reason"][1]
    assert decent_cells(results.folder) == undisturbed
    assert 1 < time.perf_counter() - started


def test_a_failed_cell_is_not_tried_again_unless_asked(study_of, tmp_path):
    slow = "time.sleep(1.5 if not hasattr(sys, 'once') else 0); sys.once = True"
    run_study(study_of(slow, limit=1), tmp_path / "r")

    kept = run_study(study_of(slow, limit=60), tmp_path / "r").cells
    sys.once = True  # type: ignore[attr-defined]
    again = run_study(study_of(slow, limit=60), tmp_path / "r", rerun_failed=True).cells
    del sys.once  # type: ignore[attr-defined]

    assert list(kept["status"]) == ["done", "failed", "done"]
    assert list(again["status"]) == ["done"] * 3
    assert list(kept["key"]) == list(again["key"])


def watching() -> list[str]:
    """Threads that look after a limit."""
    return [t.name for t in threading.enumerate() if "watch" in t.name]


def test_the_limit_leaves_alarms_as_they_were(study_of, tmp_path):
    before = signal.getsignal(signal.SIGALRM)

    run_study(study_of("while True: pass", limit=0.5), tmp_path / "r")

    assert signal.getsignal(signal.SIGALRM) is before
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    deadline = time.monotonic() + 5
    while watching() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert watching() == []


def test_work_within_the_limit_is_left_alone():
    with time_limit(0.5, lambda: pytest.fail("given up")):
        value = sum(range(1000))
    time.sleep(0.6)

    assert value == 499500


RUN = """
import sys
from pathlib import Path
import glossbench.process.time_limit
glossbench.process.time_limit.GRACE = 0.5
from glossbench.run.runner import run_study
from glossbench.study.study import load_study
run_study(load_study(sys.argv[1]), Path(sys.argv[2]))
"""
STUBBORN = {
    "native code": "hashlib.pbkdf2_hmac('sha256', b'a', b'b', 2_000_000_000)",
    "work that swallows": "while True:\n            with contextlib.suppress(Exception): time.sleep(1)",
}


def ran_to(folder: Path) -> Ended:
    """Runs the study next to a folder in another process, with the results in that folder."""
    here = folder.parent
    variables = {"PYTHONPATH": str(here), "PYTHONDONTWRITEBYTECODE": "1"}
    return ran(RUN, here / "s.yaml", folder, log=here / "log", **variables)


@pytest.mark.parametrize("kind", STUBBORN)
def test_a_cell_that_cannot_be_interrupted_ends_the_process_and_the_next_run_continues(
    study_of, tmp_path, undisturbed, kind
):
    study = study_of(STUBBORN[kind], limit=1)
    folder = tmp_path / "r"

    done = ran_to(folder)

    why = "took more than the time limit of 1 s, and could not be interrupted"
    assert done.returncode == 1
    assert done.stderr == f"error: hostile {why}; the same command goes on with the next cell\n"
    rows = [json.loads(path.read_text()) for path in (folder / "cells").iterdir()]
    assert sorted((row["method"], row["status"]) for row in rows) == [("decent", "done"), ("hostile", "failed")]
    reason = next(row["reason"] for row in rows if row["method"] == "hostile")
    assert "hostile_plugin.py" in reason
    assert reason.endswith(f"TimeoutError: {why}\n")
    assert not list(folder.rglob(".*"))

    cells = run_study(study, folder).cells

    assert list(cells["status"]) == ["done", "failed", "done"]
    assert decent_cells(folder) == undisturbed


def test_native_code_that_lets_no_thread_run_is_ended_with_a_traceback(study_of, tmp_path):
    study_of("sum(range(10**13))", limit=1)

    done = ran_to(tmp_path / "r")

    assert done.returncode == 1
    assert done.stderr.startswith("Timeout (0:00:0")
    assert "hostile_plugin.py" in done.stderr
    assert len(list((tmp_path / "r" / "cells").iterdir())) == 1


def test_the_reference_is_not_under_the_limit(study_of, tmp_path, monkeypatch):
    from glossbench.run import references

    really = references.compute_reference
    monkeypatch.setattr(references, "compute_reference", lambda *args: (time.sleep(1.2), really(*args))[1])

    results = run_study(study_of(limit=1), tmp_path / "r", progress=Progress())

    assert list(results.cells["status"]) == ["done"] * 3


def test_the_grace_is_short_compared_with_any_sensible_limit():
    assert 0 < GRACE <= 10


def test_the_limit_of_a_study_changes_no_key(study_of, tmp_path):
    first = run_study(study_of(limit=50), tmp_path / "r").cells
    second = run_study(study_of(limit=70), tmp_path / "r").cells

    assert list(first["key"]) == list(second["key"])
    assert torch.get_default_dtype() == torch.float32
