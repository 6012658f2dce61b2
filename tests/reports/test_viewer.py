"""The viewer of a report in a real browser: what is on its canvas, against the images on disk."""

import re
import shutil
import time
import urllib.parse
import zlib
from base64 import b64encode
from functools import cache, partial
from hashlib import sha256
from types import SimpleNamespace

import numpy as np
import OpenEXR
import pandas as pd
import pytest
from matplotlib import colormaps

from glossbench.metrics.perceptual import FLIP
from glossbench.reports import style
from glossbench.reports.page import html, payload
from glossbench.run.results import Results
from oracles.discs import N, write_results

BUDGETS = (4, 64)
METHODS = ("regular_sampling", "filtered_importance_sampling")
# In the order of the list: what the number keys show.
CELLS = [f"{method}-{n}" for method in METHODS for n in BUDGETS] + ["split_sum-4"]
READY = "globalThis.glossbenchViewer?.panes?.every(({image}) => image?.half) && !glossbenchViewer.scheduled"
PAINTERS = ("plain", "webgl2")


@pytest.fixture(scope="module", autouse=True)
def without_plots():
    """Drawing takes most of the time of a report, and no one looks at it here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style, "to_svg", lambda *_: "")
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = write_results(tmp_path_factory.mktemp("results") / "discs", BUDGETS)
    html.write_report(folder)
    return folder


@pytest.fixture
def page(browser, folder):
    with opened(browser, folder) as page:
        yield page


def opened(browser, folder, painter="plain", **how):
    """The page of a folder, its viewer drawn and in the window."""
    page = browser.open(folder / "report.html", query=f"?painter={painter}", **how)
    page.wait("globalThis.glossbenchViewer")
    page.do("document.getElementById('viewer').scrollIntoView()")
    page.wait(READY)
    return page


def change(page, changes):
    page.do(f"glossbenchViewer.change({changes})")
    page.wait(READY)


def read_exr(path):
    return np.asarray(OpenEXR.File(str(path)).channels()["RGB"].pixels, dtype=np.float64)


@cache
def truth(folder, index, group=0):
    """Image and reference on disk, and the mask; index 0 is the reference."""
    y = read_exr(folder / "references" / f"ref{group}.exr")
    x = y if index == 0 else read_exr(folder / "images" / f"{CELLS[index - 1]}-{group}.exr")
    across, down = ((np.mgrid[:N, :N] + 0.5) / N * 2 - 1)[::-1]
    return SimpleNamespace(x=x, y=y, mask=across**2 + down**2 < 0.9)


def srgb(linear):
    linear = np.clip(linear, 0, 1)
    return 255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def screen_of(page):
    """The colours of the stage, all panes of it."""
    return page.pixels(".viewer-stage").astype(float)


def on_canvas(page, screen, pane=0):
    """Colours (n, 3) on the screen at the middles of image pixels that a pane shows, and those pixels' (y, x)."""
    shown = page.do(
        f"(({{rect, origin, scale}}) => [rect.x, rect.y, rect.width, rect.height, origin.x, origin.y, scale])"
        f"(glossbenchViewer.panes[{pane}])"
    )
    left, top, width, height, x0, y0, scale = shown
    y, x = np.mgrid[:N, :N]
    x0, y0 = (np.floor(corner + 0.5) for corner in (x0, y0))  # images begin at whole pixels of the screen
    column, row = x0 + scale * (x + 0.5), y0 + scale * (y + 0.5)
    margin = 2  # the border of A and B is drawn over the neighbouring pixels
    seen = (column > left + margin) & (column < left + width - margin) & (row > top) & (row < top + height)
    # The handle of the border hides a disc, and so does its line.
    handle = page.do(
        "(h => h.hidden ? null : parseFloat(h.style.left) / 100 * glossbenchViewer.size.width)(glossbenchViewer.handle)"
    )
    if handle is not None:
        seen &= np.abs(column - handle) > 14
    return screen[row[seen].astype(int), column[seen].astype(int)], (y[seen], x[seen])


