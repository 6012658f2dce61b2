"""Lines of plots: means over lights, Pareto fronts, and what they would reach at equal times and equal errors."""

from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest

from glossbench.findings.columns import make_metric_column
from glossbench.reports.model.axes import Label, find_places, find_sweeps, with_costs
from glossbench.reports.model.conditions import group_cells
from glossbench.reports.model.equal import compare_errors, compare_times
from glossbench.reports.model.lines import MeasuredLine, find_front, measure_lines
from glossbench.reports.model.panels import Axis
from glossbench.reports.model.plots import plot_over_axis
from glossbench.reports.model.tables import make_equal_table
from glossbench.reports.print.plots import split_facets
from glossbench.reports.style import COLOURS
from oracles.rows_by_hand import RMS, rows


def line(name, index, ms, errors, at_floor=None):
    n = len(ms)
    return MeasuredLine(
        Label(name, index, index, "#000000"),
        np.arange(1.0, n + 1),
        {"shade": np.array(ms, float)},
        np.array(errors, float),
        np.array(at_floor or [False] * n),
    )


def places(given, over="samples"):
    groups = group_cells(given, [make_metric_column("rms")])
    return find_places(groups, find_sweeps(groups)[over])


def mean_of(factors):
    return places(rows(factors))[-1]


def test_each_light_has_a_place_and_all_of_them_one_more():
    found = places(rows([1, 2, 4]))

    assert [len(place.groups) for place in found] == [1, 1, 1, 3]
    assert found[-1].title == "mean over 3 lights, kurt, sphere"
    assert len(places(rows([1]))) == 1


def test_a_line_knows_its_cells_and_all_its_costs():
    first = measure_lines(places(rows([1]))[0], "rms")[0]

    assert first.name == "few"
    assert first.keys == ["few-4-0", "few-16-0", "few-64-0"]
    assert {cost: values.tolist() for cost, values in first.costs.items()} == {
        "shade": [4, 16, 64], "light": [50] * 3, "material": [0] * 3, "geometry": [0] * 3, "view": [0] * 3,
        "memory": [2] * 3,
    }  # fmt: skip
    assert first.band is None


def test_under_one_light_the_interval_of_a_line_is_the_interval_of_its_cells_by_the_logarithm():
    given = rows([1])
    for row in given:
        row["left_out"] = {"rms": [row["rms"], *[0.99 * row["rms"], 1.01 * row["rms"]] * 4]}

    [first, *_] = measure_lines(places(given)[0], "rms")

    half = 2.364624 * 0.01 * 7**0.5  # Student's t of 7 degrees
    assert np.log(first.interval[0] / first.errors) == pytest.approx([-half] * 3, rel=1e-5)
    assert np.log(first.interval[1] / first.errors) == pytest.approx([half] * 3, rel=1e-5)


def test_an_interval_far_wider_than_its_number_is_finite():
    given = rows([1])
    for row in given:
        row["left_out"] = {"rms": [row["rms"], *[-999 * row["rms"], 1001 * row["rms"]] * 4]}

    [first, *_] = measure_lines(places(given)[0], "rms")

    assert np.isfinite(first.interval).all()
    assert (first.interval[0] > 0).all()


def test_the_band_over_lights_is_the_t_interval_of_the_mean_of_log_error():
    check_band(measure_lines(mean_of([0.5, 1, 2, 3]), "rms"))


def test_an_error_of_zero_under_one_light_leaves_no_interval():
    for found in measure_lines(mean_of([0, 1, 2, 3]), "rms"):
        assert (found.errors == 0).all()
        assert np.isnan(found.band).all()


