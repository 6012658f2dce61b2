"""A run that changes nothing leaves the reports; whatever a report is made of makes it new."""

from pathlib import Path

import pytest
import yaml

from glossbench.commands import report_marks
from glossbench.commands import run as run_command

REPORT = Path("results/tiny/report.html")


@pytest.fixture
def written(monkeypatch):
    """The reports that are written, each with another content."""
    paths = []

    def write(folder):
        paths.append(folder / "report.html")
        paths[-1].write_text(f"report {len(paths)}")
        return paths[-1]

    monkeypatch.setattr(run_command, "_report_writers", lambda: {"html": write})
    return paths


@pytest.fixture
def ran(call, results, written):
    """A run with a report, and a second one that left it."""
    first, second = (call("run", "tiny.yaml", "-m", "importance_sampling") for _ in range(2))
    assert first.code == second.code == 0
    assert first.out.splitlines()[-1] == second.out.splitlines()[-1] == f"report: {REPORT}"
    assert len(written) == 1
    return lambda *more: call("run", "tiny.yaml", "-m", "importance_sampling", *more)


@pytest.mark.parametrize(
    "change",
    [
        lambda: REPORT.write_text("edited"),
        lambda: REPORT.unlink(),
        lambda: Path("results/tiny/reports.json").write_text("{"),
        lambda: next(Path("results/tiny/cells").glob("*.json")).unlink(),
    ],
    ids=["an edited report", "no report", "a damaged mark", "a cell that is gone"],
)
def test_a_run_writes_a_report_again_after(change, ran, written):
    change()

    assert ran().code == 0

    assert len(written) == 2
    assert REPORT.read_text() == "report 2"


def test_no_cache_writes_it_again(ran, written):
    ran("--no-cache")

    assert len(written) == 2


def test_a_change_in_what_writes_reports_makes_them_new(ran, written, tmp_path, monkeypatch):
    (tmp_path / "writer").mkdir()
    template = tmp_path / "writer" / "page.html"
    template.write_text("a")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(report_marks, "WRITERS", ("writer",))
    ran()
    ran()
    assert len(written) == 2

    template.write_text("two")
    ran()

    assert len(written) == 3


def test_a_study_with_plug_ins_gets_its_report_each_time(call, written, here):
    Path("own.py").write_text("")
    study = yaml.safe_load(Path("tiny.yaml").read_text())
    Path("own.yaml").write_text(yaml.safe_dump(study | {"plugins": ["own"]}))

    for _ in range(2):
        assert call("run", "own.yaml", "-m", "importance_sampling").code == 0

    assert len(written) == 2