def check_image(page, folder, index, pane=0, stops=0.0, group=0, tone=lambda v: v, screen=None):
    """A pane shows this image: radiance, exposed, through the tone curve and the sRGB curve."""
    image = truth(folder, index, group)
    exposure = 2**stops / np.percentile(image.y[image.mask].max(axis=1), 99)
    expected = srgb(tone(np.clip(exposure * image.x, 0, None)))
    colours, at = on_canvas(page, screen_of(page) if screen is None else screen, pane)
    shown = image.mask[at]
    assert shown.sum() > 300
    # Half floats round by 2^-12 of a value at most, which is 0.06 of a level; then each rounds to a level.
    assert np.abs(colours - expected[at])[shown].max() <= 1


def check_images(page, folder, *indices, **how):
    """The panes show these images, all in one picture of the screen."""
    screen = screen_of(page)
    for pane, index in enumerate(indices):
        check_image(page, folder, index, pane, screen=screen, **how)


def error_of(mode, x, y):
    match mode:
        case "signed":
            return (x - y).mean(axis=2)
        case "absolute":
            return np.abs(x - y).mean(axis=2)
        case "squared":
            return ((x - y) ** 2).mean(axis=2)
        case "relative":
            return (np.abs(x - y) / (np.abs(y) + 0.01)).mean(axis=2)
        case "smape":
            return (2 * np.abs(x - y) / np.maximum(np.abs(x) + np.abs(y), 1e-30)).mean(axis=2)


@cache
def errors_of(folder, mode):
    """The errors of all images of the first group."""
    images = {i: truth(folder, i) for i in range(1, len(CELLS) + 1)}
    if mode == "flip":
        return {i: FLIP().errors(image.x, image.y * image.mask[..., None], image.mask) for i, image in images.items()}
    return {i: error_of(mode, image.x, image.y) for i, image in images.items()}


def check_error(page, folder, mode, index, limit=None, pane=0, screen=None):
    """A pane shows an error in the colours of one scale for all images of the group."""
    errors = errors_of(folder, mode)
    mask = truth(folder, 0).mask
    limit = limit or np.percentile(np.abs(np.concatenate([error[mask] for error in errors.values()])), 99.5)
    v = np.clip(errors[index] / limit, -1, 1)
    place = 127 + 127 * v if mode == "signed" else 254 * v
    colour_map = colormaps["RdBu_r" if mode == "signed" else "magma"].resampled(255)
    colours, at = on_canvas(page, screen_of(page) if screen is None else screen, pane)
    shown = mask[at]
    assert shown.sum() > 300
    # Rounding of half floats, and of FLIP to 1/256, may move an error to the next of 255 colours.
    near = [np.clip(np.round(place[at]).astype(int) + step, 0, 254) for step in (-1, 0, 1)]
    near = [255 * colour_map(each)[:, :3] for each in near]
    wrong = np.min([np.abs(colours - each).max(axis=1) for each in near], axis=0)[shown]
    assert wrong.max() <= 1


@pytest.mark.parametrize("painter", PAINTERS)
def test_number_keys_flip_between_images(painter, browser, folder):
    with opened(browser, folder, painter) as page:
        change(page, "{layout: 'one'}")
        page.do("glossbenchViewer.stage.focus()")

        for key in "0123450":
            page.key(key)
            page.wait(READY)

            check_image(page, folder, int(key))
        assert page.do("glossbenchViewer.root.dataset.painter") == painter
        assert of_the_page(page.complaints()) == []


def of_the_page(complaints):
    """Without what the browser says of the reading of pixels by a test."""
    return [each for each in complaints if not re.search("GPU stall due to ReadPixels|willReadFrequently", each)]


