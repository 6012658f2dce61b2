"""The command run: what it prints and writes, and how it ends."""

import json
import re
import sys
import time
from pathlib import Path

import pandas
import pytest
import torch
import yaml

from glossbench.commands import cli, printing
from glossbench.commands import run as run_command
from glossbench.envmap.formats.files import write_exr
from glossbench.run.results import Results
from glossbench.study.study import load_study
from oracles.command_line import STUDY, files_under, words
from oracles.forks import ran

pytestmark = pytest.mark.usefixtures("here")


@pytest.mark.usefixtures("without_reports")
def test_a_run_says_what_of_a_mesh_was_repaired(call):
    corners = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\n"
    Path("quad.obj").write_text(corners + "f 1 2 3\nf 1 3 4\nf 1 1 2\n")
    study = STUDY | {"view": {"mesh": {"shape": "quad.obj", "resolution": 4, "azimuth": 0, "elevation": 0}}}
    Path("quad.yaml").write_text(yaml.safe_dump(study))

    called = call("run", "quad.yaml")

    assert called.err.count("note: mesh quad.obj: left out 1 of 3 faces, which have no area") == 1


def test_a_run_ends_with_a_table_verdicts_and_the_path_of_the_report(call):
    code, out, err = call("run", "tiny.yaml")

    results = Results("results/tiny")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert words(lines[0]) == "light material method samples rms relative_rms mean_error max_error shade ms"
    rows = [line.split() for line in lines[1:5]]
    assert [row[2:4] for row in rows] == [
        [method, samples] for method in ("importance_sampling", "environment_sampling") for samples in ("4", "8")
    ]
    for row, rms in zip(rows, results.cells["rms"], strict=True):
        assert row[4] in ("floor", f"{rms:.4g}")
    [claim] = results.claims
    assert f"{claim['verdict']} A [b] /c {claim['summary']}" in words(out)
    assert lines[-2:] == ["report: results/tiny/report.html", "report: results/tiny/report.pdf"]
    assert Path("results/tiny/report.html").is_file()
    assert Path("results/tiny/report.pdf").is_file()


@pytest.mark.usefixtures("without_reports")
def test_the_table_names_the_options_that_distinguish_cells(call):
    study = STUDY | {
        "view": {"sphere": {"resolution": [4, 8]}},
        "methods": [{"filtered_importance_sampling": {"samples": 4, "mip_filter": ["box", "gauss4"]}}],
        "claims": [],
    }
    Path("told.yaml").write_text(yaml.safe_dump(study))

    lines = call("run", "told.yaml").out.splitlines()

    assert words(lines[0]).startswith("light material view method samples")
    named = [f"sphere (resolution {r}) filtered_importance_sampling (mip_filter {f}) 4"
             for r in (4, 8) for f in ("box", "gauss4")]  # fmt: skip
    assert all(text in words(line) for text, line in zip(named, lines[1:5], strict=True))


@pytest.mark.usefixtures("without_reports")
def test_a_log_gets_a_line_of_progress_now_and_then(call, monkeypatch):
    monkeypatch.setattr(printing, "PULSE", 0.0)

    err = call("run", "tiny.yaml", "--no-cache").err

    assert "0 of 4 cells, " in err
    assert "3 of 4 cells, " in err


def test_another_process_prints_the_same_kind_of_end(here):
    code = "import glossbench.commands.run as run\n" \
        "run._report_writers = lambda: {'html': lambda folder: folder / 'report.html'}\n" \
        "from glossbench.commands.cli import main; main()"  # fmt: skip

    done = ran(code, "run", "tiny.yaml", "-o", "elsewhere", log=here / "log")

    said = [line for line in done.stderr.splitlines() if "were timed while" not in line]  # the machine may be busy
    assert (done.returncode, said) == (0, [])
    assert done.stdout.splitlines()[-1] == "report: elsewhere/report.html"
    assert (here / "elsewhere" / "cells.parquet").is_file()


@pytest.mark.usefixtures("without_reports")
def test_a_folder_whose_name_looks_like_markup_is_printed_as_it_is(call):
    out = call("run", "tiny.yaml", "-m", "importance_sampling", "-o", "a[bold]b").out

    assert out.splitlines()[-1] == "report: a[bold]b/report.html"


