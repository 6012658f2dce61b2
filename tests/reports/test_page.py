"""The page of a report in a real browser: its tables and plots, what a hostile study can do, a phone, the dark."""

import base64
import io
import json
import re
import shutil
from hashlib import sha256

import numpy as np
import pandas as pd
import pytest
import yaml

from glossbench.reports import style
from glossbench.reports.page import html
from glossbench.reports.page.scripts import TEMPLATES
from oracles.discs import data_of, three_lights, three_materials, write_results

HOSTILE = "</script><img src=x onerror=\"window.hacked='yes'\"><script>window.hacked='yes'</script>"


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """Of two materials: three methods of RMS ~ 1/sqrt(samples), a skipped and a failed cell each."""
    return html.write_report(write_results(tmp_path_factory.mktemp("page") / "discs"))


def opened(browser, report, **how):
    page = browser.open(report, **how)
    page.wait("document.querySelectorAll('.plots .point').length > 0")
    return page


@pytest.fixture
def page(browser, report):
    with opened(browser, report) as page:
        yield page
        assert page.complaints() == []


@pytest.fixture(scope="module")
def still(browser, report):
    """A page that tests read and do not change: a new one for each takes a second."""
    with opened(browser, report) as page:
        yield page
        assert page.complaints() == []


def planted(report, tmp_path, old, new):
    """The report with a fault in one of its scripts, which its policy lets run."""
    text = report.read_text(encoding="utf-8")
    for script in re.findall(r'<script type="module">(.*?)</script>', text, re.DOTALL):
        if old in script:
            faulty = script.replace(old, new)
            hashes = [base64.b64encode(sha256(each.encode()).digest()).decode() for each in (script, faulty)]
            path = tmp_path / "faulty.html"
            path.write_text(text.replace(script, faulty).replace(*hashes), encoding="utf-8")
            return path
    raise AssertionError(f"no script says {old!r}")


# Tables.

SHOWN = """[...document.querySelectorAll('#cells tbody')].map((body) =>
    [...body.querySelectorAll('tr[data-values]')].filter((row) => row.offsetHeight).map((row) => VALUE))"""


def column(page, name):
    """The values of a column in the shown rows, one list per group; None if a cell has no such value."""
    head = f"[...document.querySelectorAll('#cells th')].find((h) => h.innerText.startsWith('{name}'))"
    return page.do(SHOWN.replace("VALUE", f"JSON.parse(row.dataset.values)[{head}.dataset.column] ?? null"))


def press(page, name):
    page.do(f"[...document.querySelectorAll('#cells th button')].find((b) => b.innerText.startsWith('{name}')).click()")


def test_a_head_sorts_each_group_up_then_down_then_back(page):
    check_sorting(page)


def test_the_check_of_sorting_notices_numbers_that_sort_as_text(browser, report, tmp_path):
    fault = planted(report, tmp_path, '(typeof x === "number" ? x - y : x', "(String(x)")

    with opened(browser, fault) as page, pytest.raises(AssertionError):
        check_sorting(page)


def check_sorting(page):
    before = column(page, "max_error")
    done = [[value for value in group if value is not None] for group in before]

    press(page, "max_error")
    up = column(page, "max_error")
    press(page, "max_error")
    down = column(page, "max_error")
    state = page.do("document.querySelector('#cells th[aria-sort]').getAttribute('aria-sort')")
    press(page, "max_error")

    # The skipped and the failed cell have no number and come last.
    assert up == [[*sorted(group), None, None] for group in done]
    assert down == [[*sorted(group, reverse=True), None, None] for group in done]
    assert state == "descending"
    assert column(page, "max_error") == before
    assert page.do("document.querySelector('#cells th[aria-sort]')") is None


def test_a_method_that_has_no_number_yet_sorts_by_its_name(page):
    press(page, "method")

    assert all(group == sorted(group) for group in column(page, "method"))


