"""What a run will cost: rates that were measured give it back, and what cannot fit is refused with the numbers."""

import pytest

from glossbench.errors import InputError
from glossbench.memory import read_size
from glossbench.run import rates
from glossbench.run.rates import (
    Spent,
    check_fits,
    measure_cell,
    measure_metrics,
    measure_reference,
    measure_stages,
    predict,
    predict_memory,
    remember,
)
from glossbench.run.runner import run_study
from glossbench.study.study import load_study
from oracles.flat_studies import registered, study_in

STUDY = {
    "view": "{sphere: {resolution: [8, 16, 64]}}",
    "methods": "{regular_sampling: {samples: [4, 16, 64]}}",
    "light": "{gradient: {resolution: 16}}",
}


@pytest.fixture(autouse=True)
def empty(tmp_path, monkeypatch):
    """No rates but those of a test."""
    monkeypatch.setattr(rates, "cache_folder", lambda: tmp_path / "cache")
    with registered():
        yield


def seconds_of(pixels, samples):
    return 0.25 + 1e-5 * pixels * samples


@pytest.fixture
def study(tmp_path):
    return study_in(tmp_path, **STUDY)


def measured(cells, options):
    """What cells with known costs would have told."""
    told = []
    for cell in cells:
        pixels = cell.view.resolution**2
        told.append(measure_cell(cell, seconds_of(pixels, cell.method.samples), 1000 + 12 * pixels))
        told.append(measure_reference(cell, options, 2 + 1e-3 * pixels, 500 + 40 * pixels))
    return told


def test_costs_that_are_linear_in_the_work_are_predicted_where_nothing_was_measured(study):
    """Measured at 8^2 and 16^2 pixels; predicted at 64^2. The sum by hand shares no code with the fit."""
    cells = study.cells()
    remember(measured([cell for cell in cells if cell.view.resolution < 64], study.reference))
    large = [cell for cell in cells if cell.view.resolution == 64]

    cost = predict(large, study.reference, study.measured)

    assert cost.n_unknown == 0
    assert cost.seconds == pytest.approx(sum(seconds_of(4096, n) for n in (4, 16, 64)) + 2 + 4.096, rel=1e-6)
    assert cost.disk == pytest.approx(3 * (1000 + 12 * 4096) + 500 + 40 * 4096, rel=1e-6)
    assert cost.memory is None


def test_stages_cost_their_mean_over_cells_at_any_size(study):
    """One cell of four makes the stage that the others share, and the view does not change what it takes."""
    cells = study.cells()
    of_cells = measured([cell for cell in cells if cell.view.resolution < 64], study.reference)
    remember([*of_cells, *(measure_stages(cells[0], seconds) for seconds in (8.0, 0.0, 0.0, 0.0))])
    large = [cell for cell in cells if cell.view.resolution == 64]

    cost = predict(large, study.reference, study.measured)

    expected = sum(seconds_of(4096, n) for n in (4, 16, 64)) + 2 + 4.096
    assert cost.seconds == pytest.approx(expected + 2.0 * len(large), rel=1e-6)
    assert cost.n_unknown == 0


def test_metrics_cost_apart_by_their_names_and_the_pixels(study):
    """FLIP takes longer than many a method, so a study without it does not tell what one with it takes."""
    cells = study.cells()
    small = [cell for cell in cells if cell.view.resolution < 64]
    remember(measured(small, study.reference))
    for cell in small:
        pixels = cell.view.resolution**2
        remember([measure_metrics(cell, ["rms"], 1.0), measure_metrics(cell, ["rms", "flip"], 3 + 2e-3 * pixels)])
    large = [cell for cell in cells if cell.view.resolution == 64]

    rest = sum(seconds_of(4096, n) for n in (4, 16, 64)) + 2 + 4.096
    told = {names: predict(large, study.reference, names).seconds - rest for names in (("rms",), ("flip", "rms"))}

    assert told["rms",] == pytest.approx(len(large) * 1.0, rel=1e-4)
    assert told["flip", "rms"] == pytest.approx(len(large) * (3 + 2e-3 * 4096), rel=1e-4)