@pytest.mark.usefixtures("without_reports")
def test_a_failed_cell_is_reported_and_the_exit_code_is_1(call, monkeypatch):
    from glossbench.methods.importance_sampling import ImportanceSampling

    def broken(self, points, material, texels, irradiance):
        raise RuntimeError("planted [/fault]")

    monkeypatch.setattr(ImportanceSampling, "shade", broken)

    code, out, err = call("run", "tiny.yaml")

    assert code == 1
    assert "failed: importance_sampling: RuntimeError: planted [/fault]" in out.splitlines()
    assert words(err).startswith("2 cells failed: ")
    monkeypatch.undo()


@pytest.mark.usefixtures("without_reports")
def test_rerun_failed_computes_failed_cells_again(call, monkeypatch):
    from glossbench.methods.importance_sampling import ImportanceSampling

    with monkeypatch.context() as patch:
        patch.setattr(ImportanceSampling, "half_vectors", lambda self, material: 1 / 0)
        first = call("run", "tiny.yaml")
        fast = call_raising(ZeroDivisionError, "run", "tiny.yaml", "--fail-fast", "--no-cache")
    kept = call("run", "tiny.yaml")

    mended = call("run", "tiny.yaml", "--rerun-failed")

    assert (first.code, kept.code, mended.code) == (1, 1, 0)
    assert fast
    assert set(Results("results/tiny").cells["status"]) == {"done"}


def call_raising(error: type[Exception], *arguments: str) -> bool:
    """Calls the command line, which must end with this exception."""
    before, sys.argv = sys.argv, ["glossbench", *arguments]
    try:
        with pytest.raises(error):
            cli.main()
    finally:
        sys.argv = before
    return True


@pytest.mark.usefixtures("without_reports")
def test_only_the_named_methods_run_and_the_study_on_disk_says_so(call):
    assert call("run", "tiny.yaml", "-m", "environment_sampling").code == 0

    assert set(Results("results/tiny").cells["method"]) == {"environment_sampling"}
    again = load_study("results/tiny/study.yaml")
    assert {item.name for item in again.methods} == {"environment_sampling"}
    assert again.claims == ()


@pytest.mark.usefixtures("without_reports")
def test_the_seed_reaches_the_reference_and_the_methods(call):
    call("run", "tiny.yaml", "--seed", 5, "-m", "importance_sampling")

    resolved = Results("results/tiny").study
    assert (resolved["seed"], resolved["reference"]["seed"]) == (5, 5)
    assert [method["importance_sampling"]["seed"] for method in resolved["methods"]] == [5, 5]


def test_a_light_on_the_command_line_replaces_those_of_the_study(call):
    write_exr("probe.exr", torch.ones(8, 16, 3))

    code, out, _ = call("run", "quickstart", "--light", "probe.exr", "--dry-run")

    n_cells = len(load_study("quickstart").cells())
    lines = out.splitlines()
    assert code == 0
    assert lines[-2] == f"{n_cells} cells would go to results/quickstart_probe: {n_cells} new"
    assert all(line.startswith("new  probe.exr  ") for line in lines[:-2])


@pytest.mark.usefixtures("without_reports")
def test_a_run_under_another_light_writes_next_to_the_study_s_own_results(call):
    write_exr("probe.exr", torch.ones(8, 16, 3))

    code, out, _ = call("run", "tiny.yaml", "--light", "probe.exr", "-m", "importance_sampling")

    assert code == 0
    assert out.splitlines()[-1] == "report: results/tiny_probe/report.html"
    assert Results("results/tiny_probe").study["light"][0]["file"]["file"] == "probe.exr"


def test_a_dry_run_names_the_cells_and_writes_nothing(call, here):
    before = files_under(here)

    code, out, err = call("run", "tiny.yaml", "--dry-run", "-o", "x[1]")

    lines = out.splitlines()
    assert (code, err) == (0, "")
    assert lines[:-1] == [
        "new  gradient  ggx  importance_sampling (samples 4)",
        "new  gradient  ggx  importance_sampling (samples 8)",
        "new  gradient  ggx  environment_sampling (samples 4)",
        "new  gradient  ggx  environment_sampling (samples 8)",
        "4 cells would go to x[1]: 4 new",
    ]
    assert lines[-1].startswith(("what this takes is not known", "this takes about "))
    assert files_under(here) == before


