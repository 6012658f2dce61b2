"""Verdicts on claims: what holds, what does not, what is within noise, and what was not tested."""

import json
from math import sqrt
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.stats import t as student

from glossbench.findings.verdicts import judge
from glossbench.study.claims import KINDS, agrees

METRICS_HERE = ("rms", "relative_rms", "mean_error", "max_error", "flip")


def values(value: float, standard_error: float, signs: str = "+-+-+-+-") -> list[float]:
    """A metric against the reference and against it without each of its groups: of so large a standard error."""
    step = standard_error / sqrt(len(signs) - 1)
    return [value, *(value + float(f"{sign}1") * step for sign in signs)]


def noisy(metric: str, value: float, standard_error: float, signs: str = "+-+-+-+-") -> dict[str, Any]:
    """Columns of a metric with noise; cells of the same signs share it, of other signs they do not."""
    return {metric: value, "left_out": {metric: values(value, standard_error, signs)}}


def cell(method: str, **changes: Any) -> dict[str, Any]:
    """A row of a run; options, material_options and the like are given as dictionaries."""
    row = {
        "light": "spots", "light_options": {"seed": 7},
        "material": "kurt", "material_options": {"m": [0.1, 0.1]},
        "view": "sphere", "view_options": {"resolution": 64}, "method": method, "options": {"samples": 14},
        "status": "done", "rms": 0.1, "relative_rms": 0.2, "mean_error": 0.01, "max_error": 1.0,
        "reference_key": "of all", "is_random": False, "at_noise_floor": False,
        "n_samples": 14, "shade_seconds": 0.1, "state_bytes": 1000,
        "stage_seconds": {"pyramid": 0.2, "pdf": 0.3},
    } | changes  # fmt: skip
    known = {name: [row[name]] for name in METRICS_HERE if isinstance(row.get(name), float | int)}
    row["left_out"] = known | row.get("left_out", {})
    return {key: json.dumps(value) if isinstance(value, dict) else value for key, value in row.items()}


def verdict_on(claim: dict[str, Any], *rows: dict[str, Any]) -> dict[str, Any]:
    """The judgement of one claim, stated as in a study."""
    [kind] = [kind for kind in KINDS if kind in claim]
    model = KINDS[kind].model_validate({"text": "As the paper says"} | claim)
    [judgement] = judge([model], pd.DataFrame(list(rows)))
    json.dumps(judgement, allow_nan=False)
    assert (judgement["text"], judgement["kind"]) == ("As the paper says", kind)
    return judgement


LOWER = {"lower": "a", "than": "b", "metric": "rms"}
RATIO = {"ratio": ["a", "b"], "of": "shade_seconds", "between": [0.5, 2]}
SLOPE = {"slope": "a", "over": "samples", "metric": "rms", "between": [-0.6, -0.4]}
VALUE = {"value": "a", "of": "n_samples", "equals": 14}


# lower


T7 = 2.3646  # Student's t of 7 degrees at 97.5 %


@pytest.mark.parametrize(
    ("a", "b", "verdict"),
    [
        (0.1, 0.2, "holds"),
        (0.2, 0.1, "does not hold"),
        (0.1, 0.1, "equal"),
        (0.0, 0.0, "equal"),
        (0.1, 0.0, "does not hold"),
        (0.0, 0.1, "holds"),
        (0.0995, 0.1, "equal"),
        (0.0985, 0.1, "holds"),
        (0.1005, 0.1, "equal"),
        (0.1015, 0.1, "does not hold"),
    ],
)
def test_without_noise_a_difference_above_one_percent_decides(a, b, verdict):
    judgement = verdict_on(LOWER, cell("a", rms=a), cell("b", rms=b))

    assert judgement["verdict"] == verdict
    [number] = judgement["numbers"]
    assert (number["a"], number["b"], number["verdict"]) == (a, b, verdict)


@pytest.mark.parametrize(("margin", "verdict"), [(0.0, "holds"), (0.019, "holds"), (0.021, "equal"), (0.2, "equal")])
def test_the_margin_of_a_claim_says_what_is_equal(margin, verdict):
    assert verdict_on({**LOWER, "margin": margin}, cell("a", rms=0.98), cell("b", rms=1.0))["verdict"] == verdict


@pytest.mark.parametrize(
    ("a", "noise", "verdict"),
    [
        (0.9, 0.08 / T7, "holds"),
        (0.9, 0.1 / T7, "within noise"),  # the interval ends at 1: it contains 0.99
        (1.1, 0.08 / T7, "does not hold"),
        (1.1, 0.1 / T7, "within noise"),
        (1.0, 0.009 / T7, "equal"),
        (1.0, 0.011 / T7, "within noise"),
    ],
)
def test_lower_is_within_noise_where_the_interval_contains_an_end_of_the_margin(a, noise, verdict):
    judgement = verdict_on(LOWER, cell("a", **noisy("rms", a, noise)), cell("b", rms=1.0))

    assert judgement["verdict"] == verdict
    [number] = judgement["numbers"]
    assert [number[key] for key in ("value", "low", "high")] == pytest.approx(
        [a, a - T7 * noise, a + T7 * noise], rel=1e-4
    )