def test_a_method_without_a_measurement_is_counted_and_costs_what_others_do(study, tmp_path):
    remember(measured(study.cells(), study.reference))
    other = study_in(tmp_path, **STUDY | {"methods": "{importance_sampling: {samples: 4}}"})

    cost = predict(other.cells()[:1], other.reference, other.measured)

    assert cost.n_unknown == 1
    assert cost.seconds == pytest.approx(seconds_of(64, 4) + 2.064, rel=1e-6)


def test_a_run_remembers_what_it_took_and_the_newest_measurements_stay(tmp_path, study):
    run_study(study_in(tmp_path), tmp_path / "r")

    cost = predict(study_in(tmp_path).cells(), study_in(tmp_path).reference, study_in(tmp_path).measured)

    assert cost.n_unknown == 0
    assert cost.seconds > 0
    assert cost.memory > 1e8
    remember([Spent("memory", 1.0, 1, 0.0, i * 10**9) for i in range(100)])
    assert predict(study_in(tmp_path).cells(), study.reference, study.measured).memory == pytest.approx(99e9, rel=0.3)


def test_damaged_rates_are_no_rates(study, tmp_path):
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache" / "rates.json").write_text('{"rates": 7')

    assert predict(study.cells(), study.reference, study.measured).seconds == 0


def test_what_does_not_fit_is_refused_before_it_starts_with_the_numbers(tmp_path):
    remember([Spent("memory", 64.0, 64, 0.0, 3 * 10**9)])
    bounded = study_in(tmp_path, memory="4 GB")

    with pytest.raises(
        InputError, match=r"needs about 6\.0 GB of memory for 2 processes, and the study allows 4\.0 GB"
    ):
        run_study(bounded, tmp_path / "r", dask="local:2")
    assert not (tmp_path / "r").exists()
    check_fits(bounded.cells(), 1, bounded.memory, None)


def test_the_machine_bounds_what_is_needed_at_least_and_a_wrong_prediction_refuses_nothing(tmp_path, monkeypatch):
    """8^2 pixels and 600 MB were measured once: 40 processes need 24 GB, whatever others took."""
    remember([Spent("memory", 64.0, 64, 0.0, 6 * 10**8), Spent("memory", 256.0, 256, 0.0, 9 * 10**9)])
    monkeypatch.setattr("glossbench.run.runner.read_capacity", lambda: 8 * 10**9)
    study = study_in(tmp_path, view="{sphere: {resolution: 64}}")

    with pytest.raises(
        InputError, match=r"needs at least 24\.1 GB of memory for 40 processes, and this machine has 8\.0 GB"
    ):
        run_study(study, tmp_path / "r", dask="local:40")
    assert not (tmp_path / "r").exists()
    assert 2 * predict(study.cells(), study.reference, study.measured).memory > 8 * 10**9
    check_fits(study.cells(), 2, None, 8 * 10**9)


def test_the_memory_of_full_hd_does_not_follow_from_small_views(tmp_path, study):
    """441 MB at 8^2 and 717 MB at 96^2 pixels lie on a line that reaches 60 GB at 1920 x 1080."""
    remember([Spent("memory", p, p, 0.0, n) for p, n in ((64, 441 * 10**6), (9216, 717 * 10**6), (9216, 712 * 10**6))])

    found = predict_memory(study_in(tmp_path, view="{sphere: {resolution: 1080, width: 1920}}").cells())

    assert found == pytest.approx(708e6 + 400 * 1920 * 1080, rel=1e-3)


def test_the_bound_of_a_study_is_read_written_and_checked(tmp_path):
    assert [read_size(text) for text in ("4 GB", "0.5TB", "250 MB", "4", "x GB", "-1 GB")] == [
        4 * 10**9, 5 * 10**11, 25 * 10**7, None, None, None,
    ]  # fmt: skip
    study = study_in(tmp_path, memory="1.5 GB")
    assert study.resolved()["memory"] == "1.5 GB"
    with pytest.raises(InputError, match=r"memory.* must be a number and kB, MB, GB or TB, such as 4 GB"):
        study_in(tmp_path, memory="much")
    assert load_study("quickstart").memory is None
