"""What a run prints: its table with intervals, and what it says about its times."""

import json

import pandas

from glossbench.commands.printing import err, print_table, warn_of_times


def told(monkeypatch, capsys, **columns):
    monkeypatch.setattr(err, "_file", None)
    rows = {"status": "done", "busy": 0.0, "processor": "one"} | columns
    warn_of_times(pandas.DataFrame(rows))
    return capsys.readouterr().err


def test_a_busy_machine_is_reported_in_one_line(monkeypatch, capsys):
    text = told(monkeypatch, capsys, busy=[0.05, 0.3, 0.6])

    assert text.startswith("2 of 3 cells were timed while other programs used up to 60 % of the processor time")
    assert text.count("\n") == 1


def test_two_processors_are_reported_in_one_line(monkeypatch, capsys):
    assert "timed on 2 processors" in told(monkeypatch, capsys, busy=[0.0, 0.0], processor=["one", "two"])


def test_a_quiet_machine_is_not_reported(monkeypatch, capsys):
    assert told(monkeypatch, capsys, busy=[0.0, 0.1], processor=["one", "one"]) == ""


def printed(capsys, *rows):
    """The lines of a table of rms and mean_error: below its heading those of the rows, then those of its words."""
    same = dict(light="spots", material="kurt", view="sphere", method="a", light_options="{}", material_options="{}",
                view_options="{}", tuned="{}", status="done", reason="", notes="[]", rms=0.1, mean_error=0.02,
                at_noise_floor=False, n_samples=4, stage_seconds="{}", update_seconds="{}",
                shade_seconds=1e-3)  # fmt: skip
    print_table(pandas.DataFrame([same | {"options": json.dumps({"k": i})} | row for i, row in enumerate(rows)]),
                ["rms", "mean_error"])  # fmt: skip
    _, *lines = capsys.readouterr().out.splitlines()
    return lines


# Of these the standard error is step sqrt(7), and Student's t of 7 degrees 2.3646.
LEFT_OUT = json.dumps({"rms": [0.1, *[0.099, 0.101] * 4], "mean_error": [0.02, *[0.01, 0.03] * 4]})


def test_the_table_has_half_the_interval_of_each_error(capsys):
    line, said = printed(capsys, {"left_out": LEFT_OUT})

    assert line.split()[-8:-1] == ["4", "0.1", "±", "0.006", "0.02", "±", "0.06"]
    assert said == "±: half of the 95 % interval"


def test_a_row_without_groups_has_its_errors_alone(capsys):
    [line] = printed(capsys, {})

    assert line.split()[-4:-1] == ["4", "0.1", "0.02"]


def test_at_the_noise_floor_the_table_still_has_what_is_signed(capsys):
    line, *_ = printed(capsys, {"left_out": LEFT_OUT, "at_noise_floor": True})

    assert line.split()[-6:-1] == ["4", "floor", "0.02", "±", "0.06"]
