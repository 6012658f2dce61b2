"""What changed between two tables of cells: worse and better beyond noise, slower, broken, appeared and vanished."""

import json
from math import sqrt

import numpy as np
import pandas
import pytest

from glossbench.findings.columns import collect_columns
from glossbench.findings.differences import find_differences

COLUMNS = collect_columns(["rms", "mean_error"])
GROUPS = 8


def with_noise(value, standard_error, signs="+-+-+-+-"):
    """A number, then it without each of 8 groups of replicates: of this standard error."""
    step = standard_error / sqrt(GROUPS - 1)
    return [value, *(value + float(f"{sign}1") * step for sign in signs)]


def cell(rms=0.1, noise=0.0, signs="+-+-+-+-", reference=1.0, **changes):
    """A row; options are dictionaries. Rows with equal `reference` have the same reference."""
    left_out = {"rms": with_noise(rms, noise, signs)} if noise is not None else {}
    row = {
        "key": "hash", "reference_key": "hash", "light": "spots", "light_options": {"seed": 7}, "material": "kurt",
        "material_options": {"m": 0.1}, "view": "sphere", "view_options": {}, "method": "a",
        "options": {"samples": 4}, "tuned": {}, "tune": {}, "status": "done", "reason": "", "rms": rms,
        "left_out": left_out, "reference_mean": 1.0, "reference_noise": 0.01 * reference, "reference_peak_noise": 0.1,
        "is_random": False, "shade_seconds": 1.0, "shade_seconds_low": 0.9, "shade_seconds_high": 1.1, "shade_runs": 5,
        "busy": 0.0, "processor": "one", "kernels": {"k": "compiled"},
    } | changes  # fmt: skip
    return {key: json.dumps(value) if isinstance(value, dict) else value for key, value in row.items()}


def differences(before, after):
    tables = [pandas.DataFrame(rows if isinstance(rows, list) else [rows]) for rows in (before, after)]
    return find_differences(*tables, (COLUMNS, COLUMNS))


def verdict(before, after):
    [change] = differences(before, after).errors
    return change.verdict


@pytest.mark.parametrize(
    ("rms", "expected"), [(0.1015, "worse"), (0.1005, "equal"), (0.1, "equal"), (0.0995, "equal"), (0.0985, "better")]
)
def test_a_change_above_one_percent_counts(rms, expected):
    assert verdict(cell(), cell(rms)) == expected


T7 = 2.3646  # Student's t of 7 degrees at 97.5 %


@pytest.mark.parametrize(
    ("noise", "expected"), [(0.019 / T7, "worse"), (0.021 / T7, "within noise")]  # 1.03 is 0.02 above the margin
)  # fmt: skip
def test_a_change_counts_if_its_interval_does_not_reach_the_margin(noise, expected):
    assert verdict(cell(1.0, reference=2.0), cell(1.03, noise)) == expected


def test_noise_of_the_same_reference_cancels():
    [change] = differences(cell(0.100, 0.01), cell(0.103, 0.0103)).errors

    assert (change.verdict, change.shares_noise) == ("worse", True)


def test_noise_of_different_references_does_not_cancel():
    """Twin of the above: the same numbers, and a reference of another noise."""
    [change] = differences(cell(0.100, 0.01), cell(0.103, 0.0103, reference=1.1)).errors

    assert (change.verdict, change.shares_noise) == ("within noise", False)
    # Both have 10 %, so that their ratio has sqrt(2) times that.
    assert change.log_ratio.standard_error == pytest.approx(0.1 * sqrt(2), rel=0.03)


def test_a_reference_that_another_processor_rounded_is_the_same():
    assert differences(cell(0.1, 0.01), cell(0.1, 0.01, reference=1 + 1e-7)).errors[0].shares_noise


def noisy_tables(seed, n=100, worse=1.0):
    """Two measurements of one truth, each with independent noise of 10 %; the first error of the second is worse."""
    rng = np.random.default_rng(seed)

    def measure(factor):
        groups = factor + 0.1 * sqrt(GROUPS) * rng.standard_normal(GROUPS)
        value = groups.mean()
        return value, [value, *((groups.sum() - groups) / (GROUPS - 1))]

    tables = []
    for which in (0, 1):
        found = [measure(worse if (i, which) == (0, 1) else 1.0) for i in range(n)]
        tables.append([
            cell(value, reference=1 + which + i, options={"samples": i}, left_out={"rms": values})
            for i, (value, values) in enumerate(found)
        ])  # fmt: skip
    return tables


def test_of_many_cells_that_are_equal_none_is_worse_or_better_by_chance():
    found = differences(*noisy_tables(seed=3))

    assert {each.verdict for each in found.errors} == {"within noise"}
    # Without the adjustment, one in twenty would be: its own interval does not contain the margin.
    intervals = [each.interval for each in found.errors]
    assert 1 < sum(low > 1.01 or high < 0.99 for low, high in intervals) < 20


def test_a_planted_error_is_found_among_many_cells():
    found = differences(*noisy_tables(seed=3, worse=6.0))

    assert [each.after["options"] for each in found.errors if each.verdict == "worse"] == [{"samples": 0}]
    assert found.errors[0].verdict == "worse"