def test_words_filter_the_rows_and_empty_groups_go(page):
    page.do("document.getElementById('filter').focus()")
    page.send("Input.insertText", text="split 0.075")

    assert column(page, "method") == [[], ["split_sum"]]
    assert page.text("#filter-count") == "1 of 22 cells"
    assert page.do("[...document.querySelectorAll('#cells tbody')].map((body) => body.hidden)") == [True, False]


def test_the_link_holds_every_cell_with_all_digits(still, report):
    link = still.do("document.querySelector('a[download]').href")

    table = pd.read_csv(io.BytesIO(base64.b64decode(link.split(",", 1)[1])))
    cells = pd.read_parquet(report.parent / "cells.parquet")
    assert table.key.tolist() == cells.key.tolist()
    assert table.rms.to_numpy() == pytest.approx(cells.rms.to_numpy(), rel=1e-15, nan_ok=True)


# Plots.


def points(page, x):
    """Of each point of a plot: line, number in the line, position in the plot."""
    return page.do(
        f"""[...document.querySelectorAll('.plots [data-x="{x}"] .point')].map((point) => [
            Number(point.dataset.line), Number(point.dataset.i),
            ...point.getAttribute('transform').match(/[-\\d.]+/g).map(Number)])"""
    )


def test_points_stand_where_the_logarithms_of_their_numbers_are(still, report):
    check_positions(still, report)


@pytest.mark.parametrize(
    ("old", "new"),
    [("Math.log(value / low)) / Math.log(high / low)", "(value - low)) / (high - low)"),
     ("horizontal.at(line.x[i]), v", "horizontal.at(line.x[0]), v")],
    ids=["linear", "one cost for all"],
)  # fmt: skip
def test_the_check_of_positions_notices(old, new, browser, report, tmp_path):
    with opened(browser, planted(report, tmp_path, old, new)) as page, pytest.raises(AssertionError):
        check_positions(page, report)


def check_positions(page, report):
    cells = pd.read_parquet(report.parent / "cells.parquet")
    first = cells[(cells.reference_key == "ref0") & (cells.status == "done")]
    methods = list(dict.fromkeys(first.method))
    for x, costs in (("over", first.n_samples), ("shade", 1e3 * first.shade_seconds)):
        found = sorted(points(page, x))
        expected = [
            (np.log10(cost), np.log10(rms))
            for method in methods
            for cost, rms in zip(costs[first.method == method], first.rms[first.method == method], strict=True)
        ]
        assert len(found) == len(expected) == 9
        positions = np.array(found)[:, 2:]
        for axis in (0, 1):
            values = np.array(expected)[:, axis]
            slope, offset = np.polyfit(values, positions[:, axis], 1)
            assert slope * (-1) ** axis > 10  # pixels a decade; y goes down the screen
            assert np.abs(positions[:, axis] - slope * values - offset).max() < 0.1  # written with one decimal


def test_the_pointer_on_a_point_shows_its_cell_and_marks_it_in_every_plot(page):
    page.do("document.querySelector('.plots').scrollIntoView()")
    x, y, width, height = page.box('.plots [data-x="shade"] .point[data-key="regular_sampling-16-0"]')

    page.mouse("mouseMoved", x + width / 2 + 3, y + height / 2)

    tip = page.text(".tip")
    assert tip.startswith("regular_sampling")
    assert "light samples per pixel: 16" in tip
    assert "shading time [ms]: 1.60" in tip
    marked = page.do("[...document.querySelectorAll('.point.active[data-key]')].map((point) => point.dataset.key)")
    assert set(marked) == {"regular_sampling-16-0"}
    # Over samples, shading time, new light, geometry and view, and memory; a new material costs nothing here.
    assert len(marked) == 6
    assert "new material" in page.text("#plot-nothing")


def test_a_click_on_a_point_or_on_a_name_opens_the_image(page):
    page.do("window.asked = []; document.addEventListener('open-cell', (event) => asked.push(event.detail.key)); 1")

    page.click_on('.plots [data-x="over"] .point[data-key="split_sum-4-0"]')
    page.click_on('#cells a.opens[data-key="regular_sampling-64-1"]')

    assert page.do("asked") == ["split_sum-4-0", "regular_sampling-64-1"]