def test_noise_that_both_cells_share_cancels_from_their_ratio():
    """Both errors are known to 10 % alone, and differ by 3 % of themselves."""
    rows = cell("a", **noisy("rms", 0.97, 0.097)), cell("b", **noisy("rms", 1.0, 0.1))

    judgement = verdict_on(LOWER, *rows)

    assert judgement["verdict"] == "holds"
    assert judgement["numbers"][0]["high"] - judgement["numbers"][0]["low"] < 1e-9


@pytest.mark.parametrize("twin", [{"signs": "++--++--"}, {"reference_key": "another"}])
def test_noise_that_is_not_shared_does_not_cancel(twin):
    """Twins of the above: other signs of the same reference, and the noise of another reference."""
    signs = {"signs": twin["signs"]} if "signs" in twin else {}
    changed = {key: value for key, value in twin.items() if key != "signs"}
    rows = cell("a", **noisy("rms", 0.97, 0.097, **signs), **changed), cell("b", **noisy("rms", 1.0, 0.1))

    judgement = verdict_on(LOWER, *rows)

    assert judgement["verdict"] == "within noise"
    half = (judgement["numbers"][0]["high"] - judgement["numbers"][0]["low"]) / 2
    # Welch and Satterthwaite: two like variances of 7 degrees have 14.
    t = T7 if "signs" in twin else 2.1448
    assert half == pytest.approx(t * sqrt(2) * 0.097, rel=0.05)


def test_one_case_that_does_not_hold_decides():
    rows = [
        cell(method, rms=rms, material_options={"m": [m, m]})
        for method, errors in [("a", [1, 1, 3]), ("b", [2, 2, 2])]
        for m, rms in zip([0.1, 0.2, 0.3], errors, strict=True)
    ]

    judgement = verdict_on(LOWER, *rows)

    assert judgement["verdict"] == "does not hold"
    assert [n["verdict"] for n in judgement["numbers"]] == ["holds", "holds", "does not hold"]
    assert judgement["summary"] == (
        "Holds in 2 of 3 cases; rms of a over b: 0.5 to 1.5; lowest for m [0.1, 0.1]; highest for m [0.3, 0.3]."
    )


def test_cases_within_noise_do_not_stop_a_claim_that_holds_elsewhere():
    rows = [
        cell(method, rms=rms, material_options={"m": m})
        for method, errors in [("a", [1.0, 1.0]), ("b", [2.0, 1.02])]
        for m, rms in zip([0.1, 0.2], errors, strict=True)
    ]
    rows[0] |= {key: json.dumps(v) if isinstance(v, dict) else v for key, v in noisy("rms", 1.0, 0.01).items()}
    rows[1] |= {key: json.dumps(v) if isinstance(v, dict) else v for key, v in noisy("rms", 1.0, 0.01).items()}

    judgement = verdict_on(LOWER, *rows)

    assert judgement["verdict"] == "holds"
    assert judgement["summary"].startswith("Holds in 1 of 2 cases, 1 within noise;")
    assert ": 0.5 [0.4882, 0.5118] to 0.9804 [0.9572, 1.004]; lowest for m 0.1;" in judgement["summary"]


def test_equal_cases_stop_no_claim_that_holds_elsewhere_and_come_before_noise():
    equal = [cell("a", rms=1.0, material="ggx"), cell("b", rms=1.0, material="ggx")]
    noise = [cell("a", **noisy("rms", 1.0, 0.1), material="phong"), cell("b", rms=1.0, material="phong")]
    holds = [cell("a", rms=1.0), cell("b", rms=2.0)]

    assert verdict_on(LOWER, *equal, *noise)["verdict"] == "equal"
    assert verdict_on(LOWER, *equal, *noise)["summary"].startswith("Holds in 0 of 2 cases, 1 equal, 1 within noise;")
    assert verdict_on(LOWER, *equal, *noise, *holds)["verdict"] == "holds"


# readings


def by_points(errors: dict[str, float], m: float = 0.1) -> list[dict[str, Any]]:
    """A cell of each kind of points."""
    material = {"m": [m, m]}
    return [
        cell("b", rms=e, options={"samples": 14, "points": p}, material_options=material) for p, e in errors.items()
    ]


