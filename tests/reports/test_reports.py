"""The report of synthetic results: discs of known errors, so that numbers and colours can be checked."""

import base64
import io
import re

import numpy as np
import pandas as pd
import pytest
import yaml
from markupsafe import Markup
from PIL import Image

from glossbench.reports import raster, style
from glossbench.reports.model import axes, lines, selection
from glossbench.reports.model.conditions import Cell, Group
from glossbench.reports.page import html, payload
from oracles.discs import CLAIMS, NOISE, SCRIPT, N, data_of, metrics_of, read_exr, write_results


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Results with two materials: three methods of RMS ~ 1/sqrt(samples), a skipped and a failed cell."""
    return write_results(tmp_path_factory.mktemp("results") / "discs")


@pytest.fixture
def text_only(monkeypatch):
    """Drawing and the viewer's images take most of the time of a report; a check of text or of pictures needs none."""
    monkeypatch.setattr(style, "to_svg", lambda *_: "")
    monkeypatch.setattr(html, "build_payload", lambda *_: payload.Payload(Markup("{}"), {}, frozenset()))


@pytest.fixture(scope="module")
def page(folder):
    return html.write_report(folder).read_text(encoding="utf-8")


def test_the_report_is_one_file_that_loads_nothing_else(page):
    sources = re.findall(r'(?:src|href)="([^"]{5})', page)

    assert {s if s.startswith("data:") else s[0] for s in sources} == {"data:", "#"}
    assert not re.search(r"<script [^>]*src=|<link|<iframe|@import|url\((?!#)", page)
    assert "<text" in page  # text of a colour bar is text


def test_same_results_give_the_same_bytes(folder, page):
    assert html.write_report(folder).read_text(encoding="utf-8") == page
    assert not list(folder.glob(".*.part"))


def test_a_second_page_makes_no_flip_map_again(folder, page, monkeypatch):
    monkeypatch.setattr(payload, "_compute_flip", lambda *_: pytest.fail("made again"))

    assert html.write_report(folder).read_text(encoding="utf-8") == page


def test_a_kept_map_is_the_one_that_is_shown(folder, page, monkeypatch):
    """Twin of the above: another map on disk is another page."""
    monkeypatch.setattr(payload, "_compute_flip", lambda *_: pytest.fail("made again"))
    path = next((folder / "images").glob("*_flip_1.npz"))
    content = path.read_bytes()
    np.savez_compressed(path, steps=np.zeros((N, N), np.uint16))

    shown = html.write_report(folder).read_text(encoding="utf-8")
    path.write_bytes(content)

    assert shown != page


def test_ids_are_unique_in_the_page(page):
    ids = re.findall(r'\bid="([^"]+)"', page)

    assert len(ids) == len(set(ids))


def test_text_of_a_study_is_escaped(page):
    check_escaped(page)


def test_escape_check_notices_a_template_that_does_not_escape(folder, monkeypatch, text_only):
    plain = html.Environment
    monkeypatch.setattr(html, "Environment", lambda **options: plain(**options | {"autoescape": False}))
    monkeypatch.setattr(html, "_load_templates", html._load_templates.__wrapped__)  # past its cache

    with pytest.raises(AssertionError):
        check_escaped(html.write_report(folder).read_text(encoding="utf-8"))


def check_escaped(page):
    assert SCRIPT not in page
    # Title, heading, YAML of the study; last line twice and whole traceback, in both groups.
    assert len(re.findall(r"&lt;script&gt;alert\(&#39;x&#39;\)&lt;/script&gt;", page)) >= 9


def test_error_maps_are_centred_on_zero_and_share_one_scale(folder, page):
    check_one_scale(folder, page)


def test_scale_check_notices_a_scale_per_image(folder, monkeypatch, text_only):
    error_map = raster.draw_error_map
    monkeypatch.setattr(
        raster, "draw_error_map", lambda e, mask, _, *how: error_map(e, mask, np.abs(e[mask]).max(), *how)
    )

    with pytest.raises(AssertionError):
        check_one_scale(folder, html.write_report(folder).read_text(encoding="utf-8"))


def test_scale_check_notices_a_scale_that_is_not_centred(folder, monkeypatch, text_only):
    error_map = raster.draw_error_map
    monkeypatch.setattr(
        raster, "draw_error_map", lambda e, mask, limit, *how: error_map(e + 0.1 * limit, mask, limit, *how)
    )

    with pytest.raises(AssertionError):
        check_one_scale(folder, html.write_report(folder).read_text(encoding="utf-8"))


def check_one_scale(folder, page):
    """Colours of all maps follow one straight line through zero: index = 127 + 127 error / limit."""
    cells = pd.read_parquet(folder / "cells.parquet")
    done = cells[cells.status == "done"]
    maps = images_of("error", page)
    assert len(maps) == len(done)
    for reference_key, group in done.groupby("reference_key", sort=False):
        reference = read_exr(folder / "references" / f"{reference_key}.exr")
        errors, colours = [], []
        for key in group.key:
            errors.append((read_exr(folder / "images" / f"{key}.exr") - reference).mean(axis=2).ravel())
            colours.append(np.asarray(maps.pop(0)).ravel().astype(float))
        error, colour = np.concatenate(errors), np.concatenate(colours)
        seen = colour != 255
        limit = np.percentile(np.abs(error[seen]), 99.5)
        expected = 127 + 127 * np.clip(error[seen] / limit, -1, 1)
        assert np.abs(colour[seen] - expected).max() < 0.51  # rounding to a colour