def test_keys_walk_along_lines_and_between_them(page):
    page.do("window.asked = []; document.addEventListener('open-cell', (event) => asked.push(event.detail.key)); 1")
    page.do("""document.querySelector('.plots [data-x="over"] .point').focus()""")
    walked = []
    for key in ("ArrowRight", "ArrowRight", "ArrowDown", "ArrowLeft", "End", "ArrowUp"):
        page.key(key)
        walked.append(page.do("document.activeElement.dataset.key"))
    said = page.do("document.activeElement.getAttribute('aria-label')")
    page.key("Enter")

    assert walked == [
        "regular_sampling-16-0", "regular_sampling-64-0", "filtered_importance_sampling-64-0",
        "filtered_importance_sampling-16-0", "filtered_importance_sampling-256-0", "regular_sampling-256-0",
    ]  # fmt: skip
    assert said.startswith("regular_sampling, samples 256, rms 0.0")
    assert page.do("asked") == ["regular_sampling-256-0"]
    assert page.do("""document.querySelectorAll('.plots [data-x="over"] .point[tabindex="0"]').length""") == 1


def test_the_key_hides_and_shows_a_line(page):
    n = len(points(page, "over"))

    page.click_on(".key button")
    without = points(page, "over")
    pressed = page.do("document.querySelector('.key button').getAttribute('aria-pressed')")
    page.click_on(".key button")

    assert pressed == "false"
    assert {line for line, *_ in without} == {1, 2}
    assert len(points(page, "over")) == n


def test_place_and_metric_are_chosen_for_plots_and_tables_at_once(page):
    choose(page, "plot-group", 2)
    choose(page, "plot-metric", "max_error")

    keys = page.do("[...document.querySelectorAll('.plots .point[data-key]')].map((point) => point.dataset.key)")
    shown = page.do("[...document.querySelectorAll('.equal')].filter((e) => e.offsetHeight).map((e) => e.innerText)")
    assert {key[-2:] for key in keys} == {"-1"}
    assert page.do("document.querySelector('.plots svg .axes').lastChild.textContent") == "max_error [radiance]"
    assert len(shown) == 1
    assert "m [0.2, 0.075]" in shown[0].splitlines()[0]
    assert "max_error at shading time" in shown[0]


def test_only_the_page_of_many_cells_leaves_tables_for_when_they_are_in_sight(browser, report, tmp_path, monkeypatch):
    folder = tmp_path / "r"
    shutil.copytree(report.parent, folder)
    monkeypatch.setattr(html, "MOST_ROWS", 3)
    long = html.write_report(folder)
    hidden = "!document.querySelector('#cells tbody td').checkVisibility({ contentVisibilityAuto: true })"

    with browser.open(report) as page:
        assert not page.do(hidden)
    with browser.open(long) as page:
        assert page.do(hidden)
        page.show("#cells")
        assert not page.do(hidden)


def test_data_of_plots_that_are_damaged_are_told_and_the_tables_work(browser, report, tmp_path):
    text = report.read_text(encoding="utf-8")
    path = tmp_path / "damaged.html"
    path.write_text(re.sub(r'(id="plot-data">).{8}', r"\1AAAAAAAA", text), encoding="utf-8")

    with browser.open(path) as page:
        told = page.text("#plot-nothing")
        press(page, "samples")
        sorted_by = page.do("document.querySelectorAll('#cells th[aria-sort=ascending]').length")

    assert told.startswith("The plots cannot be drawn (")
    assert sorted_by == 1


def test_the_pareto_front_is_ringed(still, report):
    data = data_of(report.read_text(encoding="utf-8"))
    case = next(figure for figure in data["figures"] if figure["name"] == "costs")["cases"][0]
    shade = next(panel for panel in case["panels"] if panel["name"] == "shade")

    rings = still.do("""document.querySelectorAll('.plots [data-x="shade"] circle.front').length""")

    assert rings == len(data["pool"][shade["fronts"]]) >= 4