def test_a_claim_says_under_which_readings_it_holds():
    rows = [cell("a", rms=1.0), *by_points({"r2": 2.0, "halton": 1.6, "hammersley": 0.8})]
    rows += [cell("a", rms=1.0, material_options={"m": [0.2, 0.2]}), *by_points({"r2": 4.0, "halton": 0.5}, 0.2)]

    judgement = verdict_on(LOWER | {"by": "points"}, *rows)

    assert judgement["verdict"] == "does not hold"
    assert judgement["readings"] == [
        "Holds by points r2 (0.25 to 0.5)",
        "Does not hold by points halton (0.625 to 2), hammersley (1.25)",
    ]
    assert judgement["summary"].endswith(". Holds by points r2 (0.25 to 0.5). " + judgement["readings"][1] + ".")


def test_a_reading_may_be_of_several_options_of_either_side():
    first = [cell("a", rms=1.0, options={"samples": 14, "xi": xi}) for xi in (0.1, 0.2)]

    judgement = verdict_on(
        RATIO | {"of": "rms", "by": ["xi", "points"]}, *first, *by_points({"r2": 1.0, "halton": 4.0})
    )

    assert judgement["readings"] == [
        "Holds by xi 0.1: points r2 (1); xi 0.2: points r2 (1)",
        "Does not hold by xi 0.1: points halton (0.25); xi 0.2: points halton (0.25)",
    ]


def test_slopes_and_values_have_readings_too():
    rows = [cell("a", rms=2.0**-i, options={"samples": 4**i, "k": 1}) for i in range(3)]

    slope = verdict_on(SLOPE | {"by": "k"}, *rows)
    value = verdict_on({"value": "a", "of": "rms", "between": [0.3, None], "by": "samples"}, *rows)

    assert slope["readings"] == ["Holds by k 1 (-0.5)"]
    assert value["readings"] == ["Holds by samples 1 (1), 4 (0.5)", "Does not hold by samples 16 (0.25)"]


def test_a_claim_without_readings_has_none():
    assert verdict_on(LOWER, cell("a", rms=1.0), *by_points({"r2": 2.0}))["readings"] == []


# seeds of random points


def seeded(method: str, errors: dict[int, float], **changes: Any) -> list[dict[str, Any]]:
    """Cells of a method with random points, one for each seed."""
    return [
        cell(method, rms=rms, options={"samples": 14, "seed": seed}, is_random=True, **changes)
        for seed, rms in errors.items()
    ]


def test_cells_that_differ_in_the_seed_alone_are_one_case_whose_spread_enters():
    errors = {1: 0.8, 2: 0.9, 3: 1.0}

    judgement = verdict_on(LOWER, *seeded("a", errors), cell("b", rms=1.2))

    [number] = judgement["numbers"]
    half = 4.3027 * np.std([0.8, 0.9, 1.0], ddof=1) / sqrt(3) / 1.2  # Student's t of 2 degrees
    assert [number[key] for key in ("value", "low", "high")] == pytest.approx(
        [0.75, 0.75 - half, 0.75 + half], rel=1e-4
    )
    assert (number["a"], number["seeds"], judgement["verdict"]) == (pytest.approx(0.9), [3, 0], "holds")
    assert "; seeds: 3 of a." in judgement["summary"]
    assert "seed 1" not in number["where"]


def test_a_spread_over_seeds_that_reaches_the_bound_is_within_noise():
    judgement = verdict_on(LOWER, *seeded("a", {1: 0.6, 2: 0.9, 3: 1.2}), cell("b", rms=1.2))

    assert judgement["verdict"] == "within noise"


def test_one_seed_says_that_its_spread_is_not_known():
    judgement = verdict_on(LOWER, *seeded("a", {1: 0.9}), *seeded("b", {4: 1.2}))

    assert judgement["verdict"] == "holds"
    assert "; seeds: 1 of a, 1 of b (the spread of a single seed is not known)." in judgement["summary"]


def test_the_spread_that_both_methods_share_over_the_same_seeds_cancels():
    factor = {1: 1.0, 2: 1.5, 3: 0.5}
    pair = [seeded(name, {seed: level * f for seed, f in factor.items()}) for name, level in (("a", 0.9), ("b", 1.0))]
    other = seeded("b", {seed + 3: f for seed, f in factor.items()})

    assert verdict_on(LOWER, *pair[0], *pair[1])["verdict"] == "holds"
    assert verdict_on(LOWER, *pair[0], *other)["verdict"] == "within noise"


def test_the_noise_of_the_reference_and_the_spread_over_seeds_are_added():
    errors = {1: 0.8, 2: 0.9, 3: 1.0}
    rows = [
        row | {"left_out": json.dumps({"rms": values(rms, 0.1)})}
        for row, rms in zip(seeded("a", errors), errors.values(), strict=True)
    ]

    [number] = verdict_on({"value": "a", "of": "rms", "between": [0, 2]}, *rows)["numbers"]

    spread, noise = 0.1**2 / 3, 0.1**2
    degrees = (spread + noise) ** 2 / (spread**2 / 2 + noise**2 / 7)
    assert number["high"] - number["value"] == pytest.approx(
        student.isf(0.025, degrees) * sqrt(spread + noise), rel=1e-6
    )


