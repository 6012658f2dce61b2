"""What is declared once appears everywhere: a column of the results in each table, a figure in page, PDF and file."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from markupsafe import Markup

from glossbench.columns import Column
from glossbench.findings.columns import collect_columns, columns_to_json
from glossbench.findings.descriptions import describe_study
from glossbench.reports import style
from glossbench.reports.figure import FIGURES, Figure
from glossbench.reports.model.cell_table import list_costs, list_counts, list_errors, make_cell_table
from glossbench.reports.model.descriptions import INSTALLED, describe_methods
from glossbench.reports.model.options import AxisOption, MetricOption, PlaceOption
from glossbench.reports.model.panels import Axis, Line, Panel, Panels
from glossbench.reports.model.plots import plot_over_axis
from glossbench.reports.model.report import Report
from glossbench.reports.page import html, payload
from glossbench.reports.page.plot_data import plot_data
from glossbench.reports.print import pdf
from glossbench.run.results import Results
from oracles.discs import write_results
from oracles.pdf_pages import text_of

METRICS = ["rms", "relative_rms", "mean_error", "max_error"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Results whose run knew a cost and a count that this version does not know."""
    folder = write_results(tmp_path_factory.mktemp("columns") / "discs", budgets=(4, 16))
    cells = pd.read_parquet(folder / "cells.parquet")
    cells["baking_seconds"] = np.arange(len(cells)) * 1e-3 + 0.7654321
    cells["n_rays"] = 12345 + np.arange(len(cells))
    cells.to_parquet(folder / "cells.parquet")
    columns = collect_columns(METRICS) | {
        "baking_seconds": Column("baking_seconds", float, "ms", 1e3, "cost", "baking"),
        "n_rays": Column("n_rays", int, role="count", title="rays"),
    }
    (folder / "columns.json").write_text(json.dumps(columns_to_json(columns)))
    return folder


@pytest.fixture
def report(folder):
    return Report.from_results(Results(folder))


def test_a_cost_that_the_run_declared_is_a_column_in_its_own_unit(report):
    check_baking(report)


def test_the_check_of_units_notices_stored_values_that_are_shown(folder):
    report = Report.from_results(Results(folder))
    column = report.columns["baking_seconds"]
    report.columns["baking_seconds"] = Column(column.name, float, "ms", 1.0, "cost", "baking")

    with pytest.raises(AssertionError):
        check_baking(report)


def check_baking(report):
    table = make_cell_table(report, list_costs(report), 99)
    place = [head.title for head in table.heads].index("baking")
    shown = [row.entries[place].text for part in table.parts for row in part.rows if not row.outcome]
    assert table.heads[place].unit == "ms"
    assert shown[:3] == ["765", "766", "767"]


def test_page_print_and_spreadsheet_have_the_columns_that_the_run_declared(folder, monkeypatch):
    monkeypatch.setattr(pdf, "_arrange_plots", lambda *_: ([], []))
    monkeypatch.setattr(pdf, "_arrange_images", lambda *_: (None, []))
    monkeypatch.setattr(style, "to_svg", lambda *_: "")
    monkeypatch.setattr(html, "build_payload", lambda *_: payload.Payload(Markup("{}"), {}, frozenset()))

    page = html.write_report(folder).read_text(encoding="utf-8")
    printed = text_of(pdf.write_report(folder).read_bytes())

    assert ">rays</th>" in page
    assert '>baking<span class="unit">ms</span></th>' in page
    for text in (page, printed):
        assert "12 345" in " ".join(text.split())
        assert "765" in text
    assert "baking [ms]" in printed
    assert Report.from_results(Results(folder)).results.cells.n_rays[0] == 12345


def test_columns_of_errors_counts_and_costs_are_known_by_their_roles(report):
    def names(quantities):
        return [quantity.head.column for quantity in quantities]

    assert names(list_counts(report)) == ["n_samples", "n_rays"]
    assert names(list_errors(report, ["rms"])) == ["rms"]
    assert list(dict.fromkeys(names(list_costs(report)))) == [
        "shade_seconds", "stage_seconds", "update_seconds", "state_bytes", "baking_seconds",
    ]  # fmt: skip


@pytest.fixture
def speed(monkeypatch):
    """A figure of a plug-in: samples per millisecond over samples."""
    monkeypatch.setattr(FIGURES, "_classes", dict(FIGURES._classes))

    @FIGURES.register("speed")
    class Speed(Figure):
        """Samples per millisecond."""

        options = {"metric": MetricOption(), "over": AxisOption(), "group": PlaceOption()}  # noqa: RUF012

        def data(self, report, metric, over, group):
            lines = [Line(each.label, each.x, each.x / each.costs["shade"]) for each in report.lines(group, metric)]
            return Panels([Panel("speed", Axis("samples"), Axis("samples per ms"), lines)], "and its speed")

    return Speed


