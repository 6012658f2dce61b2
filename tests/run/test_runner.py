"""Runs: what is computed, what is remembered, and that a killed run ends as if it had not been killed."""

import gc
import itertools
import json
import os
import shutil
import signal
import sys
import threading
import time
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import torch

from glossbench.envmap.formats.files import read_file, write_exr
from glossbench.envmap.pyramid import Pyramid
from glossbench.errors import InputError
from glossbench.prefilter.pyramids import build_pyramid
from glossbench.run.cell_keys import Identity
from glossbench.run.executor import Executor
from glossbench.run.results import Results
from glossbench.run.runner import Progress, run_study
from glossbench.run.tuning import tune_option
from glossbench.shading.stage_cache import MUCH
from glossbench.study.cells import Tuning
from glossbench.study.document import read_document
from glossbench.study.study import Study, load_study
from oracles.flat_studies import CALLS, Flat, interrupting, registered, remains, study_in
from oracles.forks import started


@pytest.fixture(autouse=True)
def names():
    with registered():
        CALLS.clear()
        yield


@pytest.fixture
def study_of(tmp_path):
    """Makes a small study."""
    return partial(study_in, tmp_path)


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """The results of that study as it is."""
    folder = tmp_path_factory.mktemp("first")
    with registered():
        return run_study(study_in(folder), folder / "r").folder


@pytest.fixture
def first_again(first, tmp_path):
    """They, in a folder of one's own."""
    return shutil.copytree(first, tmp_path / "r")


def assert_whole(folder: Path) -> None:
    """No file is half-written, and none is left over."""
    assert not list(folder.rglob(".*")) + list(folder.rglob("*.part"))
    keys = set(Results(folder).cells["key"])
    assert {path.stem for path in (folder / "cells").iterdir()} == keys
    assert {path.stem.removesuffix("_half_vectors") for path in (folder / "images").iterdir()} <= keys


# Killed and restarted

