"""What a first glance and a spreadsheet are given: the picture of the answer, the CSV of all cells."""

import io

import numpy as np
import pandas as pd
import pytest

from glossbench.findings.columns import make_metric_column
from glossbench.reports.model.answer import find_answer
from glossbench.reports.model.conditions import group_cells
from glossbench.reports.model.spreadsheet import make_csv
from glossbench.reports.style import polar
from oracles.rows_by_hand import rows


def answer(given):
    return find_answer(group_cells(given, [make_metric_column("rms")]), "rms")


def test_the_answer_is_where_methods_differ_most_relative_to_the_mean_of_the_reference():
    check_answer(answer(told([1, 2, 10], means=[1.0, 0.1, 10.0])))


def test_the_check_of_the_answer_notices_absolute_differences():
    with pytest.raises(AssertionError):
        check_answer(answer(told([1, 2, 10], means=[1.0, 1.0, 1.0])))


def told(factors, means):
    """Errors of both methods differ by 0.4, 0.2 and 0.03 at 4, 16 and 64 samples, times the factor of the light."""
    return [row | {"reference_mean": means[int(row["reference_key"][1:])]} for row in rows(factors)]


def check_answer(found):
    assert found.group.reference["reference_key"] == "r1"
    assert found.budget == "4 samples"
    assert [cell.row["key"] for cell in found.cells] == ["few-4-1", "many-4-1"]


def test_a_budget_that_more_methods_share_comes_first():
    given = [row for row in rows([1]) if row["key"] != "many-4-0"]

    assert answer(given).budget == "16 samples"


def test_a_method_without_a_budget_is_shown_with_every_budget():
    given = rows([1])
    lookup = given[0] | {"key": "lookup", "method": "lookup", "options": {}, "rms": 0.41}

    assert [cell.row["key"] for cell in answer([*given, lookup]).cells] == ["few-4-0", "many-4-0", "lookup"]


def test_the_answer_is_of_the_budget_and_the_place_that_the_claim_is_about():
    groups = group_cells(rows([1, 2]), [make_metric_column("rms")])

    found = find_answer(groups, "rms", [("nothing ran", ()), ("at 64", {"few-64-1", "many-64-1"})])

    assert (found.budget, found.claim) == ("64 samples", "at 64")
    assert [cell.row["key"] for cell in found.cells] == ["few-64-1", "many-64-1"]


def test_the_answer_shows_the_claim_s_cells_of_its_methods_and_the_best_of_others():
    given = [row | {"options": {"samples": row["n_samples"], "k": k}, "key": f"{row['key']}-{k}", "rms": row["rms"] * k}
             for row in rows([1]) for k in (1, 2)]  # fmt: skip

    found = find_answer(group_cells(given, [make_metric_column("rms")]), "rms", [("few with k 2", {"few-16-0-2"})])

    assert [cell.row["key"] for cell in found.cells] == ["few-16-0-2", "many-16-0-1"]


def test_a_budget_has_the_name_that_the_rows_give_it():
    given = [row | {"options": {"rays": row["n_samples"], "samples": 9}, "budget": "rays"} for row in rows([1])]

    assert answer(given).budget == "4 rays"


def test_a_single_method_shows_its_best_its_worst_and_some_between():
    one = rows([1])[0]
    given = [one | {"key": f"{i}", "options": {"samples": 4, "k": i}, "rms": 1.0 + i} for i in range(9)]

    assert [cell.row["key"] for cell in answer(given).cells] == ["0", "2", "4", "6", "8"]


def test_without_an_image_there_is_no_answer():
    assert answer([row | {"status": "failed"} for row in rows([1])]) is None


def test_a_spreadsheet_reads_no_name_as_a_formula():
    csv = make_csv(pd.DataFrame({"method": ["=HYPERLINK()", "@x", "plain"], "mean_error": [-0.1, 1 / 3, 2.0]}))

    table = pd.read_csv(io.BytesIO(csv))
    assert table.method.tolist() == ["'=HYPERLINK()", "'@x", "plain"]
    assert table.mean_error.tolist() == [-0.1, 1 / 3, 2.0]


def test_half_vectors_stand_on_a_disc_by_theta_and_phi():
    half_vectors = np.radians([[0, 50], [10, 90], [20, 180], [5, -90]])

    assert polar(half_vectors, 20) == [(0, 0), (0, -50), (-100, 0), (0, 25)]  # y goes down
