"""The extent of a claim: groups of cases that are found by hand."""

import pytest

from glossbench.findings.comparisons import EQUAL, FAILS, HOLDS, NOISE
from glossbench.findings.extent import describe_extent

LIGHTS, WIDTHS, SAMPLES = ("spots", "sky", "grace"), (0.1, 0.2, 0.4), (16, 64)


def cases(verdict_of):
    """Three lights, three widths and two numbers of samples, with verdicts by a rule."""
    return [
        {"where": f"{light}, ggx (alpha [{a}, {a}]), samples {n}", "verdict": verdict_of(light, a, n)}
        for light in LIGHTS
        for a in WIDTHS
        for n in SAMPLES
    ]


def by(rule):
    return lambda *given: HOLDS if rule(*given) else FAILS


@pytest.mark.parametrize(
    ("rule", "expected"),
    [
        (lambda light, a, n: light != "sky", "It fails only for sky (6 of 6 cases)"),
        (lambda light, a, n: light != "sky" or n == 64, "It fails only for sky with samples 16 (3 of 3 cases)"),
        (lambda light, a, n: a > 0.1 or light == "sky",
         "It fails only for alpha [0.1, 0.1] (4 of 6 cases)"),
        (lambda light, a, n: n == 64, "It fails only for samples 16 (9 of 9 cases)"),
        (lambda light, a, n: (light, a, n) != ("sky", 0.1, 16),
         "It fails only for sky with alpha [0.1, 0.1] and samples 16 (one case)"),
        (lambda light, a, n: light == "sky", "It holds for sky (6 cases)"),
        (lambda light, a, n: light == "sky" and n == 64, "It holds for sky with samples 64 (3 cases)"),
        (lambda light, a, n: a == 0.1 or light == "sky", "It holds for sky (6 cases), alpha [0.1, 0.1] (6 cases)"),
        (lambda light, a, n: (light, a, n) == ("sky", 0.1, 16), ""),
        (lambda light, a, n: True, ""),
        (lambda light, a, n: False, ""),
    ],
)  # fmt: skip
def test_groups_are_those_of_the_rule(rule, expected):
    assert describe_extent(cases(by(rule))) == expected


def test_cases_that_are_equal_or_within_noise_make_no_group_fail_and_alone_make_none_hold():
    def verdict(light, a, n):
        return {"spots": HOLDS if a == 0.1 else NOISE, "sky": EQUAL, "grace": FAILS if n == 16 else HOLDS}[light]

    assert describe_extent(cases(verdict)) == "It fails only for grace with samples 16 (3 of 3 cases)"
    without_grace = [case for case in cases(verdict) if "grace" not in case["where"]]
    assert describe_extent(without_grace) == ""
    one_more = {"where": "night, ggx (alpha [0.1, 0.1]), samples 16", "verdict": FAILS}
    two = {"where": "noon, ggx (alpha [0.2, 0.2]), samples 64", "verdict": FAILS}
    assert describe_extent([*without_grace, one_more, two]) == "It holds for spots (6 cases)"


def test_only_the_largest_groups_are_named():
    names = [f"light_{i}" for i in range(8)]
    many = [
        {"where": f"{name}, {other}", "verdict": HOLDS if i < 6 else FAILS}
        for i, name in enumerate(names)
        for other in "abcd"
    ]

    found = describe_extent(many)

    assert found == "It holds for " + ", ".join(f"light_{i} (4 cases)" for i in range(4)) + ", 2 smaller groups"


def test_a_group_of_two_words_is_no_small_part_of_all_cases():
    """One of 30 lights holds in one of two halves of its cases: 3 of 180 are found too easily."""
    many = [
        {"where": f"light_{i}, width {a}, samples {n}", "verdict": HOLDS if i == 0 and n == 64 else FAILS}
        for i in range(30)
        for a in WIDTHS
        for n in SAMPLES
    ]

    assert describe_extent(many) == ""
    assert describe_extent(many[:24]) == "It holds for light_0 with samples 64 (3 cases)"
