"""`glossbench choose`: its lines, the cells that they name, and its messages."""

import json
import re
from pathlib import Path

import pandas as pd
import pytest

from oracles.command_line import words
from oracles.discs import write_results


@pytest.fixture(scope="module")
def discs(tmp_path_factory):
    folder = write_results(tmp_path_factory.mktemp("choose") / "discs", budgets=(4, 64))
    cells = pd.read_parquet(folder / "cells.parquet")
    cells["processor"], cells["busy"] = "Abacus 3", 0.0
    cells.to_parquet(folder / "cells.parquet")
    return folder


def test_the_answer_names_costs_cells_and_the_processor(call, discs):
    called = call("choose", discs, "--changes", "light", "--budget", "20 ms", "--memory", "4MB")

    said = words(called.out)
    assert called.code == 0
    assert "need new light in each frame; at most 20 ms; at most 4MB" in said
    assert "measured on Abacus 3 (cpu)" in said
    assert "1. regular_sampling (samples 4): rms 0.0502; 14.7 ms = 0.4 + 14.3, 2.1 MB lowest error 0.0501:" in said
    assert "(cell regular_)" in said
    assert "2. filtered_importance_sampling (samples 4): rms 0.0993, 1.98 [1.97, 1.98] times the first" in said
    assert "Too slow or too large: filtered_importance_sampling (samples 64): 20.7 ms" in said
    assert "Not comparable: broken: 2 of 2 conditions have no image; failed: MethodError:" in said
    assert "with 21 ms: filtered_importance_sampling (samples 64)" in said


def test_shading_times_are_scaled_to_the_stated_pixels(call, discs):
    said = words(call("choose", discs, "--budget", "3 ms at 128^2").out)

    assert "scaled from 2,876 to 16,384 pixels" in said
    assert "1. regular_sampling (samples 4): rms 0.0502; 2.28 ms" in said  # 0.4 ms * 16384 / 2876


def test_only_anisotropic_materials_count(call, discs):
    said = words(call("choose", discs, "--anisotropic").out)

    assert "material: kurt (m [0.2, 0.075])" in said
    assert "the geometric mean over 1 condition" in said


WRONG = {
    ("--changes", "ligth"): "--changes: nothing that changes is called 'ligth'; did you mean 'light'?",
    ("--budget", "1 msec"): "--budget: no unit is called 'msec'; did you mean 'ms'?",
    ("--budget", "fast"): "--budget must be a positive number with its unit, such as \"1 ms at 128^2\", got 'fast'",
    ("--budget", "-1 ms"): "--budget must be a positive number with its unit, such as \"1 ms at 128^2\", got '-1 ms'",
    ("--budget", "1 ms at big"): "--budget: the size must be such as 128^2, 640x480 or 16384, got 'big'",
    ("--memory", "4mb"): "--memory: no unit is called 'mb'; did you mean 'MB'?",
    ("--metric", "rsm"): "--metric: no error of these results is called 'rsm'; did you mean 'rms'?",
}


@pytest.mark.parametrize("options", WRONG)
def test_wrong_input_gives_one_line_with_the_nearest_name(call, discs, options):
    called = call("choose", discs, *options)

    assert (called.code, called.err) == (2, f"error: {WRONG[options]}\n")
    assert called.out == ""


def test_without_an_anisotropic_material_the_question_has_no_answer(call, discs, tmp_path):
    cells = pd.read_parquet(discs / "cells.parquet")
    cells["material_options"] = json.dumps({"m": [0.1, 0.1]})
    for name in ("study.yaml", "claims.json", "provenance.json"):
        (tmp_path / name).write_bytes((discs / name).read_bytes())
    cells.to_parquet(tmp_path / "cells.parquet")

    called = call("choose", tmp_path, "--anisotropic")

    assert called.code == 2
    assert called.err == "error: --anisotropic: no material of these results is anisotropic: kurt\n"
    assert "does not say how many pixels were timed" in call("choose", tmp_path, "--budget", "1 ms at 8^2").err


def test_the_road_in_python_of_the_documentation_gives_names(discs, capsys):
    page = (Path(__file__).parents[2] / "docs" / "choose-a-method.md").read_text(encoding="utf-8")
    [road] = re.findall(r"```python\n(.*?)```", page, re.DOTALL)

    exec(compile(road.replace("results/quickstart", str(discs)), "choose-a-method.md", "exec"), {})

    assert capsys.readouterr().out.startswith("['filtered_importance_sampling (samples 64)', 'regular_sampling")
