"""The PDF report and single figures of synthetic results, read back by another library: text, images, colours."""

import io
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from PIL import Image

from glossbench.errors import InputError
from glossbench.findings.descriptions import describe_study
from glossbench.reports import raster, style, typesetting
from glossbench.reports.figures import profile
from glossbench.reports.model import crops
from glossbench.reports.model.axes import Label
from glossbench.reports.model.crops import Crop, choose_crops
from glossbench.reports.model.descriptions import describe_methods
from glossbench.reports.model.notation import split_runs
from glossbench.reports.print import pdf
from glossbench.reports.print.images import choose_middle_budgets
from glossbench.run.figures import FIGURES
from glossbench.run.results import Results
from glossbench.shading.method import METHODS as REGISTERED
from oracles.discs import CLAIMS, METHODS, SCRIPT, N, read_exr, three_materials, write_results
from oracles.pdf_pages import pages_of, text_of

INSTALLED = describe_study({"methods": REGISTERED.names()})
SOURCE_CODE = '#panic("x") #read("/etc/hostname") $x$ *b* @label'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The discs of the page's tests, with a title that looks like source of typst, too."""
    folder = write_results(tmp_path_factory.mktemp("results") / "discs", budgets=(4, 16, 64))
    study = yaml.safe_load((folder / "study.yaml").read_text())
    (folder / "study.yaml").write_text(yaml.safe_dump(study | {"title": f"Discs {SOURCE_CODE} {SCRIPT}"}))
    return folder


@pytest.fixture(scope="module")
def report(folder):
    return pdf.write_report(folder).read_bytes()


@pytest.fixture
def plain(monkeypatch):
    """Plots and images take most of the time of a report; a check of text needs none."""
    monkeypatch.setattr(pdf, "_arrange_plots", lambda *_: ([], []))
    monkeypatch.setattr(pdf, "_arrange_images", lambda *_: (None, []))