def test_the_check_of_bands_notices_a_normal_interval_and_a_mean_of_errors(monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr("glossbench.reports.model.lines.stdtrit", lambda n, p: NormalDist().inv_cdf(p))
        with pytest.raises(AssertionError):
            check_band(measure_lines(mean_of([0.5, 1, 2, 3]), "rms"))
    monkeypatch.setattr("glossbench.reports.model.lines.np.log", lambda x: x)
    monkeypatch.setattr("glossbench.reports.model.lines.np.exp", lambda x: x)
    with pytest.raises(AssertionError):
        check_band(measure_lines(mean_of([0.5, 1, 2, 3]), "rms"))


def check_band(lines):
    """By the tables t is 3.182446 for 3 degrees of freedom and 95 % between both sides; logarithms to base 10."""
    for found in lines:
        for i, rms in enumerate(RMS[found.name]):
            logs = np.log10(rms * np.array([0.5, 1, 2, 3]))
            half = 3.182446 * np.sqrt(np.sum((logs - logs.mean()) ** 2) / 3 / 4)
            low, high = logs.mean() - half, logs.mean() + half
            assert found.errors[i] == pytest.approx(10 ** logs.mean(), rel=1e-12)
            assert (found.band[0][i], found.band[1][i]) == pytest.approx((10**low, 10**high), rel=1e-6)
        assert not found.keys


def test_two_lights_have_a_mean_and_no_band():
    first = measure_lines(mean_of([1, 4]), "rms")[0]

    assert first.errors == pytest.approx(2 * np.array(RMS["few"]))
    assert first.band is None


def test_the_front_is_what_no_other_point_beats():
    rng = np.random.default_rng(5)
    lines = [line("a", 0, rng.integers(1, 9, 40), rng.integers(1, 9, 40)),
             line("b", 1, rng.integers(1, 9, 40), rng.integers(1, 9, 40))]  # fmt: skip

    masks = find_front(lines, "shade", Axis("rms"))

    check_front(lines, masks)
    with pytest.raises(AssertionError):  # one point more
        check_front(lines, [np.append(True, masks[0][1:]) if not masks[0][0] else ~masks[0], masks[1]])


def check_front(lines, masks):
    """By its definition, point by point, over a grid full of ties."""
    points = [(x, y) for each in lines for x, y in zip(each.costs["shade"], each.errors, strict=True)]
    for point, is_on in zip(points, np.concatenate(masks), strict=True):
        others = [other for other in points if other != point]
        assert is_on == (not any(other[0] <= point[0] and other[1] <= point[1] for other in others))


def test_at_the_noise_floor_a_lower_number_is_not_better():
    cheap, costly = line("cheap", 0, [1], [0.019], [True]), line("costly", 1, [5], [0.01], [True])

    masks = find_front([cheap, costly], "shade", Axis("rms", floor=0.02))

    assert [mask.tolist() for mask in masks] == [[True], [False]]


def test_a_metric_that_is_higher_for_better_images_has_its_front_above():
    masks = find_front([line("a", 0, [1, 2, 3], [0.5, 0.9, 0.7])], "shade", Axis("ssim", is_log=False))

    assert masks[0].tolist() == [True, True, False]


# Equal time, equal error. Errors are powers of time, so that between points the true value is known.


def powers():
    t = np.array([1.0, 7.0, 40.0, 300.0])
    return [line("half", 0, t, 2 * t**-0.5), line("one", 1, t, 5 * t**-1.0)], Axis("rms")


def test_equal_time_is_exact_for_power_laws():
    check_equal(compare_errors(*powers()), lambda t: (2 * t**-0.5, 5 / t))


def test_equal_error_is_exact_for_power_laws():
    check_equal(compare_times(*powers()), lambda e: ((2 / e) ** 2, 5 / e))


def test_the_check_of_equal_tables_notices_straight_lines_on_linear_axes(monkeypatch):
    for name in ("np.log", "exp", "log"):
        monkeypatch.setattr(f"glossbench.reports.model.equal.{name}", lambda x: x)

    with pytest.raises(AssertionError):
        check_equal(compare_errors(*powers()), lambda t: (2 * t**-0.5, 5 / t))


def check_equal(table, truth):
    assert 3 <= len(table.at) <= 6
    for column, at in enumerate(table.at):
        values = [row[column].middle for row in table.rows]
        assert values == pytest.approx(truth(at), rel=1e-12)
        assert table.best[column] == values.index(min(values))


def test_nothing_is_extrapolated():
    short, long = line("short", 0, [1, 10], [1, 0.1]), line("long", 1, [5, 500], [1, 0.01])

    by_time = compare_errors([short, long], Axis("rms"))
    by_error = compare_times([short, long], Axis("rms"))

    assert list(by_time.at) == [5, 7, 10]
    assert list(by_error.at) == [1, 0.5, 0.2, 0.1]


def test_the_first_time_counts_where_a_line_comes_down_twice():
    wavy = line("wavy", 0, [1, 10, 100, 1000], [1, 0.1, 0.4, 0.05])

    table = compare_times([wavy, line("other", 1, [1, 1000], [1, 0.01])], Axis("rms"))

    assert table.rows[0][list(table.at).index(0.2)].middle == pytest.approx(5)


def test_points_at_the_floor_are_not_interpolated():
    floored = line("floored", 0, [1, 10, 100], [1, 0.1, 0.09], [False, False, True])

    table = compare_errors([floored, line("other", 2, [1, 100], [1, 0.5])], Axis("rms"))

    assert [each.name for each in table.lines] == ["floored", "other"]
    assert max(table.at) <= 10


def test_a_line_of_one_budget_has_its_own_error_at_any_time_that_suffices_for_it():
    lines = [line("curve", 0, [1, 100], [1, 0.1]), line("single", 1, [3], [0.3])]

    by_time, by_error = compare_errors(lines, Axis("rms")), compare_times(lines, Axis("rms"))

    singles = {at: row.middle for at, row in zip(by_time.at, by_time.rows[1], strict=True)}
    assert singles == pytest.approx({5: 0.3, 10: 0.3, 20: 0.3, 50: 0.3, 100: 0.3})  # none before 3 ms
    singles = {at: row and row.middle for at, row in zip(by_error.at, by_error.rows[1], strict=True)}
    assert singles == pytest.approx({1: 3, 0.7: 3, 0.5: 3, 0.4: 3, 0.3: 3})  # and no less, which it does not reach


def test_two_lines_of_one_budget_meet_at_the_first_round_time_after_both():
    table = compare_errors([line("a", 0, [3], [0.3]), line("b", 1, [11], [0.1])], Axis("rms"))

    assert (list(table.at), table.best) == ([15], [1])


def test_a_line_between_the_columns_is_there_and_keeps_others_from_being_the_best():
    """31 to 39 ms: between 30 and 40; from there on the single point is the lowest of those with a number."""
    short, wide = line("short", 0, [31, 39], [0.02, 0.01]), line("wide", 1, [1, 60], [2, 1])

    table = compare_errors([short, wide, line("sole", 2, [20], [0.1])], Axis("rms"))

    assert [each.name for each in table.lines] == ["short", "wide", "sole"]
    assert table.rows[0] == [None] * len(table.at)
    assert dict(zip(table.at, table.best, strict=True)) == {20: 2, 30: 2, 40: None, 50: None}


def test_a_line_without_a_number_that_did_not_come_lower_leaves_the_best_alone():
    table = compare_errors([line("early", 0, [1, 3], [2, 1]), *powers()[0]], Axis("rms"))

    assert table.rows[0][-1] is None
    assert table.best[-1] == 2


def test_heads_of_equal_tables_in_print_are_the_columns_themselves():
    table = compare_times([line("a", 0, [1, 10], [4, 1]), line("b", 1, [1, 10], [4, 1])], Axis("rms"))

    heads = [head.title for head in make_equal_table(table, "", "", 9).heads]
    assert (heads, len(set(heads))) == (["4", "3", "2", "1.5", "1"], 5)


def spread(of, low, high):
    return replace(of, spread=(of.costs["shade"] * low, of.costs["shade"] * high))


def test_no_line_is_the_best_where_the_spread_of_its_runs_reaches_another():
    check_spread([spread(each, 0.5, 2) for each in powers()[0]])


def test_the_check_of_spreads_notices_times_without_one():
    with pytest.raises(AssertionError):
        check_spread(powers()[0])


def check_spread(lines):
    """Errors 2 t^-1/2 and 5 / t are equal at 6.25 ms; with times off by 2 one interval ends where the other begins."""
    axis = Axis("rms")
    (column,) = (i for i, at in enumerate(compare_errors(lines, axis).at) if at == 10)
    half, one = (row[column] for row in compare_errors(lines, axis).rows)
    assert compare_errors(lines, axis).best[column] is None
    assert tuple(one) == pytest.approx((0.5, 0.25, 1))
    assert half.low < half.middle < half.high
    assert compare_errors(lines, axis).best[-1] == 1  # far from there one is the better


def test_a_time_that_the_slowest_run_exceeds_makes_no_best():
    fast = spread(line("fast", 0, [4, 100], [0.1, 0.05]), 0.9, 2)
    slow = spread(line("slow", 1, [1, 200], [2, 1]), 1, 1)

    table = compare_errors([fast, slow], Axis("rms"))

    assert (table.at[0], table.best[0], table.rows[0][0].high) == (5, None, np.inf)
    assert table.best[1:] == [0] * (len(table.at) - 1)


# What is swept.


def swept(cells, **shared):
    """Rows of one method or more: of each (changes of columns, options, error)."""
    found = []
    for i, (columns, options, rms) in enumerate(cells):
        row = rows([1])[0] | {"key": f"k{i}", "options": options, "rms": rms, "n_samples": options.get("samples", 1)}
        found.append(row | shared | columns)
    return found


def over_s(errors, light=0):
    """A filter's error over the exponents of materials that are otherwise one."""
    return [
        ({"light_options": {"seed": light}, "material_options": {"s": s, "kd": [0, 0]}}, {"mip_filter": name}, rms)
        for name, by_s in errors.items()
        for s, rms in by_s.items()
    ]


ERRORS = {"box": {1: 0.4, 4: 0.2, 16: 0.1, 64: 0.05}, "none": {1: 0.5, 4: 0.5, 16: 0.5, 64: 0.5}}


def test_materials_that_differ_in_one_number_are_one_place_with_one_line_per_method():
    check_material(swept(over_s(ERRORS)))


def test_the_check_of_materials_notices_another_difference_and_a_wrong_order():
    other = [
        row | {"material_options": row["material_options"] | {"kd": [row["material_options"]["s"] == 4, 0]}}
        for row in swept(over_s(ERRORS))
    ]
    turned = ERRORS | {"box": dict(zip(ERRORS["box"], [0.05, 0.1, 0.2, 0.4], strict=True))}

    for fault in (other, swept(over_s(turned))):
        with pytest.raises(AssertionError):
            check_material(fault)


def check_material(given):
    (place,) = places(given[::-1], "material.s")  # in any order
    lines = {line.name: line for line in measure_lines(place, "rms")}
    assert place.title == "spots, kurt, sphere"
    assert {name.partition("mip_filter ")[2][:-1] for name in lines} == set(ERRORS)
    for name, line in lines.items():
        by_s = ERRORS[name.partition("mip_filter ")[2][:-1]]
        assert dict(zip(line.x, line.errors, strict=True)) == by_s
        assert list(line.x) == sorted(by_s)
        keys = {row["key"]: row["material_options"]["s"] for row in given}
        assert [keys[key] for key in line.keys] == list(line.x)
        assert line.slope() == pytest.approx(-0.5 if by_s[64] == 0.05 else 0)


def test_over_a_material_lights_have_a_mean():
    given = swept(over_s(ERRORS)) + [row | {"key": row["key"] + "b"} for row in swept(
        over_s({name: {s: 4 * rms for s, rms in by_s.items()} for name, by_s in ERRORS.items()}, light=1))]  # fmt: skip

    *each, mean = places(given, "material.s")

    assert len(each) == 2
    assert mean.title == "mean over 2 lights, kurt, sphere"
    assert measure_lines(mean, "rms")[0].errors == pytest.approx(2 * np.array([0.4, 0.2, 0.1, 0.05]))


def test_options_with_numbers_are_swept_and_the_others_distinguish_lines():
    given = swept([({}, {"regions": n, "storage": kind}, 1 / n) for kind in ("cube", "map") for n in (24, 48, 96)])

    (place,) = places(given, "regions")

    assert [line.name for line in measure_lines(place, "rms")] == ["few (storage cube)", "few (storage map)"]
    assert [line.slope() for line in measure_lines(place, "rms")] == pytest.approx([-1, -1])


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ([{"k": 1}, {"k": 2}], {"samples": 1, "k": 2}),
        ([{"k": True}, {"k": False}], {"samples": 1}),
        ([{"seed": 1}, {"seed": 2}], {"samples": 1}),
        ([{"m": [0.1, 0.1]}, {"m": [0.2, 0.2]}, {"m": [0.2, 0.1]}], {"samples": 1, "m": 2}),
        ([{"k": 1, "name": "a"}, {"k": 2, "name": "b"}], {"samples": 1, "k": 2}),  # a pair
        ([{"k": k, "name": "b" if k > 3 else "a"} for k in (1, 2, 3, 4)], {"samples": 1, "k": 3}),  # none
        ([{"samples": n, "name": "b" if n > 3 else "a"} for n in (1, 2, 3, 4)], {"samples": 4}),
        ([{"k": 1, "j": 1}, {"k": 2, "j": 1}, {"k": 1, "j": 2}], {"samples": 1, "k": 2, "j": 2}),
        ([{"samples": 4, "xi": 0.2}, {"samples": 8, "xi": 0.1}], {"samples": 2, "xi": 2}),
    ],
)
def test_numbers_that_cells_differ_in_alone_are_swept(options, expected):
    given = swept([({}, each, 0.1) for each in options])

    assert {
        name: sweep.n_values for name, sweep in find_sweeps(group_cells(given, [make_metric_column("rms")])).items()
    } == expected