def test_a_dry_run_says_which_cells_are_done_and_which_have_failed(call, results):
    kept = Results(results)
    kept.add_cell(kept.cell(kept.cells["key"][0]) | {"status": "failed"}, None, None)

    lines = call("run", "tiny.yaml", "--dry-run").out.splitlines()

    assert [line.split()[0] for line in lines[:4]] == ["failed", "done", "new", "new"]
    assert lines[4] == "4 cells would go to results/tiny: 1 done, 1 failed, 2 new"
    assert lines[6] == "failed cells stay as they are; --rerun-failed tries them again"


def test_an_interrupt_ends_with_130_and_one_line(call, monkeypatch):
    monkeypatch.setattr(
        "glossbench.run.references.compute_reference", lambda *a: (_ for _ in ()).throw(KeyboardInterrupt)
    )

    code, _, err = call("run", "tiny.yaml")

    assert code == 130
    assert words(err) == "interrupted: cells that are done are kept, the same command goes on from there"


def test_an_interrupted_process_ends_with_130(here):
    code = "import os, signal, time, glossbench.run.references as r\n" \
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n" \
        "r.compute_reference = lambda *a: (os.kill(os.getpid(), signal.SIGINT), time.sleep(60))\n" \
        "from glossbench.commands.cli import main; main()"  # fmt: skip

    done = ran(code, "run", "tiny.yaml", log=here / "log")

    assert done.returncode == 130
    assert words(done.stderr).startswith("interrupted: ")


def planted_fault(folder: Path) -> Path:
    raise RuntimeError("planted\n[/fault]")


def kept_report(folder: Path) -> Path:
    (folder / "kept.html").write_text("kept")
    return folder / "kept.html"


def test_a_report_that_fails_is_one_line_after_the_verdicts_and_the_others_are_written(call, monkeypatch):
    monkeypatch.setattr(run_command, "_report_writers", lambda: {"broken": planted_fault, "kept": kept_report})

    code, out, err = call("run", "tiny.yaml")

    assert code == 1
    assert "A [b] /c" in out
    assert out.splitlines()[-1] == "report: results/tiny/kept.html"
    [line] = [line for line in err.splitlines() if line.startswith("error: ")]  # times may be noted, too
    assert re.fullmatch(
        r"error: the broken report was not written: RuntimeError: planted \[/fault\] \(test_run_command.py:\d+\)", line
    )
    assert call("report", "results/tiny").code == 1


def test_an_interrupt_while_reports_are_written_says_that_the_results_are_whole(call, monkeypatch):
    monkeypatch.setattr(
        run_command, "_report_writers", lambda: {"slow": lambda folder: (_ for _ in ()).throw(KeyboardInterrupt)}
    )

    code, out, err = call("run", "tiny.yaml")

    assert code == 130
    assert "A [b] /c" in out
    assert err == "interrupted: the results are whole: `glossbench report results/tiny` writes the reports\n"


def test_the_table_of_5000_cells_is_its_first_rows_and_a_count(capsys):
    row = dict(light="spots", material="kurt", view="sphere", method="importance_sampling", light_options="{}",
               material_options="{}", view_options="{}", tuned="{}", reason="it cannot", notes="[]", rms=1.0,
               at_noise_floor=False, n_samples=4, stage_seconds="{}", update_seconds="{}",
               shade_seconds=1e-3)  # fmt: skip
    options = [json.dumps({"samples": i % 50, "seed": i // 50}) for i in range(5000)]
    status = ["skipped" if i == 4999 else "done" for i in range(5000)]
    cells = pandas.DataFrame([row | {"options": o, "status": s} for o, s in zip(options, status, strict=True)])
    started = time.process_time()

    printing.print_table(cells, ["rms"])

    lines = capsys.readouterr().out.splitlines()
    more, reason, *words = lines[1 + printing.MAX_ROWS :]
    assert more == "... and 4960 more of 5000 rows: all are in the report and in cells.parquet"
    assert reason == "skipped: importance_sampling: it cannot"
    assert [line.partition(":")[0] for line in words] == ["seed"]
    # Measured 0.7 s; where each row is compared with all others, four minutes.
    assert time.process_time() - started < 10
