"""How the kernels of a run work: chosen once, kept in the folder, and the same again when the run goes on."""

import json
from types import SimpleNamespace

import pytest

from glossbench.run import kernel_choices
from glossbench.run.folder import Folder
from glossbench.run.kernel_calls import MUCH, bound_pairs, calls_of
from glossbench.run.kernel_choices import KernelChoices
from glossbench.run.runner import run_study
from glossbench.study.study import load_study

STUDY = """
title: kernels
source: tests
question: Which kernels are called?
light: [{spots: {resolution: 16}}]
material: [{kurt: {m: 0.3}}]
view: [{sphere: {resolution: 16}}, {sphere: {resolution: 32}}]
methods:
  - importance_sampling: {samples: [8, 16]}
  - environment_sampling: {samples: 8}
reference: {relative_error: 0.5, max_samples: 1024, method: sampling}
metrics: [rms]
claims: []
"""


@pytest.fixture
def study(tmp_path):
    (tmp_path / "kernels.yaml").write_text(STUDY)
    return load_study(str(tmp_path / "kernels.yaml"))


@pytest.fixture
def cache(monkeypatch):
    """Which keys are compiled, and which were compiled now."""
    cache = SimpleNamespace(ready=set(), built=[], pays=True)

    def build(calls, tell):
        cache.built += [call.key for call in calls]
        cache.ready |= {call.key for call in calls}
        for call in calls:
            tell(call)

    monkeypatch.setattr(kernel_choices, "is_ready", lambda call: call.key in cache.ready)
    monkeypatch.setattr(kernel_choices, "pays", lambda call: cache.pays)
    monkeypatch.setattr(kernel_choices, "build_all", build)
    return cache


def call(key):
    return SimpleNamespace(key=key, kernel=SimpleNamespace(name=f"kernel {key}"), is_on_cpu=True)


def test_cells_call_the_kernels_of_their_methods_and_references(study):
    calls = calls_of(study.cells(), study.reference)

    assert sorted(each.kernel.name for each in calls) == [
        "environment_sampling", "importance_sampling", "reference_light", "reference_lobe",
    ]  # fmt: skip


def test_a_reference_that_may_be_a_sum_calls_the_kernels_of_sums(tmp_path):
    (tmp_path / "sums.yaml").write_text(STUDY.replace("method: sampling", "method: auto"))
    study = load_study(str(tmp_path / "sums.yaml"))

    names = {each.kernel.name for each in calls_of(study.cells(), study.reference)}

    assert names == {"environment_sampling", "importance_sampling", "sum_by_moments"}  # the lobe is wider than a texel


def test_of_the_calls_of_a_kernel_the_largest_is_compiled(tmp_path):
    """The levels of a pyramid are one kernel; a program for the last ones would have a fixed size."""
    (tmp_path / "s.yaml").write_text(STUDY.replace("importance_sampling:", "filtered_importance_sampling:"))
    study = load_study(str(tmp_path / "s.yaml"))

    [halve] = [each for each in calls_of(study.cells(), study.reference) if each.kernel.name == "halve"]

    assert halve.tensors[0].shape == (32, 32, 3)


def test_the_work_of_a_kernel_is_that_of_all_cells(study):
    work = {each.kernel.name: each.pairs for each in calls_of(study.cells(), study.reference)}

    # Four runs of two cells of 16 samples at each view (the larger budget counts for both), of 112/144 of the pixels.
    assert work["importance_sampling"] == pytest.approx(4 * 2 * 16 * (16**2 + 32**2) * 112 / 144, rel=0.01)
    assert work["environment_sampling"] == pytest.approx(4 * 8 * (16**2 + 32**2) * 112 / 144, rel=0.01)
    assert work["reference_light"] == pytest.approx(1024 * (16**2 + 32**2) * 112 / 144, rel=0.01)
    assert max(work.values()) < MUCH


def test_the_bound_is_above_the_work_of_each_kernel_and_above_that_of_the_study(study):
    bound, work = bound_pairs(study.cells(), study.reference), calls_of(study.cells(), study.reference)

    assert sum(each.pairs for each in work) < bound < 100 * sum(each.pairs for each in work)


