"""What a run prints about its times."""

import pandas

from glossbench.commands.printing import err, warn_of_times


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