def test_pairs_by_seed_are_a_case_each():
    rows = [*seeded("a", {1: 0.8, 2: 0.9}), *seeded("b", {1: 1.0, 2: 0.5})]

    judgement = verdict_on({**LOWER, "paired_by": ["seed"]}, *rows)

    assert [(n["a"], n["b"]) for n in judgement["numbers"]] == [(0.8, 1.0), (0.9, 0.5)]


def test_cells_are_paired_at_equal_samples_only():
    rows = [
        cell("a", rms=1.0, options={"samples": 14}),
        cell("a", rms=0.5, options={"samples": 17}),
        cell("b", rms=2.0, options={"samples": 14, "filter": "box"}),
        cell("b", rms=0.7, options={"samples": 17, "filter": "box"}),
    ]

    judgement = verdict_on(LOWER, *rows)

    # A 14 against B 17 would not hold: this also is the planted fault of a pairing that forgets the samples.
    assert judgement["verdict"] == "holds"
    assert [(n["a"], n["b"]) for n in judgement["numbers"]] == [(1.0, 2.0), (0.5, 0.7)]
    across = verdict_on({**LOWER, "paired_by": "filter"}, *rows)
    assert across["verdict"] == "not tested"


def test_paired_by_replaces_the_samples():
    rows = [
        cell("a", rms=1.0, options={"samples": 14, "filter": "box"}),
        cell("b", rms=2.0, options={"samples": 99, "filter": "box"}),
        cell("b", rms=0.5, options={"samples": 99, "filter": "gauss6"}),
    ]

    judgement = verdict_on({**LOWER, "paired_by": ["filter"]}, *rows)

    assert [(n["a"], n["b"]) for n in judgement["numbers"]] == [(1.0, 2.0)]


@pytest.mark.parametrize("place", ["light", "material", "view", "light_options", "material_options", "view_options"])
def test_cells_of_other_places_are_never_paired(place):
    other = {"other": 1} if place.endswith("options") else "other"

    judgement = verdict_on(LOWER, cell("a"), cell("b", **{place: other}))

    assert judgement["verdict"] == "not tested"
    assert judgement["summary"] == "Not tested: cells without a counterpart: 1."


def test_options_that_one_method_sweeps_are_compared_each_and_distinguished():
    rows = [
        cell("a", rms=1.0, options={"samples": 14, "xi": 0.1}),
        cell("a", rms=3.0, options={"samples": 14, "xi": 0.2}),
        cell("b", rms=2.0, options={"samples": 14}),
    ]

    judgement = verdict_on(LOWER, *rows)

    assert [n["verdict"] for n in judgement["numbers"]] == ["holds", "does not hold"]
    assert "xi 0.1" in judgement["numbers"][0]["where"]
    assert "xi 0.2" in judgement["numbers"][1]["where"]


def test_signed_errors_are_compared_by_size():
    judgement = verdict_on({**LOWER, "metric": "mean_error"}, cell("a", mean_error=-3), cell("b", mean_error=1))

    assert judgement["verdict"] == "does not hold"


@pytest.mark.parametrize("metric", ["rms", "flip", "max_error", "a_metric_of_a_plug_in"])
def test_noise_is_measured_for_a_metric_of_any_name(metric):
    rows = [cell(method, **noisy(metric, value, 0.3)) for method, value in [("a", 1.0), ("b", 1.2)]]
    rows[1] = cell("b", **noisy(metric, 1.2, 0.3, "++--++--"))

    judgement = verdict_on({**LOWER, "metric": metric}, *rows)

    assert judgement["verdict"] == "within noise"


def test_rows_that_never_measured_their_noise_are_counted():
    rows = [row | {"left_out": "{}"} for row in (cell("a", rms=0.1), cell("b", rms=0.2))]

    judgement = verdict_on(LOWER, *rows)

    assert judgement["verdict"] == "holds"
    assert judgement["summary"].endswith("; cells without a measured noise: 2.")


# where


@pytest.mark.parametrize(
    ("where", "n_cases"),
    [
        ({}, 4),
        ({"samples": 14}, 2),
        ({"samples": [14, 17]}, 4),
        ({"samples": [14, 99]}, 2),
        ({"m": 0.1}, 2),
        ({"m": [0.1, 0.1]}, 2),
        ({"m": [[0.1, 0.1], [0.2, 0.2]]}, 4),
        ({"light": "spots", "material": ["kurt", "ggx"], "view": "sphere"}, 4),
        ({"light": "sky"}, 0),
        ({"xi": 0.1}, 4),
        ({"xi": 0.2}, 0),
        ({"alpha": 0.2}, 0),
    ],
)
def test_where_restricts_the_cells(where, n_cases):
    rows = [
        cell(method, options={"samples": samples, **own}, material_options={"m": [m, m]})
        for method, own in [("a", {"xi": 0.1}), ("b", {})]
        for samples in (14, 17)
        for m in (0.1, 0.2)
    ]

    judgement = verdict_on({**LOWER, "where": where}, *rows)

    assert len(judgement["numbers"]) == n_cases