def test_a_short_run_does_not_look_for_its_kernels(study, tmp_path, monkeypatch):
    looked = []
    monkeypatch.setattr("glossbench.run.runner.calls_of", lambda *_: looked.append(1) or [])

    for rate in (1e12, 1.0):
        monkeypatch.setattr("glossbench.run.runner.EAGER_RATE", rate)
        run_study(study, tmp_path / str(rate))

    assert looked == [1]


def test_what_is_ready_is_used_what_pays_is_compiled_and_the_rest_is_eager(tmp_path, cache):
    cache.ready = {"there"}
    choices = KernelChoices(Folder(tmp_path))

    choices.plan([call("there"), call("missing")], lambda text: None)
    cache.pays = False
    choices.plan([call("small")], lambda text: None)

    assert cache.built == ["missing"]
    assert [choices.choose(call(key)) for key in ("there", "missing", "small")] == [True, True, False]


def test_a_choice_is_kept_when_the_cache_has_changed(tmp_path, cache):
    cache.ready, cache.pays = {"one"}, False
    KernelChoices(Folder(tmp_path)).plan([call("one"), call("other")], lambda text: None)
    cache.ready, cache.pays = {"other"}, True

    again = KernelChoices(Folder(tmp_path))
    again.plan([call("one"), call("other")], lambda text: None)

    assert [again.choose(call("one")), again.choose(call("other"))] == [True, False]
    assert cache.built == []


def test_the_choices_are_forgotten_if_all_is_computed_again(tmp_path, cache):
    KernelChoices(Folder(tmp_path)).choose(call("one"))
    cache.ready = {"one"}

    assert not KernelChoices(Folder(tmp_path)).choose(call("one"))
    assert KernelChoices(Folder(tmp_path), again=True).choose(call("one"))


def choose_at_once(folder, monkeypatch):
    """The choices after a process has chosen one kernel while another process was choosing another kernel."""
    first, second = (KernelChoices(Folder(folder)) for _ in range(2))
    seen = []

    def meanwhile(call):
        if not seen:
            seen.append(call)
            second.choose(SimpleNamespace(key="other", kernel=SimpleNamespace(name="other"), is_on_cpu=True))
        return False

    monkeypatch.setattr(kernel_choices, "is_ready", meanwhile)
    first.choose(call("one"))
    KernelChoices(Folder(folder)).gather()
    return set(json.loads((folder / "kernels.json").read_bytes()))


def test_processes_that_choose_at_once_lose_no_choice(tmp_path, cache, monkeypatch):
    assert choose_at_once(tmp_path, monkeypatch) == {"one", "other"}
    assert not list(tmp_path.glob("begun/*"))


def test_without_marks_one_would_be_lost(tmp_path, cache, monkeypatch):
    monkeypatch.setattr(Folder, "list", lambda self, prefix: [])

    assert choose_at_once(tmp_path, monkeypatch) == {"one"}


@pytest.mark.parametrize("text", ["", "[]", '{"one": 3}', "nonsense"])
def test_a_damaged_file_of_choices_is_made_again(tmp_path, cache, text):
    (tmp_path / "kernels.json").write_text(text)
    cache.ready = {"one"}

    assert KernelChoices(Folder(tmp_path)).choose(call("one"))
    assert json.loads((tmp_path / "kernels.json").read_bytes()) == {"one": ["kernel one", "compiled"]}


def test_a_run_writes_its_choices_and_how_the_kernels_of_each_cell_ran(study, tmp_path):
    results = run_study(study, tmp_path / "results")

    written = json.loads((tmp_path / "results" / "kernels.json").read_bytes())
    assert {name: how for name, how in written.values()} == dict.fromkeys(
        ["environment_sampling", "importance_sampling", "reference_light", "reference_lobe"], "eager"
    )
    for row in results.cells.to_dict("records"):
        assert json.loads(row["kernels"]) == {row["method"]: "eager"}


def test_nothing_that_runs_is_in_a_folder_of_results(study, tmp_path):
    run_study(study, tmp_path / "results")

    endings = {path.suffix for path in (tmp_path / "results").rglob("*") if path.is_file()}
    assert endings <= {".json", ".yaml", ".parquet", ".exr", ".npz", ".npy", ".png"}