def test_what_is_tuned_is_not_swept():
    given = swept([({"tuned": {"bias": bias}}, {"bias": bias}, 0.1) for bias in (0.1, 0.2, 0.3)])

    assert list(find_sweeps(group_cells(given, [make_metric_column("rms")]))) == ["samples"]


@pytest.mark.parametrize(
    ("sizes", "claims", "first"),
    [
        ({"samples": 3, "k": 4}, [], "samples"),
        ({"samples": 3, "k": 4}, [{"lower": "few"}, {"slope": "few", "over": "k"}], "k"),
        ({"samples": 2, "k": 4, "j": 3}, [], "k"),
        ({"k": 2}, [], "samples"),
        ({"k": 3}, [{"slope": "few", "over": "j"}], "k"),
    ],
)
def test_the_first_axis_is_that_of_claims_then_samples_then_that_with_the_most_values(sizes, claims, first):
    grid = [dict(zip(sizes, values, strict=True)) for values in np.ndindex(*sizes.values())]
    given = swept([({}, {key: int(value) + 1 for key, value in each.items()}, 0.1) for each in grid])

    assert next(iter(find_sweeps(group_cells(given, [make_metric_column("rms")]), claims))) == first


@pytest.mark.parametrize(
    ("cells", "expected"),
    [
        ([({}, {"samples": n, "k": k}, 0.1) for n in (4, 16) for k in (1, 2, 4)], ["samples"]),
        ([({"n_samples": n}, {"regions": n}, 0.1) for n in (24, 48, 96)], ["samples", "regions"]),
        (over_s(ERRORS), ["samples"]),
    ],
)
def test_errors_are_against_costs_along_budgets_under_one_condition(cells, expected):
    assert [
        sweep.name for sweep in with_costs(find_sweeps(group_cells(swept(cells), [make_metric_column("rms")])))
    ] == expected


