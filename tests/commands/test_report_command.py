"""Reports and figures written again, and what the machine is."""

from pathlib import Path

import pytest
import torch

from glossbench.commands import run as run_command
from glossbench.run.runner import Progress, run_study
from glossbench.study.study import load_study
from oracles.command_line import files_under

pytestmark = pytest.mark.usefixtures("here")


def test_sys_info_names_versions_and_the_machine(call):
    code, out, _ = call("sys-info")

    said = dict(line.split(": ", 1) for line in out.splitlines())
    assert code == 0
    assert said["torch"] == torch.__version__
    assert {"glossbench", "python", "numpy", "platform", "processor", "cores", "cuda"} <= set(said)


@pytest.mark.usefixtures("results")
def test_report_writes_the_reports_again(call):
    paths = [Path(f"results/tiny/report.{name}") for name in ("html", "pdf")]

    code, out, _ = call("report", "results/tiny")

    assert (code, out) == (0, "".join(f"report: {path}\n" for path in paths))
    assert [path.read_bytes()[:4] for path in paths] == [b"<!DO", b"%PDF"]


@pytest.mark.usefixtures("results")
@pytest.mark.parametrize(
    ("asked", "names"), [([], "html pdf"), (["pdf"], "pdf"), (["html"], "html"), (["pdf", "html"], "html pdf")]
)
def test_report_writes_the_stated_reports(call, monkeypatch, asked, names):
    written = []
    writers = {name: lambda folder, name=name: written.append(name) or folder / name for name in ("html", "pdf")}
    monkeypatch.setattr(run_command, "_report_writers", lambda: writers)

    code, out, _ = call("report", "results/tiny", *asked)

    assert (code, out) == (0, "".join(f"report: results/tiny/{name}\n" for name in written))
    assert written == names.split()


@pytest.mark.usefixtures("results")
def test_a_report_of_an_unknown_name_is_bad_input_and_writes_none(call, monkeypatch):
    monkeypatch.setattr(run_command, "_report_writers", lambda: {"html": None, "pdf": None})

    code, out, err = call("report", "results/tiny", "pdf", "htm")

    assert (code, out) == (2, "")
    assert err == "error: no report is called 'htm'; did you mean 'html'?\n"


@pytest.mark.parametrize("changes", [["-m", "environment_sampling"], ["-m", "importance_sampling", "--seed", "3"]])
def test_a_run_does_not_write_over_results_of_another(call, results, changes):
    before = files_under(results)

    code, out, err = call("run", "tiny.yaml", *changes)

    assert (code, out) == (2, "")
    assert err.startswith("error: results/tiny holds results that this run does not have, and that would be lost: ")
    assert files_under(results) == before


def test_a_report_of_an_unfinished_run_says_how_far_it_is(call, monkeypatch):
    monkeypatch.setattr(run_command, "_report_writers", lambda: {"html": lambda folder: folder / "report.html"})
    study = load_study("tiny.yaml")
    stopped = iter([None])
    with pytest.raises(StopIteration):
        run_study(study, Path("results/tiny"), progress=Progress(cell=lambda row: next(stopped)))

    code, _, err = call("report", "results/tiny")

    assert (code, err) == (0, "note: 2 of 4 cells are done: the claims are judged on these\n")


@pytest.mark.usefixtures("results")
def test_figures_are_listed_and_written(call):
    _, listed, _ = call("figure", "results/tiny")
    code, out, _ = call("figure", "results/tiny", "crops", "--crop", "1,2,3,4", "-o", "c.svg")
    by_default = call("figure", "results/tiny", "answer").out

    assert [line.split()[0] for line in listed.splitlines() if line] == [
        "answer", "convergence", "costs", "crops", "fronts", "images", "profile"
    ]  # fmt: skip
    assert (code, out) == (0, "figure: c.svg\n")
    assert Path("c.svg").read_text().startswith("<svg")
    assert by_default == "figure: results/tiny/answer.pdf\n"
    assert Path("results/tiny/answer.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["crop"], "error: no figure is called 'crop'; did you mean 'crops'?"),
        (["costs", "--crop", "1,2,3,4"], "error: the figure costs has no option --crop"),
        (["crops", "--crop", "1,2,3"], "error: --crop must be four whole numbers X,Y,WIDTH,HEIGHT, got '1,2,3'"),
        (["crops", "--group", "2"], "error: --group must be one of 1: "),
        (["convergence", "--over", "k"], "error: results/tiny does not sweep 'k': --over must be one of "),
        (["crops", "-o", "a.gif"], "error: a.gif: the extension must be .pdf, .svg or .png, got '.gif'"),
    ],
)
@pytest.mark.usefixtures("results")
def test_a_wrong_call_of_figure_is_one_line(call, arguments, message):
    code, out, err = call("figure", "results/tiny", *arguments)

    assert (code, out) == (2, "")
    assert err.startswith(message)
    assert err.count("\n") == 1