def test_what_the_reference_cannot_resolve_is_hollow(still, report):
    cells = pd.read_parquet(report.parent / "cells.parquet")
    expected = cells[cells.at_noise_floor & (cells.reference_key == "ref0")].key.tolist()

    hollow = still.do("""[...document.querySelectorAll('.plots [data-x="over"] .point')]
        .filter((point) => point.firstChild.getAttribute('fill') === 'var(--paper)')
        .map((point) => point.dataset.key)""")

    assert hollow == expected
    assert len(expected) == 1


def test_numbers_of_the_script_are_those_of_the_tables(still):
    values = [0.012345, 1236.4, -2.5e-7, 0, 0.9996, 65536, 3.1e7, 1e-4, 9.9999e-5, 123456, 999999, 0.5, -0.00379]

    said = still.do(f"{(TEMPLATES / 'numbers.js').read_text()}\n{json.dumps(values)}.map((value) => number(value))")

    assert said == [style.format_number(value) for value in values]


def test_over_three_lights_a_line_has_a_band_which_the_pointer_brings_out(browser, tmp_path):
    with opened(browser, html.write_report(three_lights(tmp_path / "lights"))) as page:
        page.do("""(() => { const s = document.getElementById('plot-group'); s.selectedIndex = s.options.length - 1;
            s.dispatchEvent(new Event('change', {bubbles: true})); })()""")
        title = page.do("document.querySelector('#plot-group option:last-of-type').text")
        bands = page.do("""[...document.querySelectorAll('.plots [data-x="over"] .band')].map((b) => b.dataset.line)""")
        page.do("""document.querySelector('.plots [data-x="over"] .point[data-line="1"]').focus()""")
        out = page.do(
            """[...document.querySelectorAll('.plots [data-x="over"] .band.active')].map((b) => b.dataset.line)"""
        )

        assert title == "mean over 3 lights, kurt, sphere"
        assert bands == ["0", "1"]  # split_sum has a single point
        assert out == ["1"]
        assert "95 % interval" in page.text(".tip")
        assert page.complaints() == []


# What is swept.


@pytest.fixture(scope="module")
def materials(tmp_path_factory):
    """The results of two materials as three that differ in s alone; two methods have two budgets and a filter each."""
    return html.write_report(three_materials(tmp_path_factory.mktemp("materials") / "discs", [1, 4, 64]))


def choose(page, name, value):
    page.do(f"(() => {{ const s = document.getElementById('{name}'); s.value = '{value}'; "
            "s.dispatchEvent(new Event('change', {bubbles: true})); })()")  # fmt: skip


def test_over_a_material_each_method_has_a_line_at_the_numbers_of_s(browser, materials):
    with opened(browser, materials) as page:
        check_over_s(page, materials, "rms")
        assert page.do("document.getElementById('plot-over').selectedOptions[0].text") == "s of the material"
        assert page.do("[...document.querySelectorAll('.plots figure')].filter((f) => !f.hidden).length") == 1

        choose(page, "plot-metric", "shade")

        check_over_s(page, materials, "shade_seconds")
        assert page.do("document.querySelector('.plots svg .axes').lastChild.textContent") == "shading time [ms]"
        assert page.complaints() == []


def test_the_check_over_s_notices_the_numbers_of_another_group(browser, materials, tmp_path):
    fault = planted(
        materials, tmp_path, "horizontal.at(line.x[i]), v", "horizontal.at(line.x[line.y.length - 1 - i]), v"
    )

    with opened(browser, fault) as page, pytest.raises(AssertionError):
        check_over_s(page, materials, "rms")