def test_a_metric_that_is_higher_for_a_better_image_is_worse_when_it_falls():
    columns = {"rms": COLUMNS["rms"].__class__("rms", float, role="error", lower_is_better=False)}
    tables = [pandas.DataFrame([cell(rms)]) for rms in (0.9, 0.8)]

    assert find_differences(*tables, (columns, columns)).is_worse
    assert not find_differences(*tables[::-1], (columns, columns)).is_worse


def test_an_error_that_was_exactly_zero_is_worse():
    [change] = differences(cell(0.0), cell(0.1)).errors

    assert (change.verdict, change.ratio) == ("worse", float("inf"))


def test_cells_are_matched_without_their_keys_and_in_any_order():
    few, many = ({"options": {"samples": n}} for n in (4, 16))

    found = differences(
        [cell(0.2, **few, key="1"), cell(0.1, **many, key="2")], [cell(0.1, **many, key="3"), cell(0.2, **few)]
    )

    assert {each.verdict for each in found.errors} == {"equal"}
    assert len(found.match.pairs) == 2


@pytest.mark.parametrize(
    "changes",
    [
        {"light_options": {"seed": 8}}, {"material_options": {"m": 0.2}}, {"view": "cube"}, {"method": "b"},
        {"options": {"samples": 5}}, {"tuned": {"samples": 4}},
    ],
)  # fmt: skip
def test_another_cell_appears_and_the_old_one_vanishes(changes):
    found = differences([cell()], [cell(**changes)])

    assert (len(found.match.pairs), len(found.match.vanished), len(found.match.appeared)) == (0, 1, 1)
    assert not found.is_worse


def test_an_option_that_only_one_version_of_a_method_has_does_not_distinguish_cells():
    assert verdict(cell(0.1), cell(0.2, options={"samples": 4, "new": True})) == "worse"
    assert verdict(cell(0.1, options={"samples": 4, "old": None}), cell(0.05)) == "better"


def test_it_does_if_cells_differ_in_it():
    found = differences(cell(), [cell(options={"samples": 4, "new": new}) for new in (False, True)])

    assert (len(found.match.pairs), len(found.match.vanished), len(found.match.appeared)) == (0, 1, 2)


def test_a_file_is_matched_by_its_name_without_its_folder():
    there, here = ({"light": "file", "light_options": {"file": f"{folder}/probe.hdr"}} for folder in ("/a", "b"))

    assert verdict(cell(**there), cell(**here)) == "equal"


def random(rms, seeds):
    return [
        cell(each, is_random=True, options={"samples": 4, "seed": seed}) for seed, each in zip(seeds, rms, strict=True)
    ]


def test_seeds_of_random_points_are_one_cell_with_their_spread():
    assert verdict(random([0.08, 0.10, 0.12], range(3)), random([0.09, 0.10, 0.13], range(3, 6))) == "within noise"
    assert verdict(random([0.099, 0.10, 0.101], range(3)), random([0.199, 0.20, 0.201], range(3, 6))) == "worse"


def test_a_change_of_random_points_with_one_seed_is_marked():
    [change] = differences(random([0.1], [0]), random([0.2], [1])).errors

    assert (change.verdict, change.is_one_seed) == ("worse", True)


def test_a_cell_that_was_done_and_is_not_any_more_is_broken():
    broken = cell(status="failed", reason="ValueError: planted")

    assert differences(cell(), broken).is_worse
    assert len(differences(broken, cell()).repaired) == 1
    assert not differences(broken, cell()).is_worse
    assert not differences(broken, broken).is_worse


def timed(median, low, high, **changes):
    return cell(shade_seconds=median, shade_seconds_low=low, shade_seconds_high=high, **changes)


@pytest.mark.parametrize(
    ("after", "expected"),
    [
        (timed(1.5, 1.2, 1.6), "slower"),
        (timed(1.5, 1.0, 1.6), "unchanged"),  # its fastest run is not slower than the slowest before
        (timed(1.2, 1.15, 1.25), "unchanged"),  # 20 %
        (timed(0.7, 0.65, 0.8), "faster"),
        (timed(0.7, 0.65, 0.95), "unchanged"),
    ],
)
def test_a_time_is_longer_beyond_the_threshold_and_the_spread_of_its_runs(after, expected):
    found = differences(cell(), after)

    assert [each.verdict for each in found.times] == [expected]
    assert found.is_slower == (expected == "slower")


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"processor": "two"}, "different processors: one and two"),
        ({"kernels": {"k": "eager"}}, "kernels ran in different ways, eagerly or compiled"),
        ({"busy": 0.2}, "other programs used more than 10 % of the processor time"),
        ({"shade_runs": 0}, "they were not measured"),
    ],
)
def test_times_of_other_conditions_are_not_compared(changes, reason):
    found = differences(cell(), timed(9, 8, 10, **changes))

    assert (found.times, dict(found.untimed)) == ([], {reason: 1})


def test_metrics_of_one_result_alone_are_named():
    tables = [pandas.DataFrame([cell(**extra)]) for extra in ({}, {"mean_error": 0.1})]

    assert find_differences(*tables, (COLUMNS, COLUMNS)).metrics == (["rms"], ["mean_error"])