def test_a_metric_that_old_results_do_not_have_is_left_out(tmp_path, text_only):
    folder = write_results(tmp_path / "old", budgets=(16,))
    study = yaml.safe_load((folder / "study.yaml").read_text())
    study["metrics"] = ["flip", "rms", "of_a_plug_in", "absent_plug_in"]
    (folder / "study.yaml").write_text(yaml.safe_dump(study))
    cells = pd.read_parquet(folder / "cells.parquet").drop(columns=["max_error", "mean_error"])
    cells["of_a_plug_in"] = 0.125
    cells.to_parquet(folder / "cells.parquet")

    page = html.write_report(folder).read_text(encoding="utf-8")

    assert metrics_of(data_of(page)) == ["rms", "of_a_plug_in", "relative_rms"]
    assert "defined by a plug-in" in page
    assert not re.search(r'class="n">(flip|max_error|absent_plug_in)', page)


def test_a_report_of_many_cells_stays_small(tmp_path, monkeypatch, text_only):
    folder = write_results(tmp_path / "many", budgets=(1, 2, 4, 8, 16, 32))
    monkeypatch.setattr(html, "MOST_PICTURES", 14)

    page = html.write_report(folder).read_text(encoding="utf-8")

    # Two groups of two swept methods and one that is not: three budgets are 14 cells, one is 6.
    assert len(images_of("error", page)) == 14
    assert page.count("6 more cells are in the viewer and the table only") == 2


def test_an_infinite_error_is_the_end_of_the_scale():
    error, mask = np.array([[0.0, 1.0, np.inf]]), np.array([[True, True, True]])

    limit = raster.find_error_limit([error])
    shown = Image.open(io.BytesIO(raster.draw_error_map(error, mask, limit, signed=False)))

    assert limit == pytest.approx(1, rel=0.01)
    assert np.asarray(shown)[0].tolist() == [0, 254, 254]


def test_one_image_of_large_error_does_not_flatten_the_colours_of_the_others():
    small, large = np.full((4, 4), 0.1), np.full((4, 4), 50.0)

    assert raster.find_middle_limit([small, large, 2 * small]) == pytest.approx(0.2)
    assert raster.find_middle_limit([large, small]) == pytest.approx(0.1)


def test_unsigned_maps_brighten_from_black_without_a_turn():
    ramp = np.linspace(0, 1, 255)[None]

    shown = Image.open(io.BytesIO(raster.draw_error_map(ramp, ramp >= 0, 1.0, signed=False)))

    brightness = np.asarray(shown.convert("L")).astype(int)[0]
    assert brightness[0] < 3
    assert brightness[-1] > 230
    assert (np.diff(brightness) >= 0).all()


def test_too_bright_is_red_too_dark_is_blue_and_right_is_neutral():
    error = np.array([[-1.0, 0.0, 1.0, 5.0]])

    shown = Image.open(io.BytesIO(raster.draw_error_map(error, np.array([[True, True, True, False]]), 2.0)))

    blue, neutral, red, outside = np.asarray(shown.convert("RGBA")).astype(int)[0]
    assert blue[2] > blue[0] + 50
    assert red[0] > red[2] + 50
    assert np.ptp(neutral[:3]) <= 2
    assert [c[3] for c in (blue, neutral, red, outside)] == [255, 255, 255, 0]


def test_picture_follows_the_srgb_curve_at_the_stated_exposure():
    grey = np.full((2, 2, 3), 0.36)

    shown = Image.open(io.BytesIO(raster.draw_picture(grey, np.ones((2, 2), bool), 0.5)))

    assert np.asarray(shown)[0, 0].tolist() == [118, 118, 118, 255]  # IEC 61966-2-1 of 0.18


def test_large_images_are_averaged_over_the_surface_alone():
    rng = np.random.default_rng(0)
    mask = np.hypot(*(np.mgrid[:300, :400] - 150)) < 140
    image = rng.random((300, 400, 3)) * mask[..., None]

    small, share = raster.downscale(image, mask)

    assert small.shape == (192, 256, 3)
    assert np.average(small, axis=(0, 1), weights=share) == pytest.approx(image[mask].mean(axis=0), rel=1e-12)
    constant, share = raster.downscale(np.ones((300, 400, 3)), mask)
    assert constant[share > 0] == pytest.approx(1, rel=1e-12)  # black background does not darken the rim


def test_a_smaller_image_is_the_mean_over_each_pixels_area():
    check_areas()


def test_the_check_of_areas_notices_pixels_that_are_taken_whole(monkeypatch):
    exact = raster._area_weights
    monkeypatch.setattr(raster, "_area_weights", lambda n, m: exact(n, m).ceil())

    with pytest.raises(AssertionError):
        check_areas()