def check_over_s(page, report, column):
    cells = pd.read_parquet(report.parent / "cells.parquet").query("status == 'done'").set_index("key")
    found = page.do("""[...document.querySelectorAll('.plots [data-x="over"] .point')].map((point) => [
        point.dataset.key, ...point.getAttribute('transform').match(/[-\\d.]+/g).map(Number)])""")
    assert {key for key, *_ in found} == set(cells.index)
    numbers = [json.loads(cells.material_options[key])["s"] for key, *_ in found]
    for axis, values in ((1, numbers), (2, [cells[column][key] for key, *_ in found])):
        positions, logs = np.array([row[axis] for row in found]), np.log10(values)
        slope, offset = np.polyfit(logs, positions, 1)
        assert slope * (-1) ** (axis - 1) > 10  # pixels a decade; y goes down the screen
        assert np.abs(positions - slope * logs - offset).max() < 0.1  # written with one decimal


def test_keys_walk_through_groups_and_open_the_cell_of_each(browser, materials):
    with opened(browser, materials) as page:
        page.do("window.asked = []; document.addEventListener('open-cell', (e) => asked.push(e.detail.key)); 1")
        page.do("""document.querySelector('.plots [data-x="over"] .point').focus()""")
        walked = []
        for key in ("ArrowRight", "ArrowRight", "ArrowLeft"):
            page.key(key)
            walked.append(page.do("document.activeElement.dataset.key"))
        said = page.text(".tip")
        page.key("Enter")

        assert walked == ["regular_sampling-4-1", "regular_sampling-4-0-third", "regular_sampling-4-1"]
        assert "s of the material: 4" in said
        assert page.do("asked") == ["regular_sampling-4-1"]


def test_a_checkbox_hides_and_shows_the_lines_of_a_value(browser, materials):
    with opened(browser, materials) as page:
        lines = page.do("[...document.querySelectorAll('.key button')].map((button) => button.innerText)")
        n = len(points(page, "over"))

        page.click_on("#plot-options label:last-of-type input")
        without = page.do("[...document.querySelectorAll('.key button')].map((button) => button.innerText)")
        shown = len(points(page, "over"))
        page.click_on("#plot-options label:last-of-type input")

        assert [line for line in lines if "samples 64" not in line] == without
        assert shown == 3 * len(without) < n == len(points(page, "over"))


def test_over_samples_each_material_is_a_place_with_costs(browser, materials):
    with opened(browser, materials) as page:
        choose(page, "plot-over", page.do("[...document.querySelectorAll('#plot-over option')].at(-1).value"))
        title = page.do("document.getElementById('plot-group').selectedOptions[0].text")
        keys = page.do("[...document.querySelectorAll('.plots .point[data-key]')].map((point) => point.dataset.key)")
        n = page.do(
            "[...document.querySelectorAll('.plots figure:has(.point[data-key])')].filter((f) => !f.hidden).length"
        )

        assert title == "spots, kurt (s 1), sphere"
        assert {key[-2:] for key in keys} == {"-0"}
        assert n == 6


def test_an_axis_is_linear_where_a_value_is_not_positive(browser, tmp_path):
    with opened(browser, html.write_report(three_materials(tmp_path / "zero", [0, 1, 3]))) as page:
        across = sorted({x for _, _, x, _ in points(page, "over")})

        assert (across[2] - across[0]) / (across[1] - across[0]) == pytest.approx(3, abs=0.01)
        assert "slope" not in page.text(".key")


# What did not run.


def test_a_failed_cell_shows_its_traceback_and_a_skipped_one_its_reason(page):
    page.click_on("#missing summary")

    assert "MethodError" in page.text("#missing summary")
    assert page.text("#missing details[open] pre").startswith("Traceback (most recent call last):")
    assert "the BRDF must be isotropic" in page.text("#missing table")


