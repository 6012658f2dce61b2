"""The decision of a report: which method to take, ranks at equal budgets, fronts in numbers and as a figure."""

import json

import pandas as pd
import pytest

from glossbench.reports.figures.fronts import Fronts
from glossbench.reports.model.decision import decide
from glossbench.reports.model.report import Report
from glossbench.run.results import Results
from oracles.discs import three_lights


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three lights; the second is the only one under which split_sum has the lowest error."""
    folder = three_lights(tmp_path_factory.mktemp("decision") / "discs")
    cells = pd.read_parquet(folder / "cells.parquet")
    cells["at_noise_floor"], cells["processor"] = False, "Abacus 3"
    cells.loc[(cells.method == "split_sum") & (cells.reference_key == "ref1"), "rms"] = 0.03
    light = cells.method.eq("split_sum").map({True: 0.5, False: 0.0143})
    cells["update_seconds"] = [json.dumps({"light": seconds}) for seconds in light]
    cells.to_parquet(folder / "cells.parquet")
    return folder


def report_of(folder, keep):
    """The report of some of the rows."""
    report = Report.from_results(Results(folder))
    rows = [row for row in report.rows if keep(row)]
    return Report(
        **{name: getattr(report, name) for name in report.__dataclass_fields__ if name[0] != "_"} | {"rows": rows}
    )


@pytest.fixture(scope="module")
def report(folder):
    return Report.from_results(Results(folder))


def texts(part):
    return {row.names[0]: [entry.text for entry in row.entries] for row in part.rows}


def test_for_each_change_a_method_is_told_from_each_time_on(report):
    table = decide(report).table

    assert [part.title for part in table.parts] == [
        "Nothing, your material, your geometry or your view changes in each frame", "Your light changes in each frame",
    ]  # fmt: skip
    still, moving = map(texts, table.parts)
    assert list(still) == ["regular_sampling (samples 4)", "filtered_importance_sampling (samples 64)"]
    assert [still[name][0] for name in still] == ["0.400", "6.40"]
    assert [moving[name][0] for name in moving] == ["14.7", "20.7"]
    assert still["regular_sampling (samples 4)"][-1] == "spots (seed 1): split_sum"
    assert moving["regular_sampling (samples 4)"][-1] == ""  # with its update split_sum takes longer


def test_ranks_are_those_of_one_budget_and_say_where_the_front_splits(report):
    table = decide(report).ranks

    assert [part.title for part in table.parts] == ["budget 4", "budget 64"]
    assert [head.title for head in table.heads] == ["rank", "rms", "time", "light", "memory"]
    first = {row.names[0]: row.entries for row in table.parts[0].rows}
    # Third under two lights and first under one.
    assert {name: entries[0].text for name, entries in first.items()} == {
        "regular_sampling (samples 4)": "1.3", "filtered_importance_sampling (samples 4)": "2.3", "split_sum": "2.3",
    }  # fmt: skip
    assert (first["split_sum"][2].text, first["split_sum"][2].note) == ("1 of 3", "spots (seed 1)")


def test_the_processor_and_what_is_not_compared_are_told(report):
    explained = decide(report).explained

    assert "on Abacus 3." in explained
    assert "3 conditions (3 lights, 1 material, 1 view)" in explained
    assert "Not compared, because an image or a time is missing: lighting_factorization, broken." in explained


def test_without_two_methods_there_is_nothing_to_decide(folder):
    assert decide(report_of(folder, lambda row: row["method"] == "regular_sampling")) is None
    assert decide(report_of(folder, lambda row: row["status"] != "done")) is None


def test_a_figure_of_fronts_marks_what_no_other_configuration_is_better_than(report):
    found = Fronts().data(report, metric="rms", over=next(iter(report.axes.values())))

    shade = found.panels[0]
    assert [panel.name for panel in found.panels] == ["front shade", "front light", "front memory"]
    assert {line.label.name: mask.tolist() for line, mask in zip(shade.lines, shade.fronts, strict=True)} == {
        "regular_sampling": [True, False], "filtered_importance_sampling": [False, True], "split_sum": [True],
    }  # fmt: skip


def test_one_condition_has_no_figure_of_fronts(folder):
    report = report_of(folder, lambda row: row["reference_key"] == "ref0")

    assert Fronts().data(report, metric="rms", over=next(iter(report.axes.values()))).panels == ()