@pytest.fixture(scope="module")
def text_of_a_sweep(tmp_path_factory):
    """The text of a report of three materials, of which two are many; what is said of plots needs no images."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pdf, "_arrange_images", lambda *_: (None, []))
        patch.setattr(pdf, "MANY_PLACES", 2)
        folder = three_materials(tmp_path_factory.mktemp("sweep") / "materials", [1, 4, 64])
        return text_of(pdf.write_report(folder).read_bytes())


def test_first_page_has_title_question_verdicts_and_a_picture(report):
    first = pages_of(report)[0]

    text = " ".join(first["text"].split())
    assert "Which sampling keeps the highlight at a small budget?" in text
    for claim, verdict in CLAIMS:
        assert claim in text
        assert f"In 4 of 4 places, {verdict}." in text
    assert len(first["images"]) > 10
    red, _, blue = np.moveaxis(first["picture"], -1, 0)
    assert (red - blue > 60).any()
    assert (blue - red > 60).any()


def test_pages_hold_numbers_reasons_tracebacks_study_and_provenance(folder, report):
    text = text_of(report)

    cells = pd.read_parquet(folder / "cells.parquet")
    for _, cell in cells[(cells.status == "done") & ~cells.at_noise_floor].iterrows():
        assert f" {style.format_number(cell.rms)} " in text
    assert text.count("skipped: the BRDF must be isotropic, m is (0.2, 0.075)") == 2
    assert text.count("Traceback (most recent call last): line 3 MethodError:") == 2
    for said in ("RMS ≤ 0.0040", "relative_error: 0.001", "glossbench run discs", "2.8.0", "Luksch, Christian"):
        assert said in text


def test_what_a_study_says_is_printed_and_never_run(report):
    check_printed(report)


def test_the_check_notices_a_title_that_is_run(folder, plain, monkeypatch, tmp_path):
    planted(tmp_path, monkeypatch, 'semibold", data.title', 'semibold", eval(data.title, mode: "markup")')

    with pytest.raises((AssertionError, RuntimeError)):
        check_printed(pdf.write_report(folder).read_bytes())


def planted(tmp_path, monkeypatch, old, new):
    """Templates with a fault."""
    templates = tmp_path / "templates"
    templates.mkdir()
    for source in typesetting.TEMPLATES.glob("*.typ"):
        (templates / source.name).write_text(source.read_text().replace(old, new))
    monkeypatch.setattr(typesetting, "TEMPLATES", templates)


def check_printed(report):
    text = text_of(report)
    assert f"Discs {SOURCE_CODE} {SCRIPT}" in text
    assert text.count(SCRIPT) >= 4  # title, header, the study, tracebacks


def test_templates_read_no_file_outside_their_folder(tmp_path):
    secret = tmp_path / "secret.txt"
    secret.write_text("secret")
    with typesetting.Press() as press:
        (press.folder / "report.typ").write_text("")

        for path in (str(secret), "../" * 12 + str(secret).lstrip("/")):
            source = press.folder / "leak.typ"
            source.write_text(f'#read("{path}")')
            with pytest.raises(RuntimeError):
                press._compiler.compile(str(source))


def test_same_results_give_the_same_bytes(folder, plain):
    assert pdf.write_report(folder).read_bytes() == pdf.write_report(folder).read_bytes()
    assert not list(folder.glob(".*"))


def test_plots_are_lines_and_text(report):
    plots = next(page for page in pages_of(report) if "light samples per pixel" in page["text"])

    assert "shading time [ms]" in plots["text"]
    assert re.search("regular_sampling, slope −0.5[01]", plots["text"])  # errors fall as N^-1/2, with noise
    assert plots["n_paths"] > 100


def test_error_maps_of_all_cells_are_in_the_pages_on_one_scale(folder, report):
    check_maps(folder, report)


def test_the_check_notices_maps_on_their_own_scales(folder, monkeypatch):
    error_map = raster.draw_error_map
    monkeypatch.setattr(
        raster, "draw_error_map", lambda e, mask, _, *how: error_map(e, mask, 0.9 * np.abs(e[mask]).max(), *how)
    )
    monkeypatch.setattr(pdf, "_arrange_plots", lambda *_: ([], []))

    with pytest.raises(AssertionError):
        check_maps(folder, pdf.write_report(folder).read_bytes())


def check_maps(folder, report):
    """For each cell there is an image with the colours of its signed error, all cells of a group to one limit."""
    shown = [image for page in pages_of(report) for image in page["images"] if image.shape == (N, N, 3)]
    cells = pd.read_parquet(folder / "cells.parquet")
    done = cells[cells.status == "done"]
    for reference_key, group in done.groupby("reference_key"):
        reference = read_exr(folder / "references" / f"{reference_key}.exr")
        mask = np.asarray(Image.open(folder / "references" / f"{reference_key}_mask.png")) > 0
        errors = [(read_exr(folder / "images" / f"{key}.exr") - reference).mean(axis=2) for key in group.key]
        limit = np.percentile(np.abs(np.concatenate([error[mask] for error in errors])), 99.5)
        for error in errors:
            index = np.round(127 + 127 * np.clip(error / limit, -1, 1)).astype(int)
            expected = np.round(255 * raster.SIGNED(index)[..., :3])
            # An error on the edge of two colours may fall to either: the colours of neighbours differ by less than 6.
            assert any(np.abs(image[mask] - expected[mask]).max() < 6 for image in shown)


def test_a_long_word_stays_on_the_page(folder, plain, tmp_path):
    check_inside(long_title(tmp_path))


def test_the_check_notices_a_word_that_leaves_the_page(plain, tmp_path, monkeypatch):
    monkeypatch.setattr(typesetting, "LONGEST", 10**6)

    with pytest.raises(AssertionError):
        check_inside(long_title(tmp_path))


def long_title(tmp_path):
    folder = write_results(tmp_path / "long", budgets=(4,))
    study = yaml.safe_load((folder / "study.yaml").read_text())
    (folder / "study.yaml").write_text(yaml.safe_dump(study | {"title": "M" * 300}))
    return pdf.write_report(folder).read_bytes()


def check_inside(report):
    assert max(page["right"] for page in pages_of(report)) < 0.95


def test_results_without_a_single_image_make_a_report(tmp_path):
    folder = write_results(tmp_path / "none", budgets=(4,))
    cells = pd.read_parquet(folder / "cells.parquet")
    cells[cells.status != "done"].to_parquet(folder / "cells.parquet")
    (folder / "claims.json").write_text("[]")

    text = text_of(pdf.write_report(folder).read_bytes())

    assert text.count("Traceback (most recent call last):") == 2
    assert "Verdicts" not in text


def test_every_registered_method_has_an_equation_that_can_be_set():
    with typesetting.Press() as press:
        for name in REGISTERED.names():
            equation = describe_methods([name], INSTALLED)[0].equation
            assert equation, name
            assert press.is_equation(equation), name
        assert not press.is_equation("sum_(i=1 undefined_name")


def test_a_method_is_described_by_the_text_after_its_formula():
    told = {
        each.name: "".join(run.text for run in each.text[0]) for each in describe_methods(REGISTERED.names(), INSTALLED)
    }

    assert told["environment_sampling"].startswith("with ω drawn in proportion to luminance")
    assert told["filtered_importance_sampling"].startswith("ω is drawn by the BRDF's own sampler")
    assert (
        describe_methods(["of_a_plug_in"], INSTALLED)[0].text[0][0].text
        == "It belongs to a plug-in that is not installed here."
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a sample p_h of N", [("a sample ", "plain", "", ""), ("p", "italic", "h", ""), (" of ", "plain", "", ""),
                               ("N", "italic", "", "")]),
        ("mip_bias and n_circles", [("mip_bias and n_circles", "plain", "", "")]),
        ("exp(-2 x^2)", [("exp(", "plain", "", ""), ("−", "plain", "", ""), ("2 ", "plain", "", ""),
                         ("x", "italic", "", "2"), (")", "plain", "", "")]),
        ("f cos_i", [("f", "italic", "", ""), (" ", "plain", "", ""), ("cos\u2009", "plain", "", ""),
                     ("θ", "italic", "i", "")]),
        ("the sample's `probes`", [("the sample's ", "plain", "", ""), ("probes", "code", "", "")]),
        ("", []),
    ],
)  # fmt: skip
def test_formulas_in_text_are_set(text, expected):
    assert [tuple(run) for run in split_runs(text)] == expected


def test_crops_lie_where_errors_are_and_do_not_overlap():
    mask = np.ones((60, 90), bool)
    error = np.zeros((60, 90))
    error[5:15, 70:80] = -2
    error[40:50, 10:20] = 1
    error[30, 40] = 1e6  # one pixel decides nothing

    first, second, *_ = choose_crops([error, 0.5 * error], mask, 2.0, 3)

    assert first.width == second.height == 12  # the smallest
    assert first.cut(error).sum() == -200
    assert second.cut(error).sum() == 100


def test_crops_lie_on_the_surface():
    mask = np.zeros((60, 60), bool)
    mask[20:40, 20:40] = True
    error = np.where(mask, 0.1, 5.0)

    (crop,) = choose_crops([error], mask, 10.0, 1)

    assert crop.cut(mask).all()
    assert choose_crops([np.zeros((60, 60))], mask, 1.0) == []


@pytest.mark.parametrize("size", [(12, 12), (13, 40), (97, 64)])
def test_a_crop_is_found_to_the_pixel(size):
    side = min(max(crops.SMALLEST, round(min(size) / crops.SHARE)), *size)
    for y, x in ((0, 0), (size[0] - side, size[1] - side), (0, size[1] - side)):
        error = np.zeros(size)
        error[y : y + side, x : x + side] = 1

        assert choose_crops([error], np.ones(size, bool), 1.0, 1) == [Crop(x, y, side, side)]


def test_what_a_study_sweeps_is_plotted_first(text_of_a_sweep):
    text = text_of_a_sweep

    assert "spots, kurt, sphere: rms over s of the material" in text
    assert text.index("rms over s of the material") < text.index("rms over samples and against costs")


def test_convergence_is_over_the_stated_axis_and_by_default_over_what_the_study_sweeps(tmp_path):
    folder = three_materials(tmp_path / "materials", [1, 4, 64])

    for name, options in (("s of the material", {}), ("light samples", {"over": "samples", "group": 2})):
        write("convergence", folder, tmp_path / "f.pdf", **options)
        assert name in text_of((tmp_path / "f.pdf").read_bytes())
    write("convergence", folder, tmp_path / "f.pdf", metric="shade")
    assert "shading time [ms]" in text_of((tmp_path / "f.pdf").read_bytes())


def write(name, folder, path, **asked):
    FIGURES.get(name)().write(Results.open(folder), path, **asked)


ASKED = {
    "answer": {}, "crops": {"group": 2, "crop": [(4, 8, 20, 30), (30, 30, 16, 16)]}, "images": {"group": 1},
    "convergence": {"group": 1}, "costs": {"group": 2, "metric": "max_error"}, "profile": {"group": 1},
}  # fmt: skip


@pytest.mark.parametrize("name", ASKED)
def test_a_figure_is_one_page_of_its_size(name, folder, tmp_path):
    path = tmp_path / f"{name}.pdf"

    write(name, folder, path, **ASKED[name])

    (page,) = pages_of(path.read_bytes())
    text = "".join(page["text"].split())  # small type comes in pieces
    assert {"answer": "RMS", "crops": "reference", "images": "noise0.0020", "convergence": "slope",
            "costs": "max_error[radiance]", "profile": "inrow"}[name] in text  # fmt: skip
    for method in METHODS:
        assert method in page["text"].replace("\u200b", "").replace("\r\n", "")
    assert bool(page["images"]) is (name in ("answer", "crops", "images"))


def test_a_profile_runs_through_the_brightest_pixel_of_the_surface():
    reference, mask = np.zeros((4, 5, 3)), np.ones((4, 5), bool)
    reference[2, 3], reference[1, 1], mask[1, 1] = 2.0, 9.0, False

    row = profile.find_brightest_row(reference, mask)
    line = profile.make_line(row, mask, Label("method", 0, 0, "#0072b2"), 3 * reference)

    assert row == 2
    assert (line.x.tolist(), line.y.tolist()) == ([0, 1, 2, 3, 4], [0, 0, 0, 6, 0])


def test_a_figure_of_given_crops_shows_these_pixels(folder, tmp_path):
    path = tmp_path / "crops.pdf"

    write("crops", folder, path, group=1, crop=[(4, 8, 20, 30)])

    (page,) = pages_of(path.read_bytes())
    reference = read_exr(folder / "references" / "ref0.exr")
    mask = np.asarray(Image.open(folder / "references" / "ref0_mask.png")) > 0
    exposure = raster.choose_exposure(reference, mask)
    window = np.s_[8:38, 4:24]
    expected = np.asarray(Image.open(io.BytesIO(raster.draw_picture(reference[window], mask[window], exposure))))
    assert any(
        image.shape == (30, 20, 3) and np.array_equal(image[mask[window]], expected[..., :3][mask[window]])
        for image in page["images"]
    )


@pytest.mark.parametrize("ending", ["png", "svg"])
def test_a_figure_has_the_format_of_its_file_name(ending, folder, tmp_path):
    path = tmp_path / f"f.{ending}"

    write("convergence", folder, path, group=1)

    if ending == "png":
        with Image.open(path) as image:
            assert min(image.size) > 500
    else:
        assert path.read_text().startswith("<svg")


@pytest.mark.parametrize(
    ("name", "options", "path", "message"),
    [
        ("images", {"group": 1}, "a.jpg", "the extension must be .pdf, .svg or .png, got '.jpg'"),
        ("images", {}, "a.pdf", r"which light, material and view\? --group must be one of 1: spots, kurt"),
        ("images", {"group": 3}, "a.pdf", "--group must be one of 1: .*; 2: .*, got 3"),
        ("convergence", {"group": 1, "over": "s"}, "a.pdf", "does not sweep 's': --over must be one of samples$"),
        ("costs", {"group": 1, "metric": "rns"}, "a.pdf", "has no metric 'rns'; did you mean 'rms'?"),
        ("crops", {"group": 1, "crop": [(60, 0, 5, 5)]}, "a.pdf", "must lie within 64 x 64 pixels, got 60,0,5,5"),
    ],
)
def test_a_figure_that_cannot_be_is_one_line_and_no_file(name, options, path, message, folder, tmp_path):
    with pytest.raises(InputError, match=message) as caught:
        write(name, folder, tmp_path / path, **options)

    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_an_equation_that_cannot_be_set_is_printed_as_it_was_written(folder, plain, monkeypatch):
    monkeypatch.setattr(REGISTERED.get("regular_sampling"), "equation", "sum_(i=1 #panic(1)")

    text = text_of(pdf.write_report(folder).read_bytes())

    assert "sum_(i=1 #panic(1) with the" in text


def test_a_change_without_update_cost_has_no_column(report):
    text = text_of(report)

    assert "Nothing must be redone for a new material." in text


def test_tables_of_many_cells_move_to_the_appendix(folder, plain, monkeypatch):
    monkeypatch.setattr(pdf, "MANY_CELLS", 3)

    text = text_of(pdf.write_report(folder).read_bytes())

    assert re.search(r"Appendix B: Errors and costs", text)
    assert text.index("Methods") < text.index("Errors and costs of all cells")


@pytest.fixture(scope="module")
def many(tmp_path_factory):
    """Of three materials twenty lines each, all of one method."""
    folder = write_results(tmp_path_factory.mktemp("many") / "many", budgets=(4,))
    row = pd.read_parquet(folder / "cells.parquet").iloc[0].to_dict()
    image = folder / "images" / f"{row['key']}.exr"
    rows = []
    for s in range(3):
        for levels in range(20):
            key = f"{s}-{levels}"
            (folder / "images" / f"{key}.exr").hardlink_to(image)
            options, material = json.dumps({"levels": f"l{levels}"}), json.dumps({"lobe": f"m{s}"})
            told = {"key": key, "options": options, "tuned": "{}", "material_options": material}
            rows.append(row | told | {"rms": 0.01 * (1 + levels)})
    pd.DataFrame(rows).to_parquet(folder / "cells.parquet")
    (folder / "claims.json").write_text("[]")
    return folder


@pytest.fixture(scope="module")
def pages_of_many(many):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pdf, "MANY_PLACES", 2)
        patch.setattr(pdf, "MANY_CELLS", 30)
        return pages_of(pdf.write_report(many).read_bytes())


def test_with_many_lines_no_page_is_a_heading_alone_and_no_image_is_cut(pages_of_many):
    check_filled(pages_of_many)
    check_uncut(pages_of_many)


def test_the_checks_notice_crops_of_all_lines(many, monkeypatch):
    monkeypatch.setattr(pdf, "choose_best_few", lambda group, _: choose_middle_budgets(group))
    monkeypatch.setattr(pdf, "_arrange_plots", lambda *_: ([], []))
    pages = pages_of(pdf.write_report(many).read_bytes())

    for check in (check_filled, check_uncut):
        with pytest.raises(AssertionError):
            check(pages)


def check_filled(pages):
    """Each page has an image, lines of a plot or table, or some sentences; a heading alone is shorter."""
    assert all(page["images"] or page["n_paths"] > 2 or len(page["text"]) > 300 for page in pages)


def check_uncut(pages):
    assert min(page["lowest"] for page in pages) > 2.3 * 72 / 2.54 - 0.1  # the margin


def test_a_condition_with_a_long_name_leaves_room_for_what_is_said_of_it(plain, tmp_path):
    check_inside(long_material(tmp_path))


def test_the_check_notices_a_column_as_wide_as_its_names(plain, tmp_path, monkeypatch):
    planted(tmp_path, monkeypatch, "columns: (4.2cm, 1fr)", "columns: (auto, 1fr)")

    with pytest.raises(AssertionError):
        check_inside(long_material(tmp_path))


def long_material(tmp_path):
    folder = write_results(tmp_path / "long", budgets=(4,))
    cells = pd.read_parquet(folder / "cells.parquet")
    cells["material_options"] = [json.dumps({"lobe": f"{'long ' * 14}{key}"}) for key in cells.reference_key]
    cells.to_parquet(folder / "cells.parquet")
    provenance = json.loads((folder / "provenance.json").read_text())
    (folder / "provenance.json").write_text(json.dumps(provenance | {"source_hash": "0123456789abcdef" * 4}))
    return pdf.write_report(folder).read_bytes()


def test_a_report_of_many_conditions_stays_short(pages_of_many):
    images = [page for page in pages_of_many if len(page["images"]) > 6]

    assert len(images) <= 2 + 2 * 3  # the answer, and at most two pages a condition
    text = " ".join(" ".join(page["text"] for page in pages_of_many).split())
    assert text.count("against costs") == 3 + 1
    assert text.count("over all 3 conditions against costs") == 1
    assert text.index("Appendix B: Plots of the other conditions") < text.rindex("against costs")


def test_a_single_method_is_named_once_in_a_key(pages_of_many):
    keys = [page["text"] for page in pages_of_many if "regular_sampling (levels)" in page["text"]]

    assert any("shading time [ms]" in text and "l17" in text for text in keys)
    for text in keys:
        assert "regular_sampling (levels l" not in text


def test_along_a_swept_parameter_one_condition_is_shown_for_many(text_of_a_sweep):
    assert text_of_a_sweep.count("rms over samples and against costs") == 1
    assert "the first of 3 conditions of the study: rms over samples and against costs" in text_of_a_sweep


def test_templates_are_part_of_the_package():
    names = {path.name for path in Path(typesetting.TEMPLATES).glob("*.typ")}

    assert names == {"report.typ", "parts.typ", "figure.typ"}