def test_where_distinguishes_lights_of_one_name_by_an_option():
    rows = [
        cell(method, light_options={"resolution": r}, rms=rms)
        for r, errors in ((256, {"a": 1, "b": 2}), (512, {"a": 2, "b": 1}))
        for method, rms in errors.items()
    ]

    verdicts = [
        verdict_on({**LOWER, "where": {"light": {"spots": {"resolution": r}}}}, *rows)["verdict"] for r in (256, 512)
    ]

    assert verdicts == ["holds", "does not hold"]


def test_sides_compare_one_method_with_itself():
    rows = [
        cell("a", options={"samples": n, "k": k}, rms=rms)
        for n, errors in ((14, {1: 0.3, 4: 0.2}), (30, {1: 0.1, 4: 0.15}))
        for k, rms in errors.items()
    ]

    judgement = verdict_on({"lower": {"a": {"k": 4}}, "than": {"a": {"k": 1}}, "metric": "rms"}, *rows)

    assert [(n["a"], n["b"], n["verdict"]) for n in judgement["numbers"]] == [
        (0.2, 0.3, "holds"),
        (0.15, 0.1, "does not hold"),
    ]
    assert "rms of a (k 4) over a (k 1)" in judgement["summary"]


def test_a_side_that_states_a_view_is_compared_with_another_view():
    rows = [
        cell("a", view=view, view_options={"shape": shape} if shape else {"resolution": 64}, light=light, rms=rms)
        for light, errors in (("spots", (0.1, 0.3, 0.2)), ("sky", (0.3, 0.2, 0.4)))
        for (view, shape), rms in zip((("sphere", ""), ("mesh", "knot"), ("mesh", "cloth")), errors, strict=True)
    ]

    claim = {"lower": {"a": {}, "view": "sphere"}, "than": {"a": {}, "view": {"mesh": {"shape": "knot"}}}}
    judgement = verdict_on({**claim, "metric": "rms"}, *rows)

    assert [(n["a"], n["b"], n["verdict"]) for n in judgement["numbers"]] == [
        (0.1, 0.3, "holds"),
        (0.3, 0.2, "does not hold"),
    ]
    assert judgement["numbers"][0]["where"].startswith("spots, kurt, samples 14, sphere against mesh (shape knot)")


@pytest.mark.parametrize(("of", "value"), [("stage_seconds.pyramid", 0.2), ("update_seconds.light", 0.4)])
def test_a_claim_may_be_about_one_stage_or_one_update(of, value):
    row = cell("a", stage_seconds={"pyramid": 0.2, "pdf": 0.3}, update_seconds={"light": 0.4, "view": 0.0})

    judgement = verdict_on({"value": "a", "of": of, "equals": value}, row)

    assert judgement["verdict"] == "holds"


def test_an_image_is_found_by_the_name_of_its_file():
    rows = [
        cell("a", light="file", light_options={"file": f"/some/{name}.hdr"}, n_samples=n)
        for name, n in [("grace", 14), ("uffizi", 15)]
    ]

    judgement = verdict_on({**VALUE, "where": {"light": "grace.hdr"}}, *rows)

    assert judgement["verdict"] == "holds"
    assert judgement["numbers"][0]["where"] == "grace.hdr, kurt, sphere"


@pytest.mark.parametrize(
    ("wanted", "actual", "yes"),
    [
        (1, 1.0, True),
        (1, True, False),
        (True, 1, False),
        ([1, 2], 2, True),
        ([1, 2], [1, 2], True),
        ([1, 2], [1, 1], False),
        (1, [1, 1], True),
        (1, [1, 2], False),
        ([[1, 2], [3, 4]], [3, 4], True),
        ([[1, 2], [3, 4]], [4, 3], False),
        (1, [], False),
        ("box", "box", True),
        (["box", None], None, True),
    ],
)
def test_a_value_agrees_if_equal_or_one_of_several_or_spread(wanted, actual, yes):
    assert agrees(wanted, actual) is yes


# slope


def curve(errors, budgets=(4, 16, 64, 256), **changes):
    return [
        cell("a", rms=rms, options={"samples": n, **changes.get("own", {})}, at_noise_floor=rms < 1e-3)
        for n, rms in zip(budgets, errors, strict=True)
    ]