def test_no_slope_is_fitted_where_x_is_not_positive():
    given = swept([({}, {"bias": bias}, 0.1 * (bias + 2)) for bias in (-1, 0, 1, 2)])

    (line,) = measure_lines(places(given, "bias")[0], "rms")

    assert list(line.x) == [-1, 0, 1, 2]
    assert line.slope() is None


def test_many_lines_have_a_facet_for_those_that_share_the_option_that_divides_them_most_evenly():
    names = [(f, kind) for f in ("none", "box", "gauss", "cosine") for kind in ("cube", "map")]
    given = swept([({}, {"filter": f, "storage": kind, "k": k}, 0.1) for f, kind in names for k in (1, 2, 3)])

    labels = [line.label for line in measure_lines(places(given, "k")[0], "rms")]

    assert [label.facet for label in labels] == [0, 1] * 4
    few = [line.label for line in measure_lines(places(given[:9], "k")[0], "rms")]
    assert [label.facet for label in few] == [None] * 3


def test_a_method_of_one_budget_is_in_every_facet():
    names = [(f, kind) for f in ("none", "box", "gauss", "cosine") for kind in ("cube", "map")]
    given = swept([({}, {"filter": f, "storage": kind, "k": k}, 0.1) for f, kind in names for k in (1, 2, 3)])
    given += [given[0] | {"method": "lookup", "key": f"l{k}", "options": {"k": k}} for k in (1, 2, 3)]

    (place,) = places(given, "k")
    panels = split_facets([plot_over_axis(place, "rms", measure_lines(place, "rms"))])

    assert [panel.title for panel in panels] == ["storage cube", "storage map"]
    assert all("lookup" in [line.label.name for line in panel.drawn] for panel in panels)


