"""Budgets are what methods say they are; times say how sure they are; a failure says where it was."""

import pandas
import pytest
from test_verdicts import cell, verdict_on

from glossbench.commands.printing import err, warn_of_times
from glossbench.contract.method_check import check_contract
from glossbench.envmap.lights.synthetic import Constant
from glossbench.prefilter.median_cut import whole

LOWER = {"lower": "a", "than": "b", "metric": "rms"}


def compared(a: str, b: str):
    """How many pairs of cells a claim compares, of two methods whose budgets have these names, at 14 and 17 each."""
    rows = [cell(m, rms=rms, options={name or "samples": n}, budget=name)
            for m, name, rms in (("a", a, 1.0), ("b", b, 2.0)) for n in (14, 17)]  # fmt: skip
    return len(verdict_on(LOWER, *rows)["numbers"])


def test_cells_are_paired_at_equal_budgets_whatever_their_names():
    assert compared("samples", "samples") == 2
    assert compared("rays", "rays") == 2
    assert compared("samples", "rays") == 2


def test_an_option_called_samples_that_is_no_budget_pairs_nothing():
    assert compared("samples", "") == 4
    assert compared("", "") == 4


def told(monkeypatch, capsys, **columns):
    monkeypatch.setattr(err, "_file", None)
    rows = {"status": "done", "busy": 0.0, "processor": "one"} | columns
    warn_of_times(pandas.DataFrame(rows))
    return capsys.readouterr().err


def test_a_busy_machine_is_told_in_one_line(monkeypatch, capsys):
    text = told(monkeypatch, capsys, busy=[0.05, 0.3, 0.6])

    assert text.startswith("2 of 3 cells were timed while other programs took the processor for 60 % of the time")
    assert text.count("\n") == 1


def test_two_processors_are_told_in_one_line(monkeypatch, capsys):
    assert "timed on 2 processors" in told(monkeypatch, capsys, busy=[0.0, 0.0], processor=["one", "two"])


def test_a_quiet_machine_is_not_told(monkeypatch, capsys):
    assert told(monkeypatch, capsys, busy=[0.0, 0.1], processor=["one", "one"]) == ""


def test_a_failed_check_names_file_and_line_of_the_plug_in_and_each_check_is_told(tmp_path, monkeypatch):
    code = "from glossbench.shading.method import METHODS, Method\n@METHODS.register('breaks_here')\nclass B(Method):\n"
    (tmp_path / "breaks_here_plugin.py").write_text(code + "    def shade(self, points):\n        raise KeyError(7)\n")
    monkeypatch.syspath_prepend(tmp_path)
    doing = []

    [furnace, *others] = check_contract("breaks_here_plugin", doing.append)

    assert (furnace.measured, furnace.where) == ("KeyError: 7", f"{tmp_path}/breaks_here_plugin.py:5")
    assert doing[0] == "breaks_here: furnace"
    assert len(doing) == 1 + len(others)


def test_a_light_without_a_direction_shines_from_above():
    direction = whole(Constant(resolution=2).cubemap()).direction

    assert [float(c) for c in direction] == [0.0, 1.0, 0.0]


def test_a_mean_direction_is_kept_where_there_is_one():
    light = Constant(resolution=2).cubemap()
    faces = light.faces.clone()
    faces[0] *= 2

    assert float(whole(type(light)(faces, "brighter")).direction.x[0]) == pytest.approx(1.0)