def test_the_slope_is_that_of_the_logarithms():
    judgement = verdict_on(SLOPE, *curve([0.5, 0.25, 0.125, 0.0625]))

    assert judgement["verdict"] == "holds"
    assert judgement["numbers"][0]["a"] == pytest.approx(-0.5)
    assert judgement["numbers"][0]["bound"] == [-0.6, -0.4]


@pytest.mark.parametrize("errors", [[0.5, 0.5, 0.5, 0.5], [1 / 4, 1 / 16, 1 / 64, 1 / 256]])
def test_another_slope_does_not_hold(errors):
    """Twin of the above: no convergence, and the slope of a mistaken square."""
    assert verdict_on(SLOPE, *curve(errors))["verdict"] == "does not hold"


def test_the_slope_is_the_least_squares_one():
    errors = [0.5, 0.2, 0.15, 0.05]

    judgement = verdict_on(SLOPE, *curve(errors))

    expected = np.polyfit(np.log([4, 16, 64, 256]), np.log(errors), 1)[0]
    assert judgement["numbers"][0]["a"] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("noise", "reference", "half"),
    [
        # The last of four points, of x = log 4 times -1.5, -0.5, 0.5, 1.5, moves the slope by 0.3 of its logarithm.
        (0.1, "of all", T7 * 0.1 * 0.3 / np.log(4)),
        (0.1, "another", T7 * 0.1 * 0.3 / np.log(4)),
        (0.0, "of all", 0.0),
    ],
)
def test_the_slope_includes_the_noise(noise, reference, half):
    rows = curve([0.5, 0.25, 0.125], (4, 16, 64))
    rows.append(cell("a", **noisy("rms", 0.0625, noise * 0.0625), options={"samples": 256}, reference_key=reference))

    [number] = verdict_on(SLOPE, *rows)["numbers"]

    assert (number["high"] - number["low"]) / 2 == pytest.approx(half, rel=0.01)


def test_a_slope_whose_interval_contains_a_bound_is_within_noise():
    rows = [*curve([0.5, 0.25, 0.125], (4, 16, 64)), cell("a", **noisy("rms", 0.0625, 0.02), options={"samples": 256})]

    assert verdict_on(SLOPE, *rows)["verdict"] == "within noise"


def test_noise_that_scales_all_points_equally_does_not_move_the_slope():
    rows = [cell("a", **noisy("rms", rms, 0.1 * rms), options={"samples": n})
            for n, rms in zip((4, 16, 64, 256), (0.5, 0.25, 0.125, 0.0625), strict=True)]  # fmt: skip

    judgement = verdict_on(SLOPE, *rows)

    assert judgement["verdict"] == "holds"
    assert judgement["numbers"][0]["high"] - judgement["numbers"][0]["low"] < 1e-9


def test_cells_at_the_noise_floor_do_not_bend_the_slope():
    judgement = verdict_on(SLOPE, *curve([0.5, 0.25, 0.125, 9e-4, 9e-4], (4, 16, 64, 256, 1024)))

    assert judgement["numbers"][0]["a"] == pytest.approx(-0.5)
    assert "cells at the noise floor: 2" in judgement["summary"]


def test_two_points_have_no_slope():
    judgement = verdict_on(SLOPE, *curve([0.5, 0.25, 9e-4, 0.0]))

    assert judgement["verdict"] == "not tested"
    assert judgement["summary"] == "Not tested: cells at the noise floor: 2; curves of fewer than 3 points: 1."


def test_a_swept_option_gives_a_curve_each_and_a_tuned_one_does_not():
    rows = [
        cell("a", rms=scale * n**-0.5, options={"samples": n, "filter": name, "bias": n * scale / 100})
        for name, scale in [("box", 1.0), ("gauss6", 5.0)]
        for n in (4, 16, 64)
    ]

    judgement = verdict_on(SLOPE, *rows)

    assert [n["a"] for n in judgement["numbers"]] == pytest.approx([-0.5, -0.5])
    assert [n["where"] for n in judgement["numbers"]] == [
        "spots, kurt, sphere, filter box",
        "spots, kurt, sphere, filter gauss6",
    ]


@pytest.mark.parametrize("over", ["alpha", "material.alpha"])
def test_a_slope_over_a_parameter_of_the_material_is_one_curve_per_budget(over):
    rows = [
        cell("a", material_options={"alpha": [x, x], "f0": 1.0}, options={"samples": n}, rms=n * x**2)
        for n in (4, 16)
        for x in (0.1, 0.2, 0.4)
    ]

    judgement = verdict_on({**SLOPE, "over": over, "between": [1.9, 2.1]}, *rows)

    assert [n["a"] for n in judgement["numbers"]] == pytest.approx([2, 2])
    assert [n["where"] for n in judgement["numbers"]] == [f"spots, kurt, sphere, samples {n}" for n in (4, 16)]