# What a study may be called.


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    """Results whose every name would like to be a script."""
    folder = write_results(tmp_path_factory.mktemp("hostile") / "discs", budgets=(4, 64))
    cells = pd.read_parquet(folder / "cells.parquet")
    cells["method"] += HOSTILE
    cells["material"] = HOSTILE
    cells["light_options"] = json.dumps({"file": HOSTILE})
    cells["reason"] = cells["reason"].fillna("") + HOSTILE
    cells["version"] = HOSTILE
    cells.to_parquet(folder / "cells.parquet")
    study = yaml.safe_load((folder / "study.yaml").read_text())
    study |= {"title": HOSTILE, "question": HOSTILE, "source": HOSTILE, HOSTILE: HOSTILE}
    (folder / "study.yaml").write_text(yaml.safe_dump(study))
    for name in ("claims.json", "provenance.json"):
        text = (folder / name).read_text()
        (folder / name).write_text(
            text.replace("Regular sampling", json.dumps(HOSTILE)[1:-1]).replace(
                "glossbench run", json.dumps(HOSTILE)[1:-1]
            )
        )
    return folder


def test_no_name_of_a_study_becomes_a_script(browser, hostile):
    check_harmless(browser, html.write_report(hostile))


def check_harmless(browser, report):
    with opened(browser, report) as page:
        page.do("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
        page.do("""document.querySelector('.plots .point').focus()""")

        assert page.do("typeof window.hacked") == "undefined"
        assert page.do("document.querySelectorAll('[onerror]').length") == 0
        assert page.text("h1") == HOSTILE
        assert page.text(".tip .name").endswith(HOSTILE)
        assert page.complaints() == []


def test_the_check_of_names_notices_a_template_that_does_not_escape(browser, hostile, monkeypatch):
    plain = html.Environment
    monkeypatch.setattr(html, "Environment", lambda **options: plain(**options | {"autoescape": False}))
    monkeypatch.setattr(html, "_load_templates", html._load_templates.__wrapped__)  # past its cache

    with pytest.raises((AssertionError, TimeoutError)):
        check_harmless(browser, html.write_report(hostile))


def test_the_policy_stops_even_a_script_that_was_not_escaped(browser, report, tmp_path):
    text = report.read_text(encoding="utf-8").replace("<main>", f"<main>{HOSTILE.removeprefix('</script>')}")
    (tmp_path / "injected.html").write_text(text, encoding="utf-8")

    with opened(browser, tmp_path / "injected.html") as page:
        assert page.do("document.querySelectorAll('[onerror]').length") == 1
        assert page.do("typeof window.hacked") == "undefined"
        assert any("Content Security Policy" in complaint for complaint in page.complaints())


# Where it is read.


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_a_phone_scrolls_down_and_not_across(browser, report, dark):
    with opened(browser, report, width=390, height=844, dark=dark) as page:
        assert page.do("document.documentElement.scrollWidth") == 390
        assert page.do("Math.min(...[...document.querySelectorAll('.plots svg')].map((s) => s.clientWidth))") > 300
        brightness = page.pixels().mean()
        assert page.complaints() == []

    assert brightness < 90 if dark else brightness > 170


def test_text_stands_out_in_the_light_and_in_the_dark(browser, report):
    for dark in (False, True):
        with opened(browser, report, dark=dark) as page:
            colours = page.do(
                """['--ink', '--quiet', '--link', '--holds', '--fails', '--noise', '--paper'].map((name) =>
                    getComputedStyle(document.documentElement).getPropertyValue(name).trim())"""
            )
        *inks, paper = [luminance(colour) for colour in colours]
        contrast = [(max(ink, paper) + 0.05) / (min(ink, paper) + 0.05) for ink in inks]
        assert min(contrast) >= 4.5  # WCAG 2.2, success criterion 1.4.3


def luminance(colour):
    """Relative luminance of #rgb or #rrggbb, by WCAG 2.2."""
    digits = colour[1:] if len(colour) == 7 else "".join(2 * digit for digit in colour[1:])
    c = np.array([int(digits[i : i + 2], 16) / 255 for i in (0, 2, 4)])
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722]


def test_every_control_has_a_name(still):
    unnamed = still.do(
        """[...document.querySelectorAll('button, select, input, a[href], [tabindex="0"]')].filter((each) =>
            !(each.textContent.trim() || each.getAttribute('aria-label') || each.labels?.length))
            .map((each) => each.outerHTML.slice(0, 80))"""
    )

    assert unnamed == []
