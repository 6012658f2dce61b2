"""Decisions: which configurations fit, in which order, and what would change the answer."""

from math import inf

import pytest

from glossbench.findings.decisions import Need, choose
from glossbench.findings.trials import read_trials
from glossbench.findings.turns import find_turns
from oracles.trial_rows import trial_row

LIGHTS, MATERIALS = ("a", "b", "c", "d"), ("m", "n")
# name: error, shading time [ms], update for a new light [ms], memory [MB]
METHODS = {
    "table": (0.1, 0.5, 9.0, 8.0), "filter": (0.2, 1.0, 0.5, 1.0), "samples": (0.4, 2.0, 0.0, 0.0),
    "flat": (2.0, 0.1, 0.0, 0.0),
}  # fmt: skip


def make_rows(methods=METHODS, lights=LIGHTS):
    return [
        trial_row(name, light, material, error, ms=ms, update={"light": update}, mb=mb)
        for name, (error, ms, update, mb) in methods.items()
        for light in lights
        for material in MATERIALS
    ]


def choose_from(rows, pixels=None, **need):
    return choose(read_trials(rows, "rms", pixels), Need(**need))


def names(choices):
    return [each.configuration.name for each in choices]


def told(choices, by_metric=None):
    return {turn.when: turn.choice.configuration.name for turn in find_turns(choices, by_metric or {})}


def test_the_lowest_error_is_first():
    assert names(choose_from(make_rows()).fitting) == ["table", "filter", "samples", "flat"]


def test_the_update_of_what_changes_counts_and_memory_has_its_limit():
    assert names(choose_from(make_rows(), changes=("light",), milliseconds=3.0).fitting) == [
        "filter", "samples", "flat",
    ]  # fmt: skip
    assert names(choose_from(make_rows(), megabytes=0.5).fitting) == ["samples", "flat"]


def test_shading_is_scaled_by_pixels_and_updates_are_not():
    pixels = {f"{light}-{material}": 100 for light in LIGHTS for material in MATERIALS}

    [first, *_] = choose_from(make_rows(), pixels, changes=("light",), n_pixels=400).fitting

    assert (first.shade, first.update) == (pytest.approx(2.0), pytest.approx(9.0))


def test_two_changes_cost_at_most_all_stages():
    rows = [trial_row(name, update={"light": 3.0, "material": 3.0}, stage_seconds=text)
            for name, text in (("shared", '{"x": 0.003}'), ("apart", '{"x": 0.003, "y": 0.003}'))]  # fmt: skip

    found = choose_from(rows, changes=("light", "material"))

    assert {each.configuration.name: each.update for each in found.all} == pytest.approx({"shared": 3.0, "apart": 6.0})


def test_a_time_is_the_largest_over_the_conditions():
    rows = [trial_row("a", light, ms=ms) for light, ms in (("x", 1.0), ("y", 5.0), ("z", 2.0))]

    [only] = choose_from(rows).all

    assert only.milliseconds == pytest.approx(5.0)
    assert choose_from(rows, milliseconds=4.0).fitting == []


def test_what_cannot_be_compared_has_its_reason():
    rows = make_rows()[:-1]
    rows.append(trial_row("flat", "d", "n", status="skipped", reason="its lobe is anisotropic", rms=None))
    rows += [trial_row("given", light, m, update={}, shade_runs=0) for light in LIGHTS for m in MATERIALS]

    still, moving = choose_from(rows), choose_from(rows, changes=("light",))

    assert still.left_out == {"flat": "1 of 8 conditions have no image; skipped: its lobe is anisotropic"}
    assert next(each for each in still.all if each.configuration.name == "given").is_stated
    assert moving.left_out["given"] == "its update for a new light is not known"


def test_seeds_of_random_points_are_one_configuration():
    rows = [trial_row("random", light, error=error, seed=seed) for light in LIGHTS
            for seed, error in ((1, 0.5), (2, 1.5))]  # fmt: skip

    [only] = choose_from(rows).all

    assert only.configuration.name == "random"
    assert choose_from(rows).mean_error(only) == pytest.approx(1.0)


def test_each_step_of_time_is_better_than_the_one_before():
    assert names(choose_from(make_rows()).find_steps()) == ["flat", "table"]
    assert names(choose_from(make_rows(), changes=("light",)).find_steps()) == ["flat", "filter", "table"]


def check_is_no_step(rows):
    assert names(choose_from(rows).find_steps()) == ["a"]


def make_unstable():
    """b is better on the mean, but under one of its four lights it is far worse."""
    return [trial_row(name, light, error=error, ms=ms)
            for name, ms, errors in (("a", 1.0, [1, 1, 1, 1]), ("b", 2.0, [0.3, 0.3, 0.3, 4]))
            for light, error in zip(LIGHTS, errors, strict=True)]  # fmt: skip


def test_a_method_that_is_better_only_on_the_mean_is_no_step():
    check_is_no_step(make_unstable())


def test_the_check_of_steps_notices_means_without_an_interval(monkeypatch):
    monkeypatch.setattr("glossbench.findings.ranks.DRAWS", 1)
    monkeypatch.setattr("glossbench.findings.ranks.SEED_OF_DRAWS", 3)

    with pytest.raises(AssertionError):
        check_is_no_step(make_unstable())


def test_one_condition_has_the_interval_of_its_noise():
    groups = [1.0 + 0.1 * (-1) ** i for i in range(8)]
    rows = [trial_row("a", left_out=groups), trial_row("b", error=1.1)]

    found = choose_from(rows)
    ratio = found.compare(*found.all)

    assert ratio.low < 1 < ratio.high
    assert not found.is_better(*found.all)


def test_what_would_change_the_answer():
    found = choose_from(make_rows(), changes=("light",), milliseconds=3.0, megabytes=2.0)

    assert names(found.fitting)[0] == "filter"
    assert told(found) == {"with less than 1.5 ms": "flat", "with less than 1 MB": "samples"}
    assert told(choose_from(make_rows(), changes=("light",), milliseconds=3.0)) == {
        "with 9.5 ms": "table", "with less than 1.5 ms": "flat", "if the light did not change": "table",
    }  # fmt: skip
    assert told(choose_from(make_rows(), megabytes=2.0, changes=("light",)))["with 8 MB"] == "table"
    assert told(choose_from(make_rows(), milliseconds=3.0))["if the light changed in each frame, too"] == "filter"
    assert told(choose_from(make_rows(), milliseconds=0.01)) == {"with 0.1 ms": "flat"}


def test_a_light_or_a_metric_with_another_answer_is_told():
    rows = make_rows()
    for row in rows:
        row["flip"] = {"table": 0.9, "filter": 0.1}.get(row["method"], 0.5)
        row["rms"] = 0.01 if row["method"] == "samples" and row["light"] == "d" else row["rms"]

    found = told(choose_from(rows), {"flip": read_trials(rows, "flip")})

    assert found["for the light d alone"] == "samples"
    assert found["by flip"] == "filter"
    assert not any(when in found for when in ("for the light a alone", "for the material m alone"))


def test_without_limits_all_fit():
    assert Need() == Need((), inf, inf, None)