def test_the_full_name_of_a_parameter_restricts_a_claim():
    rows = [cell(m, material_options={"m": [w, w]}, rms=r) for m, w, r in [
        ("a", 0.1, 0.1), ("b", 0.1, 0.2), ("a", 0.3, 0.3), ("b", 0.3, 0.2)]]  # fmt: skip

    assert verdict_on({**LOWER, "where": {"material.m": 0.1}}, *rows)["verdict"] == "holds"
    assert verdict_on({**LOWER, "where": {"material.m": 0.3}}, *rows)["verdict"] == "does not hold"


def test_a_claim_that_holds_although_cells_failed_says_so_first():
    rows = [cell("a", rms=0.1), cell("b", rms=0.2), cell("a", status="failed", options={"samples": 30}, rms=np.nan),
            cell("b", options={"samples": 30})]  # fmt: skip

    judgement = verdict_on(LOWER, *rows)

    assert judgement["verdict"] == "holds"
    assert judgement["summary"].startswith("Judged without 1 of its cells, which failed. Holds in 1 of 1 cases")


def test_a_claim_of_which_all_cells_failed_is_not_tested():
    judgement = verdict_on(VALUE, cell("a", status="failed", rms=np.nan))

    assert (judgement["verdict"], judgement["summary"]) == ("not tested", "Not tested: cells failed: 1.")


def test_a_tuned_value_is_not_a_stated_one():
    tuned = {"options": {"samples": 14, "bias": 0.0}, "tuned": {"bias": 0.0}}
    tuned |= {"tune": {"bias": {"tune": "rms", "range": [0, 1]}}}
    rows = cell("a", **tuned, rms=0.1), cell("a", options={"samples": 14, "bias": 0.0}, rms=0.5), cell("b", rms=0.2)

    every = verdict_on(LOWER, *rows)
    assert [n["where"] for n in every["numbers"]] == [
        "spots, kurt, sphere, samples 14, bias tuned by rms against b",
        "spots, kurt, sphere, samples 14, bias 0 against b",
    ]
    assert verdict_on({**LOWER, "where": {"bias": 0}}, *rows)["verdict"] == "does not hold"
    best_of_all = {**LOWER, "lower": {"a": {"bias": {"tune": "rms"}}}, "than": {"a": {"bias": 0}}}
    assert verdict_on(best_of_all, *rows)["summary"].startswith("Holds in 1 of 1 cases; rms of a (bias tuned by rms)")


def test_lights_of_one_file_name_are_distinguished_in_verdicts():
    rows = [cell("a", light="file", light_options={"file": f"/{at}/probe.hdr"}, n_samples=n)
            for at, n in (("x", 14), ("y", 15))]  # fmt: skip

    summary = verdict_on(VALUE, *rows)["summary"]

    assert summary.endswith(": 14 to 15; lowest for x/probe.hdr; highest for y/probe.hdr.")


def test_a_sentence_names_only_what_its_cases_do_not_share():
    rows = [
        cell(method, light=light, light_options={"resolution": 64, "contrast": c}, rms=rms)
        for light, c, errors in (("spots", 2, (1, 4)), ("spots", 3, (2, 4)), ("sky", 2, (3, 4)))
        for method, rms in zip("ab", errors, strict=True)
    ]

    assert ": 0.25 to 0.75; lowest for spots with contrast 2; highest for sky." in verdict_on(LOWER, *rows)["summary"]
    of_spots = verdict_on({**LOWER, "where": {"light": "spots"}}, *rows)
    assert of_spots["summary"].endswith(": 0.25 to 0.5; lowest for contrast 2; highest for contrast 3.")


def test_one_case_needs_no_name():
    assert verdict_on(VALUE, cell("a"))["summary"] == "Holds in 1 of 1 cases; n_samples of a: 14."


def test_cells_that_took_other_numbers_of_samples_say_so():
    [number] = verdict_on(LOWER, cell("a", n_samples=19), cell("b", n_samples=17))["numbers"]

    assert number["where"] == "spots, kurt, sphere, samples 14, 19 samples against 17 samples"


def test_budgets_of_two_names_are_both_named():
    rows = [cell(m, rms=rms, options={name: n}, budget=name)
            for m, name, rms in (("a", "samples", 1.0), ("b", "rays", 2.0)) for n in (14, 17)]  # fmt: skip

    assert verdict_on(LOWER, *rows)["numbers"][1]["where"] == "spots, kurt, sphere, samples 17 against rays 17"


def test_a_budget_that_is_not_a_positive_number_is_left_out():
    judgement = verdict_on({**SLOPE, "over": "mode"}, cell("a", options={"mode": "fast"}))

    assert judgement["summary"] == "Not tested: cells without a positive mode: 1."


# ratio and value