def test_arrow_keys_step_through_images_and_groups(page, folder):
    change(page, "{layout: 'one', image: 5}")
    page.do("glossbenchViewer.stage.focus()")

    page.key("ArrowRight")
    page.wait(READY)
    check_image(page, folder, 0)
    page.key("ArrowLeft")
    page.key("ArrowLeft")
    page.wait(READY)
    check_image(page, folder, 4)
    page.key("ArrowDown")
    page.wait(READY)
    check_image(page, folder, 4, group=1)
    page.key("ArrowUp")
    page.wait(READY)
    check_image(page, folder, 4)


def test_keys_are_left_alone_while_the_focus_is_elsewhere(page):
    page.do("document.activeElement.blur()")
    page.mouse("mouseMoved", 1, 1)

    page.key("3")

    assert page.do("glossbenchViewer.state.image") == 1


@pytest.mark.parametrize("painter", PAINTERS)
def test_slider_parts_a_and_b(painter, browser, folder):
    with opened(browser, folder, painter) as page:
        change(page, "{layout: 'split', image: 5, other: 1}")
        check_images(page, folder, 1, 5)

        x, y, width, height = page.box(".viewer-stage")
        page.drag((x + width / 2, y + height / 2), (x + 0.7 * width, y + height / 2))
        page.wait(READY)

        assert page.do("glossbenchViewer.state.split") == pytest.approx(0.7, abs=0.01)
        assert page.do("glossbenchViewer.handle.getAttribute('aria-valuenow')") == "70"
        check_images(page, folder, 1, 5)
        page.key("Home")
        page.do("glossbenchViewer.handle.focus()")
        page.key("Home")
        page.wait(READY)
        check_image(page, folder, 5, pane=1)


@pytest.mark.parametrize("painter", PAINTERS)
def test_zoom_and_pan_are_linked_over_all_images(painter, browser, folder):
    with opened(browser, folder, painter) as page:
        change(page, "{layout: 'all'}")
        check_images(page, folder, *range(6))
        before = page.do("glossbenchViewer.panes[0].scale")
        x, y, *_ = page.box(".viewer-stage")
        frame = page.do("glossbenchViewer.panes[4].rect")
        at = round(x + frame["x"] + 0.4 * frame["width"]), round(y + frame["y"] + 0.3 * frame["height"])
        under = "(p => [(%f - p.origin.x) / p.scale, (%f - p.origin.y) / p.scale])(glossbenchViewer.panes[4])"
        pixel = page.do(under % (at[0] - x, at[1] - y))

        page.click(*at)
        page.mouse("mouseWheel", *at, deltaX=0, deltaY=-600)
        page.wait(f"glossbenchViewer.panes[0].scale > {1.5 * before}")
        page.wait(READY)

        assert page.do(under % (at[0] - x, at[1] - y)) == pytest.approx(pixel, abs=0.05)  # stays under the pointer
        check_images(page, folder, *range(6))
        centre = page.do("glossbenchViewer.state.centre")
        page.drag(at, (at[0] - 40, at[1] - 20))
        page.wait(READY)
        moved, scale = page.do("[glossbenchViewer.state.centre, glossbenchViewer.state.zoom]")
        assert moved["x"] - centre["x"] == pytest.approx(40 / scale)
        assert moved["y"] - centre["y"] == pytest.approx(20 / scale)
        check_images(page, folder, *range(6))


def test_the_wheel_scrolls_the_page_until_the_images_are_clicked(page):
    page.do("document.activeElement.blur()")
    x, y, width, height = page.box(".viewer-stage")

    page.mouse("mouseWheel", x + width / 2, y + height / 2, deltaX=0, deltaY=120)

    assert page.do("glossbenchViewer.state.zoom") is None


def test_values_of_pixels_are_written_on_them_when_zoomed_in(page, folder):
    change(page, "{layout: 'one', image: 1, zoom: 60, centre: {x: 20.5, y: 21.5}}")

    image = truth(folder, 1)
    numbers = page.text(".viewer-readout")

    expected = " ".join(style.format_number(float(np.float16(v))) for v in image.x[21, 20])
    assert numbers.startswith(f"pixel 20, 21 · regular_sampling {expected} · reference ")
    of_ink = (
        "(c => c.getContext('2d').getImageData(0, 100, c.width, 300).data.filter((v, i) => i % 4 === 3 && v).length)"
        "(document.querySelector('.viewer-ink'))"
    )
    assert page.do(of_ink) > 5000
    change(page, "{zoom: 20}")
    assert page.do(of_ink) == 0


