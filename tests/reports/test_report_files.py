"""The files that a report writes and removes next to its page: only its own files."""

import base64
import json
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from glossbench.errors import InputError
from glossbench.reports import style
from glossbench.reports.model.report import Report
from glossbench.reports.page import beside as beside_the_page
from glossbench.reports.page import html, payload
from glossbench.run.folder import Folder
from glossbench.run.manifest import Manifest
from glossbench.run.results import Results
from oracles.discs import write_results

PLANTED = 'document.documentElement.setAttribute("data-planted", "1");'


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Results, and a page whose images are files next to it."""
    folder = write_results(tmp_path_factory.mktemp("made") / "discs", budgets=(4,))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(payload, "INLINE", 0)
        patch.setattr(style, "to_svg", lambda *_: "")
        html.write_report(folder)
    return folder


@pytest.fixture(autouse=True)
def beside(monkeypatch):
    """Images are files next to the page; nothing is drawn, because that takes most of the time."""
    monkeypatch.setattr(payload, "INLINE", 0)
    monkeypatch.setattr(style, "to_svg", lambda *_: "")
    monkeypatch.setattr(html, "_describe_methods", lambda names: [])


@pytest.fixture
def folder(made, tmp_path):
    return shutil.copytree(made, tmp_path / "discs")


def scripts(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in (folder / "report_images").iterdir()}


def test_a_script_that_was_planted_next_to_the_page_is_overwritten(folder):
    before = scripts(folder)
    for path in (folder / "report_images").iterdir():
        path.write_text(PLANTED + path.read_text())

    html.write_report(folder)

    assert scripts(folder) == before
    assert len(before) > 2


def test_a_script_of_the_same_length_is_written_over(folder):
    before = scripts(folder)
    for path in (folder / "report_images").iterdir():
        path.write_text(PLANTED.ljust(path.stat().st_size, "/"))

    html.write_report(folder)

    assert scripts(folder) == before


def test_images_of_an_older_page_go_and_files_of_others_stay(folder, monkeypatch):
    (folder / "report_images" / "app.js").write_text("precious")
    monkeypatch.setattr(payload, "INLINE", 10**9)

    html.write_report(folder)

    assert scripts(folder) == {"app.js": "precious"}
    assert [name for name in Manifest.read(Folder(folder)).files if name.startswith("report_images/")] == []


def test_a_folder_of_images_that_is_empty_goes(folder, monkeypatch):
    """Twin of the above."""
    monkeypatch.setattr(payload, "INLINE", 10**9)

    html.write_report(folder)

    assert not (folder / "report_images").exists()


def test_images_that_were_removed_already_are_ignored(folder, monkeypatch):
    shutil.rmtree(folder / "report_images")
    monkeypatch.setattr(payload, "INLINE", 10**9)

    html.write_report(folder)

    assert not (folder / "report_images").exists()


def test_a_planted_manifest_removes_nothing_but_images_of_a_page(folder, tmp_path, monkeypatch):
    (tmp_path / "app.js").write_text("precious")
    (folder / "mine.js").write_text("precious")
    old = Manifest.read(Folder(folder))
    names = ["../app.js", "report_images/../mine.js", "report_images/../../app.js", str(tmp_path / "app.js"), "mine.js"]
    Manifest(old.cells, {**old.files, **dict.fromkeys(names)}, old.is_finished).write(Folder(folder))
    monkeypatch.setattr(payload, "INLINE", 10**9)

    html.write_report(folder)

    assert (tmp_path / "app.js").read_text() == (folder / "mine.js").read_text() == "precious"


@pytest.mark.parametrize("inline", [0, 10**9])
def test_a_folder_of_images_that_is_a_link_is_not_followed(folder, tmp_path, monkeypatch, inline):
    mine = tmp_path / "mine"
    shutil.move(folder / "report_images", mine)
    (mine / "app.js").write_text("precious")
    (folder / "report_images").symlink_to(mine)
    before = {path: path.read_bytes() for path in mine.iterdir()}
    monkeypatch.setattr(payload, "INLINE", inline)

    with pytest.raises(InputError, match="leads out of the folder of results"):
        html.write_report(folder)

    assert {path: path.read_bytes() for path in mine.iterdir()} == before


@pytest.mark.parametrize("is_link", [False, True])
def test_a_foreign_page_is_not_overwritten(folder, tmp_path, is_link):
    old = Manifest.read(Folder(folder))
    files = {name: checksum for name, checksum in old.files.items() if name != "report.html"}
    Manifest(old.cells, files, old.is_finished).write(Folder(folder))
    mine = tmp_path / "mine.html"
    mine.write_text("precious")
    (folder / "report.html").unlink()
    (folder / "report.html").symlink_to(mine) if is_link else shutil.copy(mine, folder / "report.html")

    with pytest.raises(InputError, match=r"report\.html (was not written by glossbench|leads out of)"):
        html.write_report(folder)

    assert mine.read_text() == (folder / "report.html").read_text() == "precious"


def planted_map(path: Path) -> None:
    np.savez_compressed(path, steps=np.zeros((3, 3), np.uint16))


def planted_pickle(path: Path) -> None:
    np.savez_compressed(path, steps=np.array([os.system], dtype=object), allow_pickle=True)


def halved(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-60])


def flipped(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 4
    path.write_bytes(content)


@pytest.mark.parametrize("harm", [halved, flipped, planted_map, planted_pickle])
def test_a_damaged_flip_map_is_made_again(folder, harm):
    before = scripts(folder)
    path = sorted((folder / "images").glob("*_flip_1.npz"))[0]
    with np.load(path) as kept:
        steps = kept["steps"]
    harm(path)

    html.write_report(folder)

    with np.load(path) as kept:
        assert (kept["steps"] == steps).all()
    assert scripts(folder) == before


def test_a_folder_that_may_only_be_read_is_one_line(folder, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)

    with pytest.raises(InputError, match=r"report\.html: cannot be written: the folder is read-only$"):
        html.write_report(folder)


def test_a_page_of_a_run_that_is_not_finished_says_how_far_it_is(folder):
    old = Manifest.read(Folder(folder))
    keys = [path.stem for path in (folder / "images").glob("*[0-9].exr")]
    cells = tuple({"key": key, "light_options": "{}", "seed": 0} for key in [*keys, "absent"])
    table = html.Results(folder).cells.to_dict("records")
    (folder / "cells").mkdir()
    for row in table:
        if row["key"] in keys:
            (folder / "cells" / f"{row['key']}.json").write_text(json.dumps(row))
    Manifest(cells, old.files, False).write(Folder(folder))

    page = html.write_report(folder).read_text()

    assert f"{len(keys)} of {len(keys) + 1} cells are done: the claims are judged on these" in page


# The table of cells.


def link_of(folder: Path) -> str:
    return re.search(r'<a download="cells.csv" href="([^"]*)"', (folder / "report.html").read_text())[1]


def test_a_large_table_is_a_file_next_to_the_page_and_goes_with_it(folder, monkeypatch):
    small = link_of(folder)
    monkeypatch.setattr(beside_the_page, "INLINE_CSV", 0)

    html.write_report(folder)
    large = link_of(folder)
    table = (folder / large).read_bytes()
    monkeypatch.undo()
    html.write_report(folder)

    assert large == "report_images/cells.csv"
    assert base64.b64decode(small.partition("base64,")[2]) == table
    assert not (folder / large).exists()


def test_a_foreign_table_of_that_name_is_not_overwritten(folder, monkeypatch):
    (folder / "report_images" / "cells.csv").write_text("precious")
    monkeypatch.setattr(beside_the_page, "INLINE_CSV", 0)

    with pytest.raises(InputError, match=r"cells\.csv was not written by glossbench"):
        html.write_report(folder)

    assert (folder / "report_images" / "cells.csv").read_text() == "precious"


@pytest.mark.parametrize("most", [10, 1500])  # bytes; an image has about 1000
def test_images_are_in_the_page_or_next_to_it_but_never_in_both(made, folder, monkeypatch, most):
    monkeypatch.setattr(payload, "INLINE", most)

    built = payload.build_payload(Results(folder), Report.from_results(Results(folder)).groups)

    assert not built.blocks
    assert {path.name for path in (made / "report_images").iterdir()} == built.files
