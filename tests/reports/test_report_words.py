"""The words of reports: names, times, words that need a sentence, what they leave out."""

import json
import re

import pandas as pd
import pytest
import yaml
from markupsafe import Markup

from glossbench.errors import InputError
from glossbench.reports import style
from glossbench.reports.model.options import AxisOption
from glossbench.reports.model.report import Report
from glossbench.reports.model.times import time_notes
from glossbench.reports.page import html, payload
from glossbench.reports.print import pdf, tables
from glossbench.run.results import Results
from oracles.discs import data_of, labels_of, write_results
from oracles.pdf_pages import text_of


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two lights of one file name, times of two processors with their spread, a tuned and a stated bias."""
    folder = write_results(tmp_path_factory.mktemp("words") / "discs", budgets=(16, 64))
    cells = pd.read_parquet(folder / "cells.parquet")
    first = cells.reference_key == "ref0"
    regular = cells.method == "regular_sampling"
    cells["light"] = "file"
    cells["light_options"] = first.map({True: '{"file": "/x/probe.exr"}', False: '{"file": "/y/probe.exr"}'})
    cells["material_options"] = '{"m": [0.1, 0.1], "f0": 1.0}'
    cells["tune"] = regular.map({True: '{"mip_bias": {"tune": "rms", "range": [-1, 1]}}', False: "{}"})
    cells.loc[cells.options.str.contains('"samples": 64') & regular, ["tune", "tuned"]] = "{}"
    cells["shade_seconds_low"], cells["shade_seconds_high"] = 0.5 * cells.shade_seconds, 8 * cells.shade_seconds
    cells["shade_runs"], cells["busy"] = 5, 0.01
    cells["processor"] = first.map({True: "A", False: "B"})
    cells.loc[cells.index[0], "busy"] = 0.43
    cells.to_parquet(folder / "cells.parquet")
    study = yaml.safe_load((folder / "study.yaml").read_text())
    study["claims"] = [
        {"text": "At 16", "lower": "regular_sampling", "than": "filtered_importance_sampling", "metric": "rms",
         "where": {"samples": 16}}
    ]  # fmt: skip
    (folder / "study.yaml").write_text(yaml.safe_dump(study))
    return folder


@pytest.fixture(scope="module")
def page(folder):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style, "to_svg", lambda *_: "")
        patch.setattr(html, "build_payload", lambda *_: payload.Payload(Markup("{}"), {}, frozenset()))
        patch.setattr(html, "MOST_ROWS", 10)
        return text_in(html.write_report(folder).read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def printed(folder):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pdf, "_arrange_plots", lambda *_: ([], []))
        patch.setattr(pdf, "_arrange_images", lambda *_: (None, []))
        patch.setattr(tables, "MOST_ROWS", 10)
        return text_of(pdf.write_report(folder).read_bytes())


def text_in(page):
    return " ".join(re.sub(r"<[^>]+>", " ", re.sub(r"<script.*?</script>", " ", page, flags=re.DOTALL)).split())


def test_page_and_print_name_lights_by_what_distinguishes_them(page, printed):
    for text in (page, printed):
        assert "x/probe.exr, kurt, sphere" in text
        assert "y/probe.exr, kurt, sphere" in text


def test_page_and_print_distinguish_tuned_options_from_stated_ones(page, printed):
    for text in (page, printed):
        assert "mip_bias tuned by rms" in text
        assert "mip_bias 0.35" in text


def test_page_and_print_say_how_times_were_taken(page, printed):
    for text in (page, printed):
        assert "Shading times are medians of 5 runs, shown with the fastest and the slowest run." in text
        assert "Cells were timed on 2 processors, so their times cannot be compared (A: 5 cells; B: 5 cells)." in text
        assert "The machine was busy while 1 of 10 cells were timed" in text
        assert "used up to 43 % of the processor time" in text
        assert "6.40 3.2 to 51" in text  # ms


def test_results_of_one_quiet_processor_have_no_note():
    row = {"status": "done", "processor": "A", "busy": 0.0}

    assert time_notes([row, row]) == []
    assert time_notes([{"status": "done"}, {"status": "failed", "processor": "B"}]) == []


def test_page_and_print_explain_their_words(page, printed):
    for text in (page.lower(), printed.lower()):
        assert re.search("within noise ?: the 95 % interval contains what the number is compared with", text)
        assert "number of levels to add" in text  # of mip_bias


def test_page_and_print_say_what_they_leave_out(page, printed):
    assert "… and 2 more of 7 cells: all are in the CSV" in page
    assert "… and 2 more cells: all are in cells.parquet" in printed


def test_the_picture_of_the_page_is_of_the_claim(page):
    assert "methods with a budget at 16 samples: the condition of the claim “At 16” in which" in page


def test_a_short_name_is_enough_for_what_a_figure_is_over(folder, tmp_path):
    cells = pd.read_parquet(folder / "cells.parquet")
    first = cells.reference_key == "ref0"
    names = [("material_options", "m", [[0.1, 0.1], [0.2, 0.2]]), ("view_options", "resolution", [64, 32])]
    for column, key, (a, b) in names:
        cells[column] = first.map({True: json.dumps({key: a}), False: json.dumps({key: b})})
    cells["light_options"] = '{"file": "/x/probe.exr"}'
    for name in ("study.yaml", "claims.json", "provenance.json"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())

    def over(name, **options):
        cells.assign(**options).to_parquet(tmp_path / "cells.parquet")
        return AxisOption().asked(Report.from_results(Results.open(tmp_path)), {}, name).name

    alike = {"view_options": '{"resolution": 64}'}
    assert over("m", **alike) == over("material.m", **alike) == "material.m"
    assert over("samples", **alike) == "samples"
    with pytest.raises(InputError, match="does not sweep 'beta'"):
        over("beta", **alike)
    both = [json.dumps((read := json.loads(text)) | {"m": read.get("samples", 1)}) for text in cells.options]
    with pytest.raises(InputError, match=r"--over m may mean method\.m or material\.m: say which"):
        over("m", options=both, **alike)
    assert over("method.m", options=both, **alike) == "m"


def test_a_line_of_the_page_has_the_colour_of_its_method(folder):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style, "to_svg", lambda *_: "")
        patch.setattr(html, "build_payload", lambda *_: payload.Payload(Markup("{}"), {}, frozenset()))
        data = data_of(html.write_report(folder).read_text(encoding="utf-8"))

    labels = labels_of(data)
    methods = {label["name"].partition(" (")[0]: label["method"] for label in labels}
    assert sorted(methods.values()) == list(range(len(methods)))