@pytest.mark.parametrize("painter", PAINTERS)
def test_error_modes_share_one_scale(painter, browser, folder):
    with opened(browser, folder, painter) as page:
        for mode in ("signed", "absolute", "squared", "relative", "smape", "flip"):
            change(page, f"{{layout: 'all', mode: '{mode}'}}")

            screen = screen_of(page)
            for pane in range(1, 6):
                check_error(page, folder, mode, pane, pane=pane, screen=screen)
            check_image(page, folder, 0, screen=screen)  # the reference has no error


def test_a_range_of_the_user_rules_all_images_and_the_colour_bar(page, folder):
    change(page, "{layout: 'all', mode: 'signed'}")

    page.do("glossbenchViewer.root.querySelector('[name=range]').focus()")
    for key in "0.5":
        page.key(key)
    page.wait("glossbenchViewer.state.range === 0.5")
    page.wait(READY)

    screen = screen_of(page)
    for pane in (1, 3, 5):
        check_error(page, folder, "signed", pane, 0.5, pane, screen)
    assert page.text(".viewer-ticks").split() == ["−0.50", "−0.25", "0", "0.25", "0.50"]
    bar = page.pixels(".viewer-scale canvas").astype(float)
    row = bar[len(bar) // 2]
    assert np.ptp(row[len(row) // 2]) <= 2  # zero has no colour
    assert row[3, 2] > row[3, 0] + 30
    assert row[-4, 0] > row[-4, 2] + 30


@pytest.mark.parametrize("painter", PAINTERS)
def test_exposure_and_tone_curve_are_linked(painter, browser, folder):
    curves = {
        "srgb": lambda v: v,
        "reinhard": lambda v: v / (1 + v),
        "aces": lambda v: (0.6 * v * (2.51 * 0.6 * v + 0.03)) / (0.6 * v * (2.43 * 0.6 * v + 0.59) + 0.14),
    }
    with opened(browser, folder, painter) as page:
        for name, curve in curves.items():
            change(page, f"{{layout: 'all', tone: '{name}', stops: -1.5}}")

            check_images(page, folder, *range(6), stops=-1.5, tone=curve)


def planted(folder, old, new, to):
    """A folder with the same page, one script of which has this fault, under the hash of the script that it is."""
    page = (folder / "report.html").read_text()
    [script] = [each for each in re.findall("<script[^>]*>(.*?)</script>", page, re.DOTALL) if old in each]
    faulty = script.replace(old, new)
    assert hash_of(script) in page
    (to / "report.html").write_text(page.replace(script, faulty).replace(hash_of(script), hash_of(faulty)))
    return to


def hash_of(source):
    return f"sha256-{b64encode(sha256(source.encode()).digest()).decode()}"


FAULTS = {
    "upside down": ("const at = 4 * ((y0 + row)", "const at = 4 * ((y0 + height - 1 - row)", "image"),
    "red and blue change places": ("HALF[x[at + c]], look.tone", "HALF[x[at + 2 - c]], look.tone", "image"),
    "half a stop too bright": ("gain: 2 **", "gain: 1.414 * 2 **", "image"),
    "sign of the error": ("d = HALF[x[c]] - b", "d = b - HALF[x[c]]", "signed"),
    "not centred on zero": ("127.5 + 127 * v", "130.5 + 124 * v", "signed"),
    "a scale an image": ("range ?? this.group.ranges[mode]", "range ?? this.group.ranges[mode] / index", "signed"),
    "the next image": ("this.loaded(pane.index)", "this.loaded(Math.max(pane.index - 1, 0))", "image"),
    "a pixel to the right": ("x: snap(origin.x)", "x: snap(origin.x + scale)", "image"),
}


@pytest.mark.parametrize(("old", "new", "mode"), FAULTS.values(), ids=FAULTS)
def test_the_checks_notice(old, new, mode, browser, folder, tmp_path):
    with opened(browser, planted(folder, old, new, tmp_path)) as page:
        change(page, f"{{layout: 'all', mode: '{mode}'}}")
        check = partial(check_image, page, folder) if mode == "image" else partial(check_error, page, folder, mode)
        with pytest.raises(AssertionError):
            check(3, pane=3)


@pytest.mark.parametrize("name", ["signed", "relative"])
def test_the_checks_notice_an_error_that_webgl_gets_wrong(name, browser, folder, tmp_path):
    faults = {"signed": ("vec3 d = x.rgb - y;", "vec3 d = y - x.rgb;"), "relative": ("abs(y) + epsilon", "abs(y)")}

    with opened(browser, planted(folder, *faults[name], tmp_path), "webgl2") as page:
        change(page, f"{{layout: 'all', mode: '{name}'}}")
        with pytest.raises(AssertionError):
            check_error(page, folder, name, 3, pane=3)


def test_a_crop_is_marked_by_dragging_and_shared_by_the_address(browser, folder):
    with opened(browser, folder) as page:
        change(page, "{layout: 'split', mode: 'signed', image: 2}")
        x, y, *_ = page.box(".viewer-stage")
        pane = page.do("(p => [p.origin.x, p.origin.y, p.scale])(glossbenchViewer.panes[0])")
        corner = [(x + pane[0] + pane[2] * i + 1, y + pane[1] + pane[2] * j + 1) for i, j in ((10, 20), (25, 29))]

        page.drag(*corner, shift=True)
        page.wait("location.hash.includes('crop=')")
        address = page.do("location.hash")

        assert urllib.parse.parse_qs(address[1:])["crop"] == ["10,20,16,10"]
    with opened(browser, folder, fragment=address) as again:
        state = again.do("glossbenchViewer.state")
        assert state["crops"] == [{"x": 10, "y": 20, "width": 16, "height": 10}]
        assert (state["layout"], state["mode"], state["image"]) == ("split", "signed", 2)
        again.wait("[...document.querySelectorAll('.viewer-tiles canvas')].length === 6")
        tile = "document.querySelectorAll('.viewer-tiles canvas')[3].getContext('2d').getImageData(0, 0, 16, 10).data"
        again.wait(f"{tile}.some((v) => v)")
        drawn = np.array(again.do(f"Array.from({tile})")).reshape(10, 16, 4)
        image = truth(folder, 3)
        inside = image.mask[20:30, 10:26]
        error = (image.x - image.y).mean(axis=2)[20:30, 10:26]
        assert ((drawn[..., 3] == 255) == inside).all()
        red = drawn[..., 0].astype(int) - drawn[..., 2]
        strong = inside & (np.abs(error) > 0.02)
        assert strong.any()
        assert (np.sign(red) == np.sign(error))[strong].all()
        assert of_the_page(again.complaints()) == []


@pytest.mark.parametrize(
    "fragment",
    ["#image=no-such-cell", "#image=ref0&crop=1,2,3", "#image=ref0&crop=60,60,50,50&zoom=NaN&at=x,y&layout=%3Cb%3E",
     "#image=ref0&zoom=-1&range=-5&stops=1e99", "#table", "#%E0%A4%A"],
)  # fmt: skip
def test_an_address_that_is_damaged_opens_the_page_all_the_same(fragment, browser, folder):
    with opened(browser, folder, fragment=fragment) as page:
        assert page.do("glossbenchViewer.state.crops") == []
        assert page.complaints() == []


def test_the_page_opens_a_cell_by_its_key(page, folder):
    page.do("scrollTo(0, 0)")

    page.do("document.dispatchEvent(new CustomEvent('open-cell', {detail: {key: 'split_sum-4-1'}}))")
    page.wait(READY)

    assert page.do("[glossbenchViewer.state.group, glossbenchViewer.state.image]") == [1, 5]
    assert page.do("document.activeElement === glossbenchViewer.stage")
    assert "6 of 6, split_sum" in page.text(".viewer-status")
    change(page, "{layout: 'one'}")
    check_image(page, folder, 5, group=1)


def test_without_webgl2_images_are_drawn_all_the_same_and_the_page_says_so(browser, folder):
    script = """
        const canvas = HTMLCanvasElement.prototype, get = canvas.getContext;
        canvas.getContext = function (kind, ...more) {
          return kind === 'webgl2' ? null : get.call(this, kind, ...more);
        };
    """

    with opened(browser, folder, "webgl2", script=script) as page:
        change(page, "{layout: 'one', image: 3}")

        check_image(page, folder, 3)
        assert "the processor colours the images" in page.do("document.querySelector('.viewer-painter').textContent")
        assert page.complaints() == []


def test_zooming_colours_no_image_again(browser, folder):
    script = """
        const context = CanvasRenderingContext2D.prototype, put = context.putImageData;
        globalThis.coloured = 0;
        context.putImageData = function (...all) { coloured++; put.apply(this, all); };
    """
    with opened(browser, folder, script=script) as page:
        change(page, "{layout: 'all'}")
        before = page.do("coloured")
        x, y, *_ = page.box(".viewer-stage")
        page.click(x + 100, y + 100)

        for _ in range(10):
            page.mouse("mouseWheel", x + 100, y + 100, deltaX=0, deltaY=-60)
        page.wait("glossbenchViewer.state.zoom > 8")
        page.wait(READY)

        assert page.do("coloured") == before


@pytest.fixture(scope="module")
def large(folder, tmp_path_factory):
    """The same results, with images too large for the page."""
    copy = shutil.copytree(folder, tmp_path_factory.mktemp("large") / "large")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(payload, "INLINE", 0)
        html.write_report(copy)
    return copy


@pytest.fixture
def beside(large, tmp_path):
    """They, in a folder of one's own."""
    return shutil.copytree(large, tmp_path / "large")


def test_large_images_are_files_next_to_the_page(large, folder, browser):
    files = sorted((large / "report_images").iterdir())

    with opened(browser, large) as page:
        change(page, "{layout: 'one', image: 4}")

        assert len(files) == 12
        assert (large / "report.html").stat().st_size < (folder / "report.html").stat().st_size
        check_image(page, folder, 4)
        assert page.complaints() == []


def test_a_lost_image_file_is_named(beside, browser):
    shutil.rmtree(beside / "report_images")

    with browser.open(beside / "report.html") as page:
        page.wait("globalThis.glossbenchViewer")
        page.do("document.getElementById('viewer').scrollIntoView()")
        page.wait("glossbenchViewer.panes?.every(({image}) => image?.problem)")

        problem = page.do("glossbenchViewer.panes[0].image.problem")
        assert re.fullmatch(r"report_images/\w{20}\.js is missing: keep that folder next to this page", problem)


def test_image_files_of_an_older_page_are_removed(beside, folder, monkeypatch):
    names = {path.name for path in (beside / "report_images").iterdir()}
    Results(beside).disk.own("report_images/old.js")  # by a page of this program; what others put there stays
    (beside / "report_images" / "old.js").write_text("")

    with monkeypatch.context() as patch:
        patch.setattr(payload, "INLINE", 0)
        html.write_report(beside)
    assert {path.name for path in (beside / "report_images").iterdir()} == names
    html.write_report(beside)
    assert not (beside / "report_images").exists()


HOSTILE = "<img src=x onerror=globalThis.hacked=1></script><script>hacked=1</script>${hacked=1}"


def test_a_hostile_name_is_text(tmp_path, browser):
    folder = write_results(tmp_path / "hostile", BUDGETS)
    cells = pd.read_parquet(folder / "cells.parquet")
    cells["method"] = cells.method.where(cells.method != "split_sum", HOSTILE)
    cells["light"] = HOSTILE
    cells.to_parquet(folder / "cells.parquet")
    html.write_report(folder)

    with opened(browser, folder) as page:
        change(page, "{layout: 'all', image: 5, crops: [{x: 20, y: 20, width: 8, height: 8}]}")
        page.do("glossbenchViewer.step(1); glossbenchViewer.step(-1)")
        page.wait(READY)

        assert HOSTILE in page.do("document.querySelector('.viewer-list').textContent")
        assert HOSTILE in page.do("document.querySelector('.viewer-group select').textContent")
        assert HOSTILE in page.do("document.querySelector('.viewer-crops').textContent")
        assert page.do("document.querySelectorAll('#viewer img, #viewer script').length") == 0
        assert page.do("typeof hacked") == "undefined"
        assert page.complaints() == []


def test_half_floats_in_the_page_are_those_of_the_images(page, folder):
    change(page, "{image: 3}")

    shown = np.array(page.do("Array.from(glossbenchViewer.panes[1].image.half)"), dtype=np.uint16).reshape(N, N, 4)
    reference = np.array(page.do("Array.from(glossbenchViewer.reference.half)"), dtype=np.uint16).reshape(N, N, 4)

    image = truth(folder, 3)
    assert (shown[..., :3].view(np.float16) == image.x.astype(np.float16)).all()
    assert ((reference[..., 3:].view(np.float16)[..., 0] == 1) == image.mask).all()


def test_packed_bytes_say_all_of_random_bits():
    rng = np.random.default_rng(3)
    planes = rng.integers(0, 0x7C00, (4, 5, 7)).astype(np.uint16).view(np.float16)

    data = np.frombuffer(zlib.decompress(payload.pack(planes)), np.uint8).astype(np.int64)

    folded = (256 * data[: planes.size] + data[planes.size :]).reshape(planes.shape)
    bits = np.where(folded & 1, -(folded >> 1) - 1, folded >> 1)
    bits = bits.cumsum(axis=2).cumsum(axis=1)
    bits[[0, 2]] += bits[1]
    assert (bits % 65536 == planes.view(np.uint16)).all()


def test_what_a_half_float_cannot_hold_is_its_largest():
    radiance = np.array([[[1e9, -1e9, np.nan], [np.inf, 65504.0, 1e-9]]])

    planes = payload._to_halves(radiance, np.ones((1, 2)))

    assert planes[:, 0, :].T.tolist() == [[65504.0, -65504.0, 0.0, 1.0], [65504.0, 65504.0, 0.0, 1.0]]


def test_a_reduced_flip_map_is_near_the_full_one():
    y, x = np.mgrid[:96, :96] / 95
    reference = np.exp(-((x - 0.4) ** 2 + (y - 0.5) ** 2) / 0.02)[..., None] * [1.0, 0.8, 0.6] + 0.05
    image = np.roll(reference, 4, axis=1)
    mask = np.hypot(x - 0.5, y - 0.5) < 0.45

    full, half = (payload._compute_flip(image * mask[..., None], reference * mask[..., None], mask, n) for n in (1, 2))

    assert half.shape == full.shape
    assert np.corrcoef(full[mask], half[mask])[0, 1] > 0.99  # measured: 0.997
    assert half[mask].mean() == pytest.approx(full[mask].mean(), rel=0.03)  # measured: 0.6 %


def test_keyboard_and_screen_reader_reach_all(page):
    labelled = page.do(
        "[...document.querySelectorAll('#viewer :is(button, select, input, [tabindex])')].filter((e) => "
        "!(e.labels?.length || e.textContent.trim() || e.getAttribute('aria-label'))).map((e) => e.outerHTML)"
    )
    page.do("document.querySelector('.viewer-list input:checked').focus()")

    page.key("ArrowDown")  # the browser's own step to the next radio button
    page.wait(READY)

    assert labelled == []
    assert page.do("glossbenchViewer.state.image") == 2
    assert page.text(".viewer-status").startswith("3 of 6, regular_sampling")


@pytest.mark.parametrize("dark", [False, True])
def test_on_a_phone_nothing_is_wider_than_the_window(dark, browser, folder):
    with opened(browser, folder, width=390, height=800, dark=dark) as page:
        change(page, "{layout: 'all', mode: 'smape', crops: [{x: 20, y: 20, width: 8, height: 8}]}")

        wide = page.do(
            "[...document.querySelectorAll('#viewer *')].filter((e) => e.offsetParent "
            "&& e.getBoundingClientRect().right > innerWidth + 1).map((e) => e.className || e.tagName)"
        )
        assert wide == []
        change(page, "{crops: []}")  # their outlines lie on the images
        for pane in (1, 5):
            check_error(page, folder, "smape", pane, pane=pane)


def test_two_fingers_zoom_and_one_scrolls_the_page_until_zoomed_in(browser, folder):
    check_fingers(browser, folder)


def test_the_check_of_fingers_notices_a_page_that_they_cannot_scroll(browser, folder, tmp_path):
    fault = "touchAction = this.state.zoom === null", "touchAction = this.state.zoom === 0"

    with pytest.raises(AssertionError):
        check_fingers(browser, planted(folder, *fault, tmp_path))


def check_fingers(browser, folder):
    with opened(browser, folder, width=390, height=800) as page:
        x, y, width, height = page.box(".viewer-stage")
        left, right, middle = x + 0.3 * width, x + 0.6 * width, y + height / 2
        top = page.do("scrollY")
        move(page, [(left, middle)], [(left, middle - 60)])
        scrolled = page.do("scrollY") - top
        fitted = page.do("[glossbenchViewer.state.zoom, glossbenchViewer.panes[0].scale]")
        middle -= scrolled

        move(page, [(left, middle), (right, middle)], [(left, middle), (right + right - left, middle)])
        page.wait(READY)
        zoomed, scale = page.do("[glossbenchViewer.state.zoom, glossbenchViewer.panes[0].scale]")
        before, top = page.do("[glossbenchViewer.state.centre, scrollY]")
        move(page, [(right, middle)], [(right, middle - 40)])

        assert 30 < scrolled <= 60
        assert fitted[0] is None
        assert zoomed is not None
        assert scale == pytest.approx(2 * fitted[1], rel=0.02)
        assert page.do("scrollY") == top
        assert page.do("glossbenchViewer.state.centre.y") - before["y"] == pytest.approx(40 / zoomed, abs=1 / zoomed)


def move(page, start, end):
    """Fingers go down, move in eight steps and are lifted."""
    page.touch("touchStart", *start)
    for t in np.linspace(0.125, 1, 8):
        page.touch("touchMove", *[tuple(np.add(a, t * np.subtract(b, a))) for a, b in zip(start, end, strict=True)])
    page.touch("touchEnd")


def test_a_lost_graphics_context_is_drawn_by_the_processor(browser, folder):
    with opened(browser, folder, "webgl2") as page:
        change(page, "{layout: 'one', image: 3}")

        page.do("glossbenchViewer.canvas.getContext('webgl2').getExtension('WEBGL_lose_context').loseContext()")
        page.wait("glossbenchViewer.root.dataset.painter === 'plain'")
        page.wait(READY)

        check_image(page, folder, 3)
        assert [text for text in page.complaints() if "WebGL" not in text] == []  # the driver's own words


def test_images_are_unpacked_only_when_they_are_nearly_seen(browser, folder):
    with browser.open(folder / "report.html", height=300) as page:
        page.wait("globalThis.glossbenchViewer")
        time.sleep(0.3)

        assert page.do("glossbenchViewer.root.getBoundingClientRect().top") > 700
        assert page.do("glossbenchViewer.store.images.size") == 0
