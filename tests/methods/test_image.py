"""An image from elsewhere: its pixels are judged as those of a method are, and a wrong one is refused at once."""

from pathlib import Path

import pandas
import pytest
import torch

import glossbench as gb
from glossbench.columns import parse_row, read_cost
from glossbench.envmap.formats.files import write_exr
from glossbench.errors import InputError
from glossbench.run.runner import run_study
from glossbench.study.study import load_study

STUDY = """title: T
light: LIGHT
material: {ggx: {alpha: 0.5}}
view: {sphere: {resolution: 8}}
methods: [{importance_sampling: {samples: 4}}, {image: {file: picture.exr}}]
reference: {relative_error: 0.1}
metrics: [rms, mean_error]
"""


@pytest.fixture
def study(tmp_path, monkeypatch):
    """A study beside `picture.exr`, called from another folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study").mkdir()

    def study(image, light="constant", **options):
        write_exr(tmp_path / "study" / "picture.exr", image)
        text = STUDY.replace("LIGHT", light)
        for option, value in options.items():
            text = text.replace("picture.exr}", f"picture.exr, {option}: {value}}}")
        path = tmp_path / "study" / "s.yaml"
        path.write_text(text)
        return path

    return study


def rendered(**options):
    """What another program would have rendered: here a method of this project."""
    return gb.shade(
        gb.method("importance_sampling", samples=4), gb.light("constant"), gb.material("ggx", alpha=0.5),
        gb.view("sphere", resolution=8), time_it=False,
    ).radiance  # fmt: skip


def test_the_image_of_a_method_gets_the_errors_of_that_method(study):
    cells = run_study(load_study(study(rendered())), Path("results")).cells

    assert cells.status.tolist() == ["done", "done"]
    for metric in ("rms", "mean_error"):
        assert cells[metric][0] == cells[metric][1] != 0


def test_another_image_gets_other_errors(study):
    cells = run_study(load_study(study(1.1 * rendered())), Path("results")).cells

    assert cells.mean_error[1] != cells.mean_error[0]


def test_a_changed_file_is_a_new_cell(study):
    path = study(rendered())
    before = run_study(load_study(path), Path("results")).cells

    write_exr(path.parent / "picture.exr", 2 * rendered())
    after = run_study(load_study(path), Path("results")).cells

    assert after.key[0] == before.key[0]
    assert after.key[1] != before.key[1]


COSTS = ("stage_seconds", "update_seconds", "state_bytes")


@pytest.mark.parametrize("seconds", [None, 0.25])
def test_its_costs_are_unknown_except_for_a_stated_time(study, seconds):
    path = study(rendered(), **({} if seconds is None else {"shade_seconds": seconds}))

    rows = [parse_row(row) for row in run_study(load_study(path), Path("results")).cells.to_dict("records")]

    assert read_cost(rows[1], "shade_seconds") == seconds
    assert [read_cost(rows[1], cost) for cost in COSTS] == [None] * 3
    assert all(read_cost(rows[0], cost) is not None for cost in COSTS)


def with_a_nan(row, column):
    image = rendered()
    image[row, column, 1] = float("nan")
    return image


REFUSED = {
    "another size": (torch.ones(4, 8, 3), "has 8 x 4 pixels, but the view has 8 x 8"),
    "a pixel that is not a number": (with_a_nan(3, 4), "must be finite, but 1 are not, the first at row 3, column 4"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_wrong_image_is_refused_before_the_run(study, case):
    image, message = REFUSED[case]
    path = study(image)

    with pytest.raises(InputError, match=message) as caught:
        run_study(load_study(path), Path("results"))
    assert "\n" not in str(caught.value)
    assert not Path("results").exists()
    with pytest.raises(InputError, match=rf"{path}:5:\d+: methods\[1\].image: .*{message}"):
        load_study(path, open_files=True)


def test_a_pixel_beside_the_surface_may_be_anything(study):
    cells = run_study(load_study(study(with_a_nan(0, 0))), Path("results")).cells

    assert cells.status.tolist() == ["done", "done"]


def test_one_image_of_two_lights_is_refused(study):
    path = study(rendered(), light="[constant, {gradient: {resolution: 16}}]")

    with pytest.raises(InputError, match="belongs to one light, material and view, but 2 cells show it"):
        run_study(load_study(path), Path("results"))
    path.write_text(f"{path.read_text()}exclude: [{{light: gradient, method: image}}]\n")
    assert run_study(load_study(path), Path("results")).cells.status.tolist() == ["done"] * 3


def test_a_missing_file_is_one_line_with_its_place(study):
    path = study(rendered())
    (path.parent / "picture.exr").unlink()

    with pytest.raises(InputError, match=r"5:\d+: methods\[1\].image.file: no image file 'picture.exr': not in"):
        load_study(path)


def test_the_table_of_results_can_be_read_again(study, tmp_path):
    run_study(load_study(study(rendered())), tmp_path / "results")

    stored = pandas.read_parquet(tmp_path / "results" / "cells.parquet")

    assert stored.shade_seconds.isna().tolist() == [False, True]