def test_a_figure_is_in_page_print_and_a_separate_file(speed, report, tmp_path):
    page = plot_data(report)
    printed = [caption for _, caption in pdf._plot_at(report, report.places(report.axes["samples"]))]
    FIGURES.get("speed")().write(report.results, tmp_path / "speed.svg", group=1)

    panels = [panel for figure in page["figures"] for case in figure["cases"] for panel in case["panels"]]
    drawn = [panel for panel in panels if panel["name"] == "speed"]
    # Under each of four metrics at each of two materials.
    assert len(drawn) == 8
    assert page["pool"][drawn[0]["y"]]["label"] == "samples per ms"
    assert page["pool"][drawn[0]["lines"][0][1]] == [10, 10]  # 4 samples in 0.4 ms
    assert all("and its speed" in caption for caption in printed)
    assert (tmp_path / "speed.svg").read_text().startswith("<svg")


def test_the_page_draws_a_figure_of_somebody_else(speed, browser, folder):
    with browser.open(html.write_report(folder)) as page:
        page.wait("document.querySelectorAll('.plots [data-x=\"speed\"] .point').length > 0")

        assert page.do("document.querySelectorAll('.plots [data-x=\"speed\"] .point').length") == 5
        assert page.complaints() == []


def test_equal_values_are_stored_once_in_the_page(report):
    data = plot_data(report)

    texts = [json.dumps(value) for value in data["pool"]]
    assert len(set(texts)) == len(texts)
    assert data == plot_data(Report.from_results(report.results))


# Intervals. Errors against the whole reference and without each of four groups, of which statistics is by hand.

LEFT_OUT = [2.0, 2.1, 1.9, 2.2, 1.8]


def test_tables_show_half_the_interval_of_a_number_and_plots_show_its_ends(folder):
    check_interval(Report.from_results(Results(folder)))


def test_the_check_of_intervals_notices_a_standard_error_in_the_place_of_half_an_interval(folder, monkeypatch):
    monkeypatch.setattr("glossbench.findings.estimates.Estimate.half_width", property(lambda e: e.standard_error))

    with pytest.raises(AssertionError):
        check_interval(Report.from_results(Results(folder)))


def check_interval(report):
    """The variance is 3/4 of the sum of (0.1, -0.1, 0.2, -0.2) squared; t of 3 degrees is 3.182446."""
    half = 3.182446 * (0.75 * 0.1) ** 0.5
    row = report.done[0].done[0].row
    row["left_out"] = {"rms": LEFT_OUT}
    table = make_cell_table(report, list_errors(report, ["rms"]), 99)
    place = report.places(report.axes["samples"])[0]
    (line, *_) = plot_over_axis(place, "rms", report.lines(place, "rms")).lines
    assert table.parts[0].rows[0].entries[0].note == f"± {half:.2f}"
    low, high = line.interval
    assert (low[0], high[0]) == pytest.approx((2 * np.exp(-half / 2), 2 * np.exp(half / 2)), rel=1e-6)


def test_without_groups_there_is_no_interval(report):
    place = report.places(report.axes["samples"])[0]
    table = make_cell_table(report, list_errors(report, ["rms"]), 99)

    assert {entry.note for row in table.parts[0].rows for entry in row.entries} == {""}
    assert all(line.interval is None for line in plot_over_axis(place, "rms", report.lines(place, "rms")).lines)


# What the run knew.


def test_reports_print_the_words_of_the_run_and_not_of_what_is_installed(folder):
    known = describe_study(Results(folder).study)
    own = replace(known.find("method", "regular_sampling"), text="Drawn by lot.", source="Cook 1986.", equation="")
    (folder / "described.json").write_text(json.dumps(replace(known, described=(own,)).as_dict()))
    try:
        report = Report.from_results(Results(folder))
        (first, *_) = describe_methods([own.name], report.descriptions)
    finally:
        (folder / "described.json").unlink()

    assert "".join(run.text for run in first.text[0]) == "Drawn by lot."
    assert first.source == "Cook 1986."
    assert report.descriptions.is_of_run


def test_older_results_have_the_descriptions_of_installed_methods_with_a_note(folder, monkeypatch):
    monkeypatch.setattr(style, "to_svg", lambda *_: "")
    monkeypatch.setattr(html, "build_payload", lambda *_: payload.Payload(Markup("{}"), {}, frozenset()))

    page = html.write_report(folder).read_text(encoding="utf-8")

    assert INSTALLED in page