@pytest.mark.parametrize(
    ("a", "b", "verdict"),
    [(1.0, 1.0, "holds"), (2.0, 1.0, "holds"), (2.1, 1.0, "does not hold"), (1.0, 3.0, "does not hold")],
)
def test_a_ratio_of_costs_lies_within_bounds(a, b, verdict):
    judgement = verdict_on(RATIO, cell("a", shade_seconds=a), cell("b", shade_seconds=b))

    assert judgement["verdict"] == verdict


@pytest.mark.parametrize(("noise", "verdict"), [(0.09 / T7, "does not hold"), (0.11 / T7, "within noise")])
def test_a_ratio_of_errors_includes_the_noise(noise, verdict):
    claim = {**RATIO, "of": "rms", "between": [None, 2]}

    judgement = verdict_on(claim, cell("a", **noisy("rms", 2.1, noise)), cell("b", rms=1.0))

    assert judgement["verdict"] == verdict


def test_a_ratio_over_zero_is_not_tested():
    judgement = verdict_on({**RATIO, "of": "state_bytes"}, cell("a"), cell("b", state_bytes=0))

    assert judgement["summary"] == "Not tested: pairs whose divisor, state_bytes of b, is zero: 1."


def test_stage_seconds_are_added_up():
    judgement = verdict_on({**VALUE, "of": "stage_seconds"}, cell("a"))

    assert judgement["numbers"][0]["a"] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("claim", "verdict"),
    [
        ({"of": "n_samples", "equals": 14}, "holds"),
        ({"of": "n_samples", "equals": 13}, "does not hold"),
        ({"of": "n_samples", "between": [14, None]}, "holds"),
        ({"of": "rms", "between": [0, 0.2]}, "holds"),
        ({"of": "rms", "between": [0, 0.05]}, "does not hold"),
        ({"of": "rms", "between": [0, 0.1001]}, "within noise"),
        ({"of": "rms", "between": [0, 0.1003]}, "holds"),
        ({"of": "rms", "equals": 0.1001}, "within noise"),
        ({"of": "rms", "equals": 0.1003}, "does not hold"),
        ({"of": "mean_error", "between": [0, 1]}, "holds"),
        ({"of": "relative_rms", "equals": 0.2}, "holds"),
    ],
)
def test_a_value_is_compared_with_its_bounds(claim, verdict):
    assert verdict_on({"value": "a", **claim}, cell("a", **noisy("rms", 0.1, 1e-4)))["verdict"] == verdict


def test_a_tiny_error_is_surely_below_a_bound():
    """No noise can carry it below zero; a signed error it can."""
    known = values(1e-6, 2e-6)
    tiny = cell("a", rms=1e-6, mean_error=1e-6, left_out={"rms": known, "mean_error": known})

    assert verdict_on({"value": "a", "of": "rms", "between": [0, 1]}, tiny)["verdict"] == "holds"
    assert verdict_on({"value": "a", "of": "mean_error", "between": [0, 1]}, tiny)["verdict"] == "within noise"


# not tested


def test_cells_that_did_not_finish_are_counted():
    rows = [cell("a", status="skipped", rms=None), cell("a", status="failed"), cell("b", rms=float("nan"))]

    judgement = verdict_on(LOWER, *rows)

    assert judgement["verdict"] == "not tested"
    assert judgement["numbers"] == []
    assert judgement["summary"] == "Not tested: cells failed: 1; cells skipped: 1; cells without a finite rms: 1."


def test_unfinished_cells_are_reported_with_a_verdict():
    judgement = verdict_on(VALUE, cell("a"), cell("a", material="ggx", status="skipped"))

    assert judgement["verdict"] == "holds"
    assert judgement["summary"].endswith("; cells skipped: 1.")


def test_a_run_without_such_cells_says_so():
    judgement = verdict_on(VALUE, cell("b"))

    assert judgement["summary"] == "Not tested: the run has no cell of this claim."


def test_a_metric_that_was_not_computed_is_not_tested():
    judgement = verdict_on({"value": "a", "of": "flip", "between": [0, 1]}, cell("a"))

    assert judgement["summary"] == "Not tested: cells without a finite flip: 1."


# Which cells are compared.


def compared(a: str, b: str):
    """How many pairs of cells a claim compares, of two methods whose budgets have these names, at 14 and 17 each."""
    rows = [cell(m, rms=rms, options={name or "samples": n}, budget=name)
            for m, name, rms in (("a", a, 1.0), ("b", b, 2.0)) for n in (14, 17)]  # fmt: skip
    return len(verdict_on(LOWER, *rows)["numbers"])


def test_cells_are_paired_at_equal_budgets_of_any_names():
    assert compared("samples", "samples") == 2
    assert compared("rays", "rays") == 2
    assert compared("samples", "rays") == 2


def test_an_option_called_samples_that_is_not_a_budget_pairs_nothing():
    assert compared("samples", "") == 4
    assert compared("", "") == 4