EVERY_KIND = {
    "methods": "[{flat: {samples: [1, 2, 101], level: {tune: distance}}}, other, {regular_sampling: {samples: 4}}]",
    "claims": "[{text: A, lower: flat, than: other, metric: rms}]",
    "title": "'1e-3'",
    "source": "'yes'",
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A study with a cell of each kind, and the results of its run without an interruption."""
    folder = tmp_path_factory.mktemp("whole")
    with registered() as patch:
        patch.setattr(Flat, "fails", True)
        study = study_in(folder, **EVERY_KIND)
        return study, run_study(study, folder / "unbroken")


@pytest.fixture
def unbroken(whole, monkeypatch):
    """That study, and what its run leaves."""
    monkeypatch.setattr(Flat, "fails", True)
    study, results = whole
    return study, remains(results.folder)


def test_every_kind_of_cell_is_in_the_unbroken_run(whole):
    _, results = whole
    cells = results.cells

    assert list(cells["status"]) == ["done", "failed", "skipped", "done", "done"]


def test_progress_names_the_stage_that_is_under_way(study_of, tmp_path):
    told = []

    run_study(study_of(methods="[{flat: {samples: [1, 2]}}]"), tmp_path / "told", progress=Progress(doing=told.append))

    assert [text for text in told if text.startswith("flat")] == ["flat", "flat: mean_light", "flat"]


def test_a_run_interrupted_after_each_cell_ends_with_the_same_bytes(unbroken, tmp_path):
    study, expected = unbroken
    folder = tmp_path / "r"

    for k in range(len(study.cells())):
        with pytest.raises(KeyboardInterrupt):
            run_study(study, folder, progress=Progress(cell=interrupting(lambda row: None, k)))
        assert len(list((folder / "cells").iterdir())) == k + 1
        assert not (folder / "cells.parquet").exists()
    run_study(study, folder)

    assert remains(folder) == expected
    assert_whole(folder)


def test_a_clock_that_goes_back_an_hour_at_each_look_changes_no_byte(unbroken, tmp_path, monkeypatch):
    """The run is interrupted, too, so that files of a run lie in the future of the one that goes on."""
    (study, expected), folder = unbroken, tmp_path / "r"
    looks = itertools.count(1)
    monkeypatch.setattr(time, "time", lambda: 2e9 - 3600 * next(looks))

    with pytest.raises(KeyboardInterrupt):
        run_study(study, folder, progress=Progress(cell=interrupting(lambda row: None, 2)))
    for path in folder.rglob("*"):
        os.utime(path, (3e9, 3e9))
    run_study(study, folder)

    assert remains(folder) == expected
    assert_whole(folder)


def test_a_run_interrupted_in_each_write_ends_with_the_same_bytes(study_of, tmp_path, monkeypatch):
    """Each run goes on from the one before, until the first write in which none was interrupted so far."""
    study = study_of(methods="[flat, {regular_sampling: {samples: 4}}]")
    expected = remains(run_study(study, tmp_path / "unbroken").folder)
    folder, really = tmp_path / "r", os.replace
    interrupted: set[tuple[Path, int]] = set()  # a file, and how often the run had written it

    def interrupted_once(part: Path, path: Path) -> None:
        if threading.current_thread() is threading.main_thread():  # not in the beat of a reservation
            written.append(path)
            place = path, written.count(path)
            if place not in interrupted:
                interrupted.add(place)
                raise KeyboardInterrupt
        really(part, path)

    has_ended = False
    while not has_ended:
        written: list[Path] = []
        with monkeypatch.context() as patch, suppress(KeyboardInterrupt):
            patch.setattr(os, "replace", interrupted_once)
            run_study(study, folder)
            has_ended = True
        assert not [*folder.rglob(".*"), *folder.rglob("*.part")]
        assert len(interrupted) < 100

    assert {path.name for path, _ in interrupted} >= {path.name for path in folder.rglob("*") if path.is_file()}
    assert remains(folder) == expected
    assert_whole(folder)


def test_files_written_in_place_would_be_half_written(study_of, tmp_path, monkeypatch):
    """Twin of the above: a row is half-written under its final name; the restarted run finds it and makes it again."""

    @contextmanager
    def in_place(path: Path, lasts: bool) -> Iterator[Path]:
        yield path
        if path.suffix == ".json" and path.parent.name == "cells":
            path.write_bytes(path.read_bytes()[:50])
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("glossbench.run.folder.replacing", in_place)
        with pytest.raises(KeyboardInterrupt):
            run_study(study_of(methods="flat"), tmp_path / "r")
    [row] = (tmp_path / "r" / "cells").iterdir()
    assert len(row.read_bytes()) == 50
    said = []

    run_study(study_of(methods="flat"), tmp_path / "r", progress=Progress(note=said.append))

    assert said == [f"{row} is damaged: this cell is computed again"]


def test_the_comparison_notices_one_changed_bit(whole, unbroken, tmp_path):
    """Twin of the above: an image whose last byte is another."""
    _, expected = unbroken
    results = Results(shutil.copytree(whole[1].folder, tmp_path / "again"))
    assert remains(results.folder) == expected
    image = next((results.folder / "images").glob("*.exr"))

    image.write_bytes(image.read_bytes()[:-1] + bytes([image.read_bytes()[-1] ^ 1]))

    assert remains(results.folder) != expected


PLUGIN = """
import os, signal, time
from glossbench.shading.method import METHODS, Method
import torch

@METHODS.register("slow")
class Slow(Method):
    samples: int = 1

    def shade(self, points, material):
        time.sleep(float(os.environ.get("SLOW", 0)))
        return torch.full((len(points), 3), self.samples / 8)

if "KILL_AT_WRITE" in os.environ:
    really, left = os.replace, [int(os.environ["KILL_AT_WRITE"])]
    def killed(*paths):
        left[0] -= 1
        if left[0] < 0:
            os.kill(os.getpid(), signal.SIGKILL)
        really(*paths)
    os.replace = killed
"""
RUN = """
import sys
from glossbench.run.runner import run_study
from glossbench.study.study import load_study
run_study(load_study(sys.argv[1]), sys.argv[2])
"""


@pytest.fixture
def slow_study(study_of, tmp_path, monkeypatch):
    """A study of a method in a separate file, which another process can import."""
    (tmp_path / "runner_test_plugin.py").write_text(PLUGIN)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "runner_test_plugin", raising=False)
    return study_of(methods="{slow: {samples: [1, 2, 3]}}", plugins="[runner_test_plugin]")


def test_a_process_killed_between_cells_ends_with_the_same_bytes(slow_study, tmp_path):
    folder = tmp_path / "killed"
    process = started(RUN, tmp_path / "s.yaml", folder, PYTHONPATH=str(tmp_path), SLOW="0.2")
    while not list(folder.glob("cells/*.json")):
        assert process.is_alive()
        time.sleep(0.01)
    process.kill()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    n_done = len(list(folder.glob("cells/*.json")))

    run_study(slow_study, folder)

    run_study(slow_study, tmp_path / "unbroken")
    assert 1 <= n_done < 3
    assert remains(folder) == remains(tmp_path / "unbroken")
    assert_whole(folder)


def test_a_process_killed_in_a_write_leaves_nothing_half_written(slow_study, tmp_path):
    folder = tmp_path / "killed"
    process = started(RUN, tmp_path / "s.yaml", folder, PYTHONPATH=str(tmp_path), KILL_AT_WRITE="8")
    process.join()
    assert process.exitcode == -signal.SIGKILL
    left = list(folder.rglob(".*"))

    run_study(slow_study, folder)

    run_study(slow_study, tmp_path / "unbroken")
    assert left
    assert remains(folder) == remains(tmp_path / "unbroken")
    assert_whole(folder)


# What a cell may end as


def test_a_failing_cell_keeps_its_traceback_and_the_run_continues(study_of, tmp_path, monkeypatch):
    monkeypatch.setattr(Flat, "fails", True)

    cells = run_study(study_of(), tmp_path / "r").cells

    assert list(cells["status"]) == ["done", "failed", "done"]
    assert cells["reason"][1].startswith("Traceback")
    assert cells["reason"][1].endswith("RuntimeError: planted [/fault]\n")
    assert not (tmp_path / "r" / "images" / f"{cells['key'][1]}.exr").exists()


def test_a_failed_cell_alone_is_tried_again_when_asked(study_of, first, tmp_path, monkeypatch):
    study = study_of()
    with monkeypatch.context() as patch:
        patch.setattr(Flat, "fails", True)
        run_study(study, tmp_path / "r")
    CALLS.clear()
    kept = run_study(study, tmp_path / "r").cells
    calls = dict(CALLS)

    cells = run_study(study, tmp_path / "r", rerun_failed=True).cells

    assert (list(kept["status"]), calls) == (["done", "failed", "done"], {})
    assert list(cells["status"]) == ["done"] * 3
    assert {name for name in CALLS if name.startswith("flat")} == {"flat 2"}
    assert remains(tmp_path / "r") == remains(first)


def test_fail_fast_raises_what_the_cell_raised_and_keeps_the_cells_before(study_of, tmp_path, monkeypatch):
    monkeypatch.setattr(Flat, "fails", True)

    with pytest.raises(RuntimeError, match="planted"):
        run_study(study_of(), tmp_path / "r", fail_fast=True)

    assert len(list((tmp_path / "r" / "cells").iterdir())) == 1


def test_a_skipped_cell_has_its_reason_and_no_image(study_of, tmp_path):
    results = run_study(study_of(methods="{flat: {samples: [1, 101]}}"), tmp_path / "r")

    assert list(results.cells["status"]) == ["done", "skipped"]
    assert results.cells["reason"][1] == "too many samples"
    assert not (results.folder / "images" / f"{results.cells['key'][1]}.exr").exists()


def test_an_image_nearer_than_twice_the_noise_is_at_the_noise_floor(study_of, tmp_path):
    white = {"light": "constant", "material": "{ggx: {ks: 0, kd: 0.5}}"}
    study = study_of(**white, methods="{flat: {level: [0.5, 0.9]}}", reference="{relative_error: 0.05}")

    cells = run_study(study, tmp_path / "r").cells

    # A diffuse surface of albedo 0.5 under light 1 shows 0.5: the flat image is the truth, or 0.4 above it.
    assert list(cells["at_noise_floor"]) == [True, False]
    assert cells["rms"][1] > 2 * cells["reference_noise"][1]
    assert abs(cells["mean_error"][1] - 0.4) < 4 * cells["reference_noise"][1]


# What is shared and remembered


def test_one_stage_serves_all_methods_and_budgets(study_of, tmp_path, several_runs):
    run_study(study_of(methods="[{flat: {samples: 1}}]"), tmp_path / "one")
    for_one = CALLS["mean_light"]
    CALLS.clear()

    run_study(study_of(methods="[{flat: {samples: [1, 2]}}, other]"), tmp_path / "two")

    # A stage is timed, so it runs several times, but no oftener for three cells than for one.
    cells = Results(tmp_path / "two").cells
    assert CALLS["mean_light"] == for_one
    assert for_one >= 3
    assert cells["shade_runs"].min() >= 3
    assert cells["stage_seconds"].nunique() == 1


@pytest.fixture
def pyramids(monkeypatch):
    """For each pyramid that is built: its filter, and how many of the earlier ones still take memory."""
    built: list[weakref.ref[Pyramid]] = []
    alive: list[tuple[str, int]] = []

    def build(light, mip_filter):
        gc.collect()
        alive.append((mip_filter, sum(each() is not None for each in built)))
        made = build_pyramid(light, mip_filter)
        built.append(weakref.ref(made))
        return made

    monkeypatch.setattr("glossbench.prefilter.stages.build_pyramid", build)
    return alive


@pytest.mark.parametrize(("much", "n_kept"), [(MUCH, 1), (0, 0)])
def test_much_memory_is_free_of_what_no_later_cell_takes(study_of, tmp_path, pyramids, monkeypatch, much, n_kept):
    monkeypatch.setattr("glossbench.shading.stage_cache.MUCH", much)

    methods = "{filtered_importance_sampling: {samples: 2, mip_filter: [box, gauss4]}}"
    # With so few samples no cell is run before to find its kernels.
    run_study(study_of(methods=methods, reference="{relative_error: 0.05, max_samples: 4096}"), tmp_path)

    assert dict(reversed(pyramids)) == {"box": 0, "gauss4": n_kept}  # when the first of each was built


@pytest.mark.parametrize("options", ["mip_filter: [box, gauss4]", "clamp: {tune: rms, range: [1, 8]}"])
def test_no_stage_is_computed_again_because_memory_was_freed(study_of, tmp_path, pyramids, monkeypatch, options):
    changes = {
        "methods": f"{{filtered_importance_sampling: {{samples: 2, {options}}}}}",
        "material": "[{ggx: {alpha: 0.4}}, {ggx: {alpha: 0.5}}]",
        "reference": "{relative_error: 0.05, max_samples: 4096}",
    }
    run_study(study_of(**changes), tmp_path / "all")
    n_built = len(pyramids)

    monkeypatch.setattr("glossbench.shading.stage_cache.MUCH", 0)
    run_study(study_of(**changes), tmp_path / "freed")

    assert len(pyramids) == 2 * n_built


def test_a_stage_that_reads_the_budget_is_not_shared(study_of, tmp_path):
    """Twin of the above: the count differs between shared stages and others."""
    run_study(study_of(methods="[{reckless: {samples: 1}}]"), tmp_path / "one")
    for_one = CALLS["mean_light"]
    CALLS.clear()

    run_study(study_of(methods="[{reckless: {samples: [1, 2]}}]"), tmp_path / "two")

    assert CALLS["mean_light"] == 2 * for_one


def test_another_light_gets_other_stages(study_of, tmp_path):
    cells = run_study(
        study_of(light="[{constant: {radiance: [[1, 2, 3]]}}, constant]", methods="other"), tmp_path
    ).cells

    means = [Results(tmp_path).image(key).max(axis=(0, 1)).round(4).tolist() for key in cells["key"]]
    assert means == [[1, 2, 3], [1, 1, 1]]


def test_the_same_study_computes_nothing_again(study_of, tmp_path, monkeypatch):
    study = study_of(methods="{flat: {samples: [1, 101]}}")
    run_study(study, tmp_path / "r")
    before = remains(tmp_path / "r")
    CALLS.clear()
    monkeypatch.setattr("glossbench.run.references.compute_reference", None)

    run_study(study, tmp_path / "r")

    assert not CALLS
    assert remains(tmp_path / "r") == before


def test_a_run_that_computes_nothing_leaves_the_times_and_versions_of_the_one_that_did(study_of, tmp_path, monkeypatch):
    study = study_of(methods="{flat: {samples: [1, 101]}}")
    before = run_study(study, tmp_path / "r").provenance
    monkeypatch.setattr("glossbench.run.runner.collect_provenance", lambda *given: {"finished": "later"})

    assert run_study(study, tmp_path / "r").provenance == before
    assert run_study(study, tmp_path / "r", use_cache=False).provenance == {"finished": "later"}


def test_without_the_cache_all_is_computed_again_and_a_reference_once(study_of, first_again, monkeypatch):
    from glossbench.run import references

    before = remains(first_again)
    made = []
    really = references.compute_reference
    monkeypatch.setattr(references, "compute_reference", lambda *args: made.append(args) or really(*args))

    run_study(study_of(), first_again, use_cache=False)

    assert {"flat 1", "flat 2", "flat 3"} <= set(CALLS)
    assert len(made) == 1
    assert remains(first_again) == before


def identities_of(study: Study, folder: Path) -> list[Identity]:
    """What the cells of a study are known by, before one of them is run."""
    executor = Executor(study, Results(folder), Progress())
    executor.results.create()
    known = [executor.keys.identify(cell) for cell in study.cells()]
    assert [each.error for each in known] == [None] * len(known)
    return known


def test_the_keys_of_a_run_are_known_before_it(study_of, first, tmp_path):
    known, cells = identities_of(study_of(), tmp_path / "r"), Results(first).cells

    assert [each.key for each in known] == list(cells["key"])
    assert [each.reference_key for each in known] == list(cells["reference_key"])


@pytest.mark.parametrize(
    ("change", "new_reference"),
    [
        ({"metrics": "[rms]"}, False),
        ({"methods": "{flat: {samples: [1, 2, 3], level: 0.6}}"}, False),
        ({"methods": "{other: {samples: [1, 2, 3]}}"}, False),
        ({"methods": "{flat: {samples: [1, 2, 3], level: {tune: rms}}}"}, False),
        ({"material": "{ggx: {alpha: 0.6}}"}, True),
        ({"view": "{sphere: {resolution: 9}}"}, True),
        ({"light": "{gradient: {resolution: 16, radiance: 2}}"}, True),
        ({"reference": "{relative_error: 0.06}"}, True),
        ({"seed": "1"}, True),
    ],
    ids=lambda value: next(iter(value.items())).__str__() if isinstance(value, dict) else "",
)
def test_all_that_changes_a_number_changes_the_key(study_of, first, tmp_path, change, new_reference):
    first = Results(first).cells

    second = identities_of(study_of(**change), tmp_path / "second")

    assert set(first["key"]).isdisjoint(each.key for each in second)
    assert (first["reference_key"][0] != second[0].reference_key) == new_reference


@pytest.mark.parametrize("change", [{"title": "U"}, {"question": "why"}, {"claims": "[]"}])
def test_what_changes_no_number_changes_no_key(study_of, first, tmp_path, change):
    """Twin of the above."""
    first = Results(first).cells

    second = identities_of(study_of(**change), tmp_path / "second")

    assert list(first["key"]) == [each.key for each in second]


def test_a_cached_cell_bears_the_seed_and_the_file_of_this_run(study_of, tmp_path):
    for name in ("a.exr", "b.exr"):
        write_exr(tmp_path / name, torch.ones(4, 8, 3))
    fixed = {"methods": "{flat: {seed: 3}}", "reference": "{relative_error: 0.05, seed: 0}"}
    run_study(study_of(light="{file: a.exr, resolution: 4}", seed=1, **fixed), tmp_path / "r")
    CALLS.clear()

    cells = run_study(study_of(light="{file: b.exr, resolution: 4}", seed=2, **fixed), tmp_path / "r").cells

    assert not CALLS
    assert cells["seed"][0] == 2
    assert Path(json.loads(cells["light_options"][0])["file"]).name == "b.exr"


def test_the_study_on_disk_loads_as_the_study_that_ran(whole):
    study, results = whole

    assert load_study(results.folder / "study.yaml") == study
    assert results.study == study.resolved() == read_document(results.folder / "study.yaml").data


# Tuning


@pytest.mark.parametrize(
    ("low", "high", "minimum"),
    [(0, 1, 0.37), (-4, 4, 0.37), (0, 1, 0.0), (0, 1, 1.0), (0.4, 1, 0.37), (0, 1e-3, 3.7e-4), (0, 4e3, 370)],
)
def test_tuning_finds_the_minimum_within_the_bounds(low, high, minimum):
    asked = []

    found = tune_option(Tuning("x", "rms", low, high), lambda x: asked.append(x) or abs(x - minimum))

    # The search stops 1/400 of the range from the minimum; the answer is rounded to 1/10 000 of it, or finer.
    expected = min(max(minimum, low), high)
    assert abs(found - expected) <= (1 / 400 + 1 / 10_000) * (high - low)
    assert all(low <= x <= high for x in [*asked, found])


def test_tuning_takes_the_size_of_a_signed_metric():
    found = tune_option(Tuning("x", "mean_error", -1, 1), lambda x: x - 0.37)

    assert abs(found - 0.37) <= 2 / 400


def test_tuning_survives_an_error_that_is_never_finite():
    assert 0 <= tune_option(Tuning("x", "relative_rms", 0, 1), lambda x: float("inf")) <= 1


def test_a_tuned_cell_says_what_was_found(study_of, tmp_path):
    study = study_of(methods="{flat: {level: {tune: distance}}}", metrics="[rms, distance]")

    [row] = run_study(study, tmp_path / "r").cells.to_dict("records")

    found = json.loads(row["tuned"])["level"]
    assert json.loads(row["tune"])["level"]["tune"] == "distance"
    assert row["light_name"] == row["light"]
    assert abs(found - 0.37) <= 1 / 400
    assert json.loads(row["options"])["level"] == found
    assert row["distance"] == pytest.approx(found - 0.37, abs=1e-6)  # float32 of the image: 6e-8


# What stops a run before it begins


@pytest.fixture
def lit_by_a_file(study_of, tmp_path, monkeypatch):
    """A finished study under an image, the path of its results, and the names of the files that are decoded later."""
    write_exr(tmp_path / "a.exr", torch.ones(4, 8, 3))
    study = study_of(light="{file: a.exr, resolution: 4}", methods="{environment_sampling: {samples: 2}}")
    run_study(study, tmp_path / "r")
    decoded: list[str] = []

    def counting(path: Path, *rest: Any) -> Any:
        decoded.append(path.name)
        return read_file(path, *rest)

    monkeypatch.setattr("glossbench.envmap.lights.file_light.read_file", counting)
    return study, tmp_path / "r", decoded


def test_a_finished_study_decodes_no_light(lit_by_a_file):
    study, folder, decoded = lit_by_a_file

    run_study(study, folder)

    assert decoded == []


def test_a_study_that_lacks_a_cell_decodes_its_light(lit_by_a_file):
    """Twin of the above."""
    study, folder, decoded = lit_by_a_file
    next((folder / "cells").iterdir()).unlink()

    run_study(study, folder)

    assert set(decoded) == {"a.exr"}


def test_an_image_of_other_radiance_makes_a_finished_study_new(lit_by_a_file):
    study, folder, _ = lit_by_a_file
    before = Results(folder).cells["light_key"][0]
    write_exr(study.folder / "a.exr", torch.full((4, 8, 3), 2.0))

    after = run_study(study, folder).cells["light_key"][0]

    assert after != before


def test_a_light_that_cannot_be_read_stops_the_run_before_it_writes(study_of, tmp_path):
    (tmp_path / "bad.hdr").write_bytes(b"\x89PNG\r\n")
    study = study_of(light="[constant, {file: bad.hdr}]")

    with pytest.raises(InputError, match=r"bad\.hdr: is not a Radiance HDR image"):
        run_study(study, tmp_path / "results" / "s")

    assert not (tmp_path / "results").exists()


def test_a_file_in_the_way_stops_the_run(study_of, tmp_path):
    (tmp_path / "file").write_text("here")

    with pytest.raises(InputError, match=r"^cannot write results to .*/file/s: Not a directory$"):
        run_study(study_of(), tmp_path / "file" / "s")

    assert not CALLS
    assert (tmp_path / "file").read_text() == "here"


def test_a_device_that_is_not_there_stops_the_run(study_of, tmp_path, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)

    with pytest.raises(InputError, match="device: cuda"):
        run_study(study_of(device="cuda"), tmp_path / "r")

    assert not (tmp_path / "r").exists()