def check_areas():
    """9 x 6 pixels to 6 x 4: each divided in 2 x 2, of which 3 x 3 make one."""
    rng = np.random.default_rng(1)
    image, mask = rng.random((9, 6, 3)), rng.random((9, 6)) < 0.7
    blocks = (np.kron(each, np.ones((2, 2))).reshape(6, 3, 4, 3) for each in (mask, *np.moveaxis(image, 2, 0) * mask))
    expected_share, *expected = (block.mean(axis=(1, 3)) for block in blocks)

    small, share = raster.downscale(image, mask, 6)

    assert share == pytest.approx(expected_share, rel=1e-12)
    assert small * share[..., None] == pytest.approx(np.dstack(expected), rel=1e-12)


def test_an_image_that_is_small_enough_stays_as_it_is():
    image, mask = np.random.default_rng(2).random((9, 6, 3)), np.ones((9, 6), bool)

    small, share = raster.downscale(image, mask, 9)

    assert np.array_equal(small, image)
    assert np.array_equal(share, mask)


def test_cell_at_the_noise_floor_has_no_number(page):
    rows = [row for row in re.findall(r"<tr\b.*?</tr>", page, re.DOTALL) if "at the noise floor" in row]

    assert len(rows) == 2
    assert all("filtered_importance_sampling" in row and "RMS ≤ 0.0040" in row for row in rows)
    assert style.format_number(1.7 * NOISE) not in "".join(rows)


def test_skipped_and_failed_cells_are_in_the_table_with_their_reasons(page):
    assert page.count("skipped</a>: the BRDF must be isotropic, m is (0.2, 0.075)") == 2
    assert page.count("Traceback (most recent call last):") == 2


def test_each_verdict_is_written_in_words(page):
    assert re.findall(r'<span class="badge [\w-]+">. ([\w ]+)</span>', page) == [verdict for _, verdict in CLAIMS]


def test_best_of_a_group_is_marked(tmp_path):
    folder = write_results(tmp_path / "one", budgets=(16,))
    cells = pd.read_parquet(folder / "cells.parquet")
    cells["at_noise_floor"] = False
    cells.to_parquet(folder / "cells.parquet")

    page = html.write_report(folder).read_text(encoding="utf-8")

    best = cells[cells.status == "done"].groupby("reference_key").rms.min()
    for rms in best:
        assert f"<strong>{style.format_number(rms)}</strong>" in page


def test_slope_is_fitted_through_resolved_points():
    n = np.array([4.0, 16, 64, 256])
    rms = 3 * n**-0.75
    rms[-1] = 0.1  # held up by the reference's noise

    def line(k, at_floor):
        return lines.MeasuredLine(
            axes.Label("m", 0, 0, "#000000"), n[:k], {"shade": n[:k]}, rms[:k], np.array(at_floor[:k])
        )

    assert line(4, [False, False, False, True]).slope() == pytest.approx(-0.75)
    assert line(4, [False] * 4).slope() > -0.7
    assert line(2, [False] * 2).slope() is None


def test_with_many_cells_each_line_shows_three_budgets_then_one():
    cells = [Cell({"method": m, "n_samples": n, "status": "done"}, "", i)
             for i, m in enumerate("abc") for n in range(9)]  # fmt: skip
    group = Group("", {}, cells, {}, {})

    def shown(most):
        return [
            [(cell.row["method"], cell.row["n_samples"]) for cell in of]
            for of in selection.choose_cells([group] * 2, most)
        ]

    assert selection.choose_cells([group] * 2, 54) == [cells, cells]
    assert shown(53) == [[(m, n) for m in "abc" for n in (0, 4, 8)]] * 2
    assert shown(17) == [[(m, 8) for m in "abc"]] * 2
    assert shown(1) == [[("a", 8)]] * 2  # at least one of each light, material and view


def test_results_without_a_single_image_make_a_report(tmp_path):
    folder = write_results(tmp_path / "none")
    cells = pd.read_parquet(folder / "cells.parquet")
    cells[cells.status != "done"].to_parquet(folder / "cells.parquet")
    (folder / "claims.json").write_text("[]")

    page = html.write_report(folder).read_text(encoding="utf-8")

    assert page.count("Traceback (most recent call last):") == 2
    assert page.count("<img") == page.count('<img class="equation"')
    assert "No cell is done" in page


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.012345, "0.0123"), (1236.5, "1236"), (-2.5e-7, "−2.50×10⁻⁷"), (0.0, "0"), (None, "–"), (np.inf, "∞"),
     (0.9996, "1.00"), (65536.0, "65536"), (3.1e7, "3.10×10⁷")],
)  # fmt: skip
def test_numbers_have_three_digits(value, text):
    assert style.format_number(value) == text


def images_of(kind, page):
    sources = re.findall(rf'<img class="{kind}" src="data:image/png;base64,([^"]+)"', page)
    return [Image.open(io.BytesIO(base64.b64decode(source))) for source in sources]
