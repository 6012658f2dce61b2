"""The command line: what it prints, what it writes, and that an error is one line with exit code 2."""

import json
import subprocess
import sys
from inspect import cleandoc
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import torch
import yaml

from glossbench import cli
from glossbench.envmap.files import write_exr
from glossbench.options import option_names
from glossbench.results import Results
from glossbench.study import load_study, study_names

STUDY = {
    "title": "Tiny",
    "light": {"gradient": {"resolution": 16}},
    "material": {"ggx": {"alpha": 0.5}},
    "view": {"sphere": {"resolution": 8}},
    "methods": [{"importance_sampling": {"samples": [4, 8]}}, {"environment_sampling": {"samples": [4, 8]}}],
    "reference": {"relative_error": 0.05},
    "metrics": ["rms", "relative_rms", "mean_error", "max_error"],
    "claims": [{"text": "A [b] /c", "lower": "importance_sampling", "than": "environment_sampling", "metric": "rms"}],
}


class Called(NamedTuple):
    code: int
    out: str
    err: str


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """The current folder holds one small study."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("GLOSSBENCH_DATA", raising=False)
    Path("tiny.yaml").write_text(yaml.safe_dump(STUDY))
    return tmp_path


@pytest.fixture
def call(monkeypatch, capsys):
    """Calls the command line in this process."""

    def called(*arguments: Any) -> Called:
        monkeypatch.setattr(sys, "argv", ["glossbench", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as stopped:
            cli.main()
        code = stopped.value.code
        return Called(code if isinstance(code, int) else int(code is not None), *capsys.readouterr())

    return called


def written(**changes: Any) -> str:
    Path("other.yaml").write_text(yaml.safe_dump(STUDY | changes))
    return "other.yaml"


def process(*arguments: str) -> list[str]:
    return [sys.executable, "-c", "from glossbench.cli import main; main()", *arguments]


def words(text: str) -> str:
    return " ".join(text.split())


def everything(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() if path.is_file() else b"" for path in folder.rglob("*")}


# A run


def test_a_run_ends_with_a_table_verdicts_and_the_path_of_the_report(call):
    code, out, err = call("run", "tiny.yaml")

    results = Results("results/tiny")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert words(lines[0]) == "light material method samples rms relative_rms mean_error max_error shade ms"
    rows = [line.split() for line in lines[1:5]]
    assert [row[3:5] for row in rows] == [
        [method, samples] for method in ("importance_sampling", "environment_sampling") for samples in ("4", "8")
    ]
    for row, rms in zip(rows, results.cells["rms"], strict=True):
        assert row[5] in ("floor", f"{rms:.4g}")
    [claim] = results.claims
    assert f"{claim['verdict']} A [b] /c {claim['summary']}" in words(out)
    assert lines[-1] == "report: results/tiny/report.html"
    assert Path("results/tiny/report.html").is_file()


def test_another_process_prints_the_same_kind_of_end(here):
    done = subprocess.run(process("run", "tiny.yaml", "-o", "elsewhere"), capture_output=True, text=True)

    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[-1] == "report: elsewhere/report.html"
    assert (here / "elsewhere" / "cells.parquet").is_file()


def test_a_folder_whose_name_looks_like_markup_is_printed_as_it_is(call):
    out = call("run", "tiny.yaml", "-f", "importance_sampling", "-o", "a[bold]b").out

    assert out.splitlines()[-1] == "report: a[bold]b/report.html"


def test_a_failed_cell_is_told_and_the_exit_code_is_1(call, monkeypatch):
    from glossbench.methods.importance_sampling import ImportanceSampling

    def broken(self, points, material, texels, irradiance):
        raise RuntimeError("planted [/fault]")

    monkeypatch.setattr(ImportanceSampling, "shade", broken)

    code, out, err = call("run", "tiny.yaml")

    assert code == 1
    assert "failed: importance_sampling: RuntimeError: planted [/fault]" in out.splitlines()
    assert words(err).startswith("2 cells failed: ")
    monkeypatch.undo()


def test_failed_cells_are_mended_by_rerun_failed(call, monkeypatch):
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


def test_only_the_named_methods_run_and_the_study_on_disk_says_so(call):
    assert call("run", "tiny.yaml", "-f", "environment_sampling").code == 0

    assert set(Results("results/tiny").cells["method"]) == {"environment_sampling"}
    again = load_study("results/tiny/study.yaml")
    assert {item.name for item in again.methods} == {"environment_sampling"}
    assert again.claims == ()


def test_the_seed_reaches_the_reference_and_the_methods(call):
    call("run", "tiny.yaml", "--seed", 5, "-f", "importance_sampling")

    resolved = Results("results/tiny").study
    assert (resolved["seed"], resolved["reference"]["seed"]) == (5, 5)
    assert [method["importance_sampling"]["seed"] for method in resolved["methods"]] == [5, 5]


def test_a_light_on_the_command_line_replaces_those_of_the_study(call):
    write_exr("probe.exr", torch.ones(8, 16, 3))

    code, out, _ = call("run", "quickstart", "--light", "probe.exr", "--dry-run")

    n_cells = len(load_study("quickstart").cells())
    lines = out.splitlines()
    assert code == 0
    assert lines[-1] == f"{n_cells} cells would go to results/quickstart_probe"
    assert all(line.startswith('file {"file": "probe.exr"') for line in lines[:-1])


def test_a_run_under_another_light_writes_beside_the_study_s_own_results(call):
    write_exr("probe.exr", torch.ones(8, 16, 3))

    code, out, _ = call("run", "tiny.yaml", "--light", "probe.exr", "-f", "importance_sampling")

    assert code == 0
    assert out.splitlines()[-1] == "report: results/tiny_probe/report.html"
    assert Results("results/tiny_probe").study["light"][0]["file"]["file"] == "probe.exr"


def test_a_dry_run_names_the_cells_and_writes_nothing(call, here):
    before = everything(here)

    code, out, err = call("run", "tiny.yaml", "--dry-run", "-o", "x[1]")

    lines = out.splitlines()
    assert (code, err) == (0, "")
    assert len(lines) == 5
    assert all(line.startswith("gradient {") and " ggx {" in line for line in lines[:4])
    assert lines[-1] == "4 cells would go to x[1]"
    assert everything(here) == before


def test_an_interrupt_ends_with_130_and_one_line(call, monkeypatch):
    monkeypatch.setattr("glossbench.runner.compute_reference", lambda *a: (_ for _ in ()).throw(KeyboardInterrupt))

    code, _, err = call("run", "tiny.yaml")

    assert code == 130
    assert words(err) == "interrupted: cells that are done are kept, the same command goes on from there"


def test_an_interrupted_process_ends_with_130(here):
    code = "import os, signal, glossbench.runner as r\n" \
        "r.compute_reference = lambda *a: os.kill(os.getpid(), signal.SIGINT)\n" \
        "from glossbench.cli import main; main()"  # fmt: skip

    done = subprocess.run([sys.executable, "-c", code, "run", "tiny.yaml"], capture_output=True, text=True)

    assert done.returncode == 130
    assert words(done.stderr).startswith("interrupted: ")


# Errors


def image(name: str, content: bytes) -> str:
    Path(name).write_bytes(content)
    return name


def exr(value: float) -> str:
    picture = torch.ones(4, 8, 3)
    picture[1, 2, 0] = value
    write_exr("probe.exr", picture)
    return "probe.exr"


def truncated() -> str:
    content = Path(exr(2.0)).read_bytes()
    return image("probe.exr", content[: len(content) // 2])


HDR = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n"
PNG = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR"
WRONG_STUDIES = {
    "unknown key": (lambda: {"metric": ["rms"]}, "unknown key 'metric'; did you mean 'metrics'?"),
    "unknown method": (
        lambda: {"methods": "importance_samplin"},
        "unknown method 'importance_samplin'; did you mean 'importance_sampling'?",
    ),
    "wrong type": (
        lambda: {"methods": {"importance_sampling": {"samples": "many"}}},
        "samples must be a valid integer, got 'many'",
    ),
    "out of bounds": (
        lambda: {"methods": {"importance_sampling": {"samples": 0}}},
        "samples must be greater than or equal to 1, got 0",
    ),
    "no pixels": (lambda: {"view": {"sphere": {"resolution": 0}}}, "must be greater than or equal to 1"),
    "unknown device": (lambda: {"device": "tpu"}, "device must be 'cpu' or 'cuda', got 'tpu'"),
    "missing image": (lambda: {"light": "gone.hdr"}, "no image file 'gone.hdr'"),
    "truncated image": (lambda: {"light": truncated()}, "probe.exr: is truncated or damaged"),
    "PNG named .hdr": (lambda: {"light": image("p.hdr", PNG)}, "p.hdr: is not a Radiance HDR image"),
    "empty image": (lambda: {"light": image("p.hdr", b"")}, "p.hdr: is empty (0 bytes)"),
    "image of no pixels": (lambda: {"light": image("p.hdr", HDR + b"-Y 0 +X 0\n")}, "p.hdr: "),
    "NaN": (lambda: {"light": exr(float("nan"))}, "probe.exr: radiance must be finite, but 1 pixels are not"),
    "negative": (lambda: {"light": exr(-1.0)}, "probe.exr: radiance must be not negative, but 1 pixels"),
    "row outside the map": (
        lambda: {"light": {"texel": {"row": 16, "resolution": 16}}},
        "texel.row and texel.column must be below 16, got 16 and 8",
    ),
}  # fmt: skip


@pytest.mark.parametrize("fault", WRONG_STUDIES)
def test_a_wrong_study_is_one_line_and_nothing_is_written(call, here, fault):
    changes, message = WRONG_STUDIES[fault]
    study = written(**changes())
    before = everything(here)

    code, out, err = call("run", study)

    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert message in err
    assert err.count("\n") == 1
    assert err.endswith("\n")
    assert everything(here) == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "quikstart"], "error: unknown study 'quikstart'; did you mean 'quickstart'?"),
        (["run", "gone.yaml"], "error: cannot read the study 'gone.yaml': No such file or directory"),
        (["validate", "quikstart"], "error: unknown study 'quikstart'; did you mean 'quickstart'?"),
        (
            ["run", "tiny.yaml", "-o", "tiny.yaml"],
            "error: cannot write results to tiny.yaml: Not a directory",
        ),
        (
            ["run", "tiny.yaml", "-o", "tiny.yaml/below"],
            "error: cannot write results to tiny.yaml/below: Not a directory",
        ),
        (
            ["run", "tiny.yaml", "-f", "importance_samplin"],
            "error: the study has no method 'importance_samplin'; did you mean 'importance_sampling'?",
        ),
        (["run", "tiny.yaml", "--seed", "-1"], "error: seed must be at least 0, got -1"),
        (["run", "tiny.yaml", "--light", "gone.hdr"], "error: no image file 'gone.hdr'"),
        (["report", "."], "error: . holds no results: there is no cells.parquet in it"),
        (["report", "nowhere"], "error: nowhere holds no results: there is no cells.parquet in it"),
        (["info", "importance_samplin"], "error: nothing is called 'importance_samplin'; did you mean"),
    ],
)
def test_a_wrong_call_is_one_line_and_nothing_is_written(call, here, arguments, message):
    before = everything(here)

    code, out, err = call(*arguments)

    assert (code, out) == (2, "")
    assert err.startswith(message)
    assert err.count("\n") == 1
    assert everything(here) == before


def test_another_process_ends_with_2_and_one_line(here):
    study = written(light=image("p.hdr", PNG))
    before = everything(here)

    done = subprocess.run(process("run", study), capture_output=True, text=True)

    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert everything(here) == before


# Looking things up


def test_validate_counts_cells_and_claims(call, here):
    before = everything(here)

    assert call("validate", "tiny.yaml") == (0, "Tiny: 4 cells, 1 claims\n", "")
    assert everything(here) == before


@pytest.mark.parametrize("name", study_names())
def test_every_installed_study_is_valid(call, name):
    code, _, err = call("validate", name)

    # A study of files that are not here says which.
    assert code == 0 or "no image file" in err


def test_schema_prints_a_json_schema_of_every_key(call):
    code, out, err = call("schema")

    stated = json.loads(out)
    assert (code, err) == (0, "")
    assert stated["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert set(STUDY) <= set(stated["properties"])
    assert_is_schema(stated)


def assert_is_schema(stated: Any) -> None:
    """The rules of the draft for the keywords that are used; an unknown keyword is a fault, too."""
    texts = {"$schema", "$ref", "title", "description", "type"}
    numbers = {"minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum"}
    counts = {"minItems", "maxItems", "minLength", "minProperties", "maxProperties"}
    for key, value in stated.items():
        if key in texts:
            assert isinstance(value, str)
            known = {"object", "array", "string", "number", "integer", "boolean", "null"}
            assert key != "type" or value in known
        elif key in numbers:
            assert isinstance(value, int | float)
        elif key in counts:
            assert isinstance(value, int)
            assert value >= 0
        elif key in ("properties", "$defs"):
            for one in value.values():
                assert_is_schema(one)
        elif key in ("anyOf", "oneOf", "prefixItems"):
            assert value
            for one in value:
                assert_is_schema(one)
        elif key in ("items", "additionalProperties"):
            if not isinstance(value, bool):
                assert_is_schema(value)
        elif key == "required":
            assert len(set(value)) == len(value)
        elif key == "enum":
            assert isinstance(value, list)
        else:
            assert key in ("default", "const"), key


@pytest.mark.parametrize("fault", [{"type": "text"}, {"minItems": -1}, {"anyOf": []}, {"propertys": {}}])
def test_a_wrong_schema_would_be_noticed(fault):
    """Twin of the above."""
    with pytest.raises(AssertionError):
        assert_is_schema({"properties": {"a": fault}})


def test_info_lists_every_name(call):
    code, out, _ = call("info")

    assert code == 0
    for registry in cli._registries().values():
        assert all(name in words(out).replace(",", "").split() for name in registry.names())
    assert all(name in words(out) for name in study_names())


@pytest.mark.parametrize("kind", cli._registries())
def test_info_prints_docstring_and_options_of_every_name(call, kind):
    registry = cli._registries()[kind]

    for name in registry.names():
        code, out, err = call("info", name)

        cls = registry.get(name)
        assert (code, err) == (0, "")
        assert cls.__doc__, f"{kind} {name} has no docstring"
        assert words(cleandoc(cls.__doc__)) in words(out)
        rows = {line.split()[0] for line in out.splitlines() if line.strip()}
        assert set(option_names(cls)) <= rows


def test_sys_info_names_versions_and_the_machine(call):
    code, out, _ = call("sys-info")

    said = dict(line.split(": ", 1) for line in out.splitlines())
    assert code == 0
    assert said["torch"] == torch.__version__
    assert {"glossbench", "python", "numpy", "platform", "processor", "cores", "cuda"} <= set(said)


def test_report_writes_the_report_again(call):
    call("run", "tiny.yaml", "-f", "importance_sampling")
    Path("results/tiny/report.html").unlink()

    code, out, _ = call("report", "results/tiny")

    assert (code, out) == (0, "report: results/tiny/report.html\n")
    assert Path("results/tiny/report.html").is_file()