def test_a_single_budget_is_in_the_name_of_a_line_if_other_lines_are_named_by_their_budgets():
    def named_at(others):
        given = swept([({"method": "fis"}, {"k": k, "samples": n}, 0.1) for k in (1, 2) for n in others])
        given += swept([({"method": "is", "key": f"is {k}"}, {"k": k, "samples": 16}, 0.1) for k in (1, 2)])
        return [line.name for line in measure_lines(places(given, "k")[0], "rms")]

    assert named_at((8, 32)) == ["fis (samples 8)", "fis (samples 32)", "is (samples 16)"]
    assert named_at((16,)) == ["fis", "is"]


def test_a_colour_is_a_method_and_its_lines_are_shades_and_dashes():
    given = swept(
        [({"method": name}, {"filter": f, "samples": n}, 0.1)
         for name in ("a", "b") for f in (("none", "box", "gauss") if name == "a" else ("box",)) for n in (1, 2)]
    )  # fmt: skip

    labels = [line.label for line in measure_lines(places(given)[0], "rms")]

    assert [label.method for label in labels] == [0, 0, 0, 1]
    assert [label.dash for label in labels] == [0, 1, 2, 0]
    assert labels[1].colour == COLOURS[0]
    assert labels[3].colour == COLOURS[1]
    red, green, blue = ([int(label.colour[i : i + 2], 16) for label in labels[:3]] for i in (1, 3, 5))
    assert all(channel == sorted(channel) for channel in (red, green, blue))  # from dark to light
    assert len({label.colour for label in labels}) == 4
