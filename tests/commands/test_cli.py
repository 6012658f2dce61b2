"""The command line: what it prints, what it writes, and that an error is one line with exit code 2."""

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from importlib.metadata import version as system_version
from inspect import cleandoc
from pathlib import Path
from typing import Any, NamedTuple

import pandas
import pytest
import torch
import yaml
from matplotlib.image import imread

from glossbench.catalog import entries as catalog
from glossbench.catalog.entries import Entry, entries
from glossbench.commands import cli, completion, printing
from glossbench.commands import run as run_command
from glossbench.commands.info import registries
from glossbench.commands.info import values as words_of_schema
from glossbench.commands.picture import half_blocks, tone_mapped
from glossbench.envmap.formats.files import read_image, write_exr
from glossbench.envmap.lights.light import light_named
from glossbench.options import option_names
from glossbench.run.results import Results
from glossbench.run.runner import Progress, run_study
from glossbench.study.installed import study_files
from glossbench.study.study import load_study

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

# Of the mean of a light written and read again. Measured 2.6e-4 as an angular map, 4e-8 or less as all else; an
# octahedral one that is read as an angular one is 0.5 off.
ENERGY = 1e-3


class Called(NamedTuple):
    code: int
    out: str
    err: str


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """The current folder holds one small study."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("GLOSSBENCH_DATA", raising=False)
    monkeypatch.setattr(catalog, "cache_folder", lambda: tmp_path / "no cache")
    Path("tiny.yaml").write_text(yaml.safe_dump(STUDY))
    return tmp_path


@pytest.fixture
def call(monkeypatch, capsys):
    """Calls the command line in this process; that the machine is busy is not said."""
    monkeypatch.setattr(printing, "BUSY", float("inf"))

    def called(*arguments: Any) -> Called:
        monkeypatch.setattr(sys, "argv", ["glossbench", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as stopped:
            cli.main()
        code = stopped.value.code
        return Called(code if isinstance(code, int) else int(code is not None), *capsys.readouterr())

    return called


@pytest.mark.usefixtures("without_reports")
def test_a_run_says_what_of_a_mesh_was_repaired(call):
    corners = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\n"
    Path("quad.obj").write_text(corners + "f 1 2 3\nf 1 3 4\nf 1 1 2\n")
    study = STUDY | {"view": {"mesh": {"shape": "quad.obj", "resolution": 4, "azimuth": 0, "elevation": 0}}}
    Path("quad.yaml").write_text(yaml.safe_dump(study))

    called = call("run", "quad.yaml")

    assert called.err.count("note: mesh quad.obj: left out 1 of 3 faces, which have no area") == 1


@pytest.fixture
def without_reports(monkeypatch):
    """Reports take most of the time of a small run, and no one looks at them here."""
    monkeypatch.setattr(run_command, "_report_writers", lambda: {"html": lambda folder: folder / "report.html"})


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Results of one method of the small study, without reports."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "tiny.yaml").write_text(yaml.safe_dump(STUDY))
    return run_study(load_study(folder / "tiny.yaml").only(["importance_sampling"]), folder / "results").folder


@pytest.fixture
def results(made, here):
    """A folder of results of one's own."""
    return shutil.copytree(made, here / "results" / "tiny")


def written(**changes: Any) -> str:
    Path("other.yaml").write_text(yaml.safe_dump(STUDY | changes))
    return "other.yaml"


def process(*arguments: str) -> list[str]:
    return [sys.executable, "-c", "from glossbench.commands.cli import main; main()", *arguments]


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


def test_the_table_names_the_options_that_tell_cells_apart(call):
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


def test_a_log_gets_a_line_of_progress_now_and_then(call, monkeypatch):
    monkeypatch.setattr(printing, "PULSE", 0.0)

    err = call("run", "tiny.yaml", "--no-cache").err

    assert "0 of 4 cells, " in err
    assert "3 of 4 cells, " in err


def test_another_process_prints_the_same_kind_of_end(here):
    done = subprocess.run(process("run", "tiny.yaml", "-o", "elsewhere"), capture_output=True, text=True)

    said = [line for line in done.stderr.splitlines() if "were timed while" not in line]  # the machine may be busy
    assert (done.returncode, said) == (0, [])
    assert done.stdout.splitlines()[-2] == "report: elsewhere/report.html"
    assert (here / "elsewhere" / "cells.parquet").is_file()


@pytest.mark.usefixtures("without_reports")
def test_a_folder_whose_name_looks_like_markup_is_printed_as_it_is(call):
    out = call("run", "tiny.yaml", "-f", "importance_sampling", "-o", "a[bold]b").out

    assert out.splitlines()[-1] == "report: a[bold]b/report.html"


@pytest.mark.usefixtures("without_reports")
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


@pytest.mark.usefixtures("without_reports")
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


@pytest.mark.usefixtures("without_reports")
def test_only_the_named_methods_run_and_the_study_on_disk_says_so(call):
    assert call("run", "tiny.yaml", "-f", "environment_sampling").code == 0

    assert set(Results("results/tiny").cells["method"]) == {"environment_sampling"}
    again = load_study("results/tiny/study.yaml")
    assert {item.name for item in again.methods} == {"environment_sampling"}
    assert again.claims == ()


@pytest.mark.usefixtures("without_reports")
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
    assert lines[-1] == f"{n_cells} cells would go to results/quickstart_probe: {n_cells} new"
    assert all(line.startswith("new  probe.exr  ") for line in lines[:-1])


@pytest.mark.usefixtures("without_reports")
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
    assert lines == [
        "new  gradient  ggx  importance_sampling (samples 4)",
        "new  gradient  ggx  importance_sampling (samples 8)",
        "new  gradient  ggx  environment_sampling (samples 4)",
        "new  gradient  ggx  environment_sampling (samples 8)",
        "4 cells would go to x[1]: 4 new",
    ]
    assert everything(here) == before


def test_a_dry_run_says_which_cells_are_done_and_which_have_failed(call, results):
    kept = Results(results)
    kept.add_cell(kept.cell(kept.cells["key"][0]) | {"status": "failed"}, None, None)

    lines = call("run", "tiny.yaml", "--dry-run").out.splitlines()

    assert [line.split()[0] for line in lines[:4]] == ["failed", "done", "new", "new"]
    assert lines[4] == "4 cells would go to results/tiny: 1 done, 1 failed, 2 new"
    assert lines[5] == "failed cells stay as they are; --rerun-failed tries them again"


def test_an_interrupt_ends_with_130_and_one_line(call, monkeypatch):
    monkeypatch.setattr(
        "glossbench.run.executor.compute_reference", lambda *a: (_ for _ in ()).throw(KeyboardInterrupt)
    )

    code, _, err = call("run", "tiny.yaml")

    assert code == 130
    assert words(err) == "interrupted: cells that are done are kept, the same command goes on from there"


def test_an_interrupted_process_ends_with_130(here):
    code = "import os, signal, time, glossbench.run.executor as r\n" \
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n" \
        "r.compute_reference = lambda *a: (os.kill(os.getpid(), signal.SIGINT), time.sleep(60))\n" \
        "from glossbench.commands.cli import main; main()"  # fmt: skip

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
        (["run", "tiny.yaml", "--light", "spot"], "error: unknown light 'spot'; the catalogue has a mesh of this name"),
        (
            ["run", "tiny.yaml", "--light", "grace_cros"],
            "error: unknown light 'grace_cros'; did you mean 'grace_cross'",
        ),
        (["light", "gone.hdr"], "error: no image file 'gone.hdr'"),
        (["light", "teapot"], "error: unknown light 'teapot'; the catalogue has a mesh of this name"),
        (["light", "constant", "--projection", "angular"], "error: constant: unknown option 'projection'"),
        (["light", "constant", "--as", "cross"], "error: --as and --as-axes say how a file is written: name it by -o"),
        (["data", "fetch"], "error: data fetch needs a name of `glossbench data list`, --all or --kind"),
        (["data", "fetch", "teapot", "--all"], "error: data fetch takes names, or --all, or --kind, not both"),
        (["data", "fetch", "teapo"], "error: the catalogue has no 'teapo'; did you mean 'teapot'?"),
        (["data", "list", "--kind", "meshes"], "error: unknown kind 'meshes'; did you mean 'mesh'?"),
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


# Looking things up


VALIDATED = """\
Tiny: 1 light, 1 material, 1 view, 4 cells, 1 claim
light     gradient: resolution 16
material  ggx: alpha 0.5 (isotropic)
view      sphere: resolution 8
methods   importance_sampling: samples 4, 8 -> 2 methods
          environment_sampling: samples 4, 8 -> 2 methods
metrics   rms, relative_rms, mean_error, max_error
device    cpu
claims    2 pairs: A [b] /c

"""


def test_validate_says_what_a_study_makes_and_writes_nothing(call, here):
    before = everything(here)

    assert call("validate", "tiny.yaml") == (0, VALIDATED, "")
    assert everything(here) == before


@pytest.mark.parametrize("name", study_files())
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
    texts = {"$schema", "$ref", "title", "description", "pattern"}
    types = {"object", "array", "string", "number", "integer", "boolean", "null"}
    numbers = {"minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum"}
    counts = {"minItems", "maxItems", "minLength", "minProperties", "maxProperties"}
    for key, value in stated.items():
        if key in texts:
            assert isinstance(value, str)
        elif key == "type":  # one, or several that are all allowed
            named = value if isinstance(value, list) else [value]
            assert named
            assert len(set(named)) == len(named)
            assert set(named) <= types
        elif key in numbers:
            assert isinstance(value, int | float)
        elif key in counts:
            assert isinstance(value, int)
            assert value >= 0
        elif key in ("properties", "patternProperties", "$defs"):
            for one in value.values():
                assert_is_schema(one)
        elif key in ("anyOf", "oneOf", "prefixItems"):
            assert value
            for one in value:
                assert_is_schema(one)
        elif key in ("items", "additionalProperties", "propertyNames"):
            if not isinstance(value, bool):
                assert_is_schema(value)
        elif key == "required":
            assert len(set(value)) == len(value)
        elif key == "enum":
            assert isinstance(value, list)
        else:
            assert key in ("default", "const"), key


@pytest.mark.parametrize(
    "fault", [{"type": "text"}, {"type": ["object", "text"]}, {"minItems": -1}, {"anyOf": []}, {"propertys": {}}]
)
def test_a_wrong_schema_would_be_noticed(fault):
    """Twin of the above."""
    with pytest.raises(AssertionError):
        assert_is_schema({"properties": {"a": fault}})


def test_info_lists_every_name(call):
    code, out, _ = call("info")

    assert code == 0
    for registry in registries().values():
        assert all(name in words(out).replace(",", "").split() for name in registry.names())
    assert all(name in words(out) for name in study_files())
    lines = [line for line in out.splitlines() if line]
    assert {line[:13].strip() for line in lines} == {"", *registries(), "study", "public file"}  # names stand apart


@pytest.mark.parametrize("kind", registries())
def test_info_prints_docstring_and_options_of_every_name(call, kind):
    registry = registries()[kind]

    for name in registry.names():
        code, out, err = call("info", name)

        cls = registry.get(name)
        assert (code, err) == (0, "")
        assert cls.__doc__, f"{kind} {name} has no docstring"
        assert words(cleandoc(cls.__doc__)) in words(out)
        rows = {line.split()[0] for line in out.splitlines() if line.strip()}
        assert set(option_names(cls)) <= rows


def test_info_of_a_study_says_what_it_asks_and_claims(call):
    code, out, err = call("info", "quickstart")

    stated = yaml.safe_load(study_files()["quickstart"].read_text())
    assert (code, err) == (0, "")
    assert all(words(text) in words(out) for text in (stated["title"], stated["question"], stated["source"]))
    assert all(claim["text"] in out for claim in stated["claims"])


def test_info_of_a_public_file_says_all_that_the_catalogue_does(call):
    for stated in entries():
        code, out, err = call("info", stated.name)

        assert (code, err) == (0, "")
        for value in (stated.url, stated.licence, stated.sha256, str(stated.bytes), stated.stresses):
            assert value in out
        assert f"no; glossbench data fetch {stated.name}" in out


def test_info_of_a_name_of_two_kinds_shows_both(call):
    out = call("info", "grace_cross").out

    assert "grace_cross (light)" in out
    assert "grace_cross (environment, public file)" in out


def test_info_of_a_metric_says_its_formula_and_unit(call):
    out = words(call("info", "rms").out)

    assert "formula sqrt(mean((x - y)^2))" in out
    assert "unit radiance" in out
    assert "lower is better yes" in out


@pytest.mark.parametrize(
    ("rule", "said"),
    [
        ({"type": "integer", "minimum": 1, "maximum": 1048576}, "integer >= 1, <= 1048576"),
        ({"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1}, "number > 0, < 1"),
        ({"anyOf": [{"enum": ["a", "b"]}, {"type": "null"}]}, "a, b or none"),
        ({"const": "a"}, "a"),
        ({"prefixItems": [{"type": "number"}, {"type": "number"}]}, "2 x number"),
        ({"type": "array", "items": {"type": "boolean"}}, "list of boolean"),
        ({}, "any"),
    ],
)
def test_bounds_are_said_in_full(rule, said):
    assert words_of_schema(rule) == said


def test_version(call):
    assert call("--version") == (0, f"glossbench {system_version('glossbench')}\n", "")


@pytest.mark.parametrize(
    "command",
    ["run", "report", "figure", "validate", "schema", "info", "light", "data", "data list", "data fetch",
     "check-method", "bench", "sys-info"],
)  # fmt: skip
def test_every_command_explains_itself(call, command):
    code, out, err = call(*command.split(), "--help")

    assert (code, err) == (0, "")
    assert "Usage: " in out
    assert out.count("\n") > 5


# Lights


def test_light_says_what_it_understood(call):
    write_exr("probe.exr", torch.full((8, 16, 3), 2.0))

    code, out, err = call("light", "probe.exr")

    # A constant light: mean and peak are its radiance, irradiance pi times as much.
    said = {line[:19].strip(): words(line[19:]) for line in out.splitlines()}
    assert (code, err) == (0, "")
    assert said["read as"] == "lat_long, 16 x 8 pixels"
    assert said["cube map"] == "6 faces of 4 x 4 texels"
    assert said["mean radiance"] == "2 2 2"
    assert said["peak luminance"] == "2, of a pixel 2"
    assert said["dynamic range"] == "1 : 1"
    assert said["brightest 0.1 %"] == "0.1 % of the energy"
    for side in ("up", "right", "forward"):
        # Measured 6.418 for 2 pi = 6.283, 2.1 %: the midpoint rule of sixteen texels a face.
        assert [float(c) for c in said[f"irradiance {side}"].split()] == pytest.approx([6.2832] * 3, rel=0.03)


def test_light_takes_the_name_of_an_embedded_light(call):
    code, out, err = call("light", "constant", "--resolution", 8)

    assert (code, err) == (0, "")
    assert "6 faces of 8 x 8 texels" in out
    assert "read as" not in out


def test_light_takes_the_options_of_a_file(call):
    image = torch.zeros(8, 16, 3)
    image[:2] = 1.0
    write_exr("probe.exr", image)

    upright, flipped = (call("light", "probe.exr", "--resolution", 4, *flag).out for flag in ([], ["--flip"]))

    up = [float(next(line for line in out.splitlines() if line.startswith("irradiance up")).split()[2])
          for out in (upright, flipped)]  # fmt: skip
    assert up[0] > 1
    assert up[1] == 0


@pytest.mark.parametrize(
    ("projection", "shape"),
    [
        ("cross", (64, 48)), ("vertical_cross", (64, 48)), ("horizontal_cross", (48, 64)), ("lat_long", (32, 64)),
        ("angular", (64, 64)), ("strip", (16, 96)), ("dual_paraboloid", (32, 64)), ("octahedral", (32, 32)),
        ("octahedral_equal_area", (32, 32)),
    ],
)  # fmt: skip
def test_a_light_is_written_in_another_projection_with_its_energy(call, projection, shape):
    code, out, err = call("light", "gradient", "--resolution", 16, "-o", "out.exr", "--as", projection)

    full = {"cross": "vertical_cross"}.get(projection, projection)
    assert (code, err) == (0, "")
    assert out.splitlines()[-1] == f"{full}: out.exr"
    assert tuple(read_image("out.exr").shape[:2]) == shape
    again = light_named("out.exr", {"projection": full, "resolution": 16}).cubemap()
    # The mean of 1 + d_c over 2 is 1 / 2 in each channel.
    assert again.mean().tolist() == pytest.approx([0.5] * 3, rel=ENERGY)


def test_a_light_read_as_another_projection_would_be_noticed(call):
    """Twin of the above."""
    call("light", "gradient", "--resolution", 16, "-o", "out.exr", "--as", "octahedral")

    again = light_named("out.exr", {"projection": "angular", "resolution": 16}).cubemap()

    assert again.mean().tolist() != pytest.approx([0.5] * 3, rel=ENERGY)


def test_a_written_light_is_read_by_what_it_says_of_itself(call):
    call("light", "gradient", "--resolution", 16, "-o", "out.exr", "--as", "octahedral")

    code, out, _ = call("light", "out.exr")

    said = {line[:19].strip(): words(line[19:]) for line in out.splitlines()}
    assert (code, said["read as"]) == (0, "octahedral, 32 x 32 pixels")
    assert [float(c) for c in said["mean radiance"].split()] == pytest.approx([0.5] * 3, rel=ENERGY)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["-o", "out.png"], "out.png: the extension must be .exr, got '.png'"),
        (["-o", "gone/out.exr"], "gone/out.exr: cannot be written: No such file or directory"),
        (["-o", "folder.exr"], "folder.exr: must be a file to write, is a folder"),
        (["-o", "out.exr", "--as", "octahedron"], "unknown projection 'octahedron'; did you mean 'octahedral'?"),
        (["-o", "out.exr", "--as-axes", "pbrt", "--as", "strip"], "axes 'pbrt' say nothing of the projection strip"),
    ],
)  # fmt: skip
def test_a_light_that_cannot_be_written_is_refused_before_it_is_made(call, monkeypatch, options, message):
    Path("folder.exr").mkdir()
    monkeypatch.setattr("glossbench.envmap.lights.light.light_named", lambda *_: pytest.fail("the light was made"))

    code, _, err = call("light", "gradient", *options)

    assert (code, err.count("\n")) == (2, 1)
    assert err.startswith(f"error: {message}")
    assert not Path("out.exr").exists()


def test_light_takes_the_layer_that_is_named_and_says_what_it_chose(call):
    names = [f"{layer}.{c}" for layer in ("AO", "Combined") for c in "RGB"]
    write_exr("probe.exr", torch.tensor([1.0, 1, 1, 2, 2, 2]).expand(8, 16, 6), names)

    of_itself, named = call("light", "probe.exr"), call("light", "probe.exr", "--layer", "AO")

    mean = [
        next(line for line in run.out.splitlines() if line.startswith("mean")).split()[2] for run in (of_itself, named)
    ]
    assert mean == ["2", "1"]
    assert "probe.exr: the layer Combined is read, of AO, Combined" in of_itself.out
    assert "is read" not in named.out


def test_a_picture_is_written_whole_or_not_at_all(call):
    before = {"tiny.yaml"}

    written = call("light", "gradient", "--png", "a.png")
    refused = call("light", "gradient", "--png", "a.jpg")
    homeless = call("light", "gradient", "--png", "gone/a.png")

    assert (written.code, written.out.splitlines()[-1]) == (0, "picture: a.png")
    assert refused.code == homeless.code == 2
    assert refused.err == "error: a.jpg: the extension must be .png, got '.jpg'\n"
    assert homeless.err == "error: gone/a.png: cannot be written: No such file or directory\n"
    assert {path.name for path in Path().iterdir()} == before | {"a.png"}


def test_a_picture_shows_up_above_and_right_on_the_right(call):
    call("light", "orientation", "--png", "a.png")

    picture = imread("a.png")[..., :3]
    # Colours of the faces (ORIENTATION_COLORS): at the top +y green, at the bottom -y magenta; along the horizon -z
    # yellow in the centre, +x red at three quarters, -x cyan at one quarter, +z blue at the edges.
    places = [(10, 512), (501, 512), (256, 512), (256, 768), (256, 256), (256, 10)]
    lit = [tuple(bool(c > 0.2) for c in picture[row, column]) for row, column in places]
    wanted = [(0, 1, 0), (1, 0, 1), (1, 1, 0), (1, 0, 0), (0, 1, 1), (0, 0, 1)]
    assert lit == [tuple(bool(c) for c in color) for color in wanted]


def test_a_tone_mapped_grey_of_the_geometric_mean_is_the_published_one():
    pixels = tone_mapped(torch.full((2, 2, 3), 7.0))

    # Reinhard et al. 2002: x = 0.18, x / (1 + x) = 0.15254; sRGB of it, 1.055 * 0.15254^(1 / 2.4) - 0.055 = 0.4275.
    assert pixels.unique().tolist() == [round(255 * 0.4275)]


def test_a_black_light_is_a_black_picture():
    assert tone_mapped(torch.zeros(2, 2, 3)).unique().tolist() == [0]


def test_half_blocks_show_two_pixels_a_character():
    pixels = torch.tensor([[[255, 0, 0], [1, 2, 3]], [[0, 255, 0], [4, 5, 6]], [[9, 9, 9], [9, 9, 9]]])

    drawn = half_blocks(pixels.to(torch.uint8))

    # The third row has none below it.
    assert drawn.plain == "▀▀\n"
    assert [str(span.style) for span in drawn.spans] == [
        "rgb(255,0,0) on rgb(0,255,0)", "rgb(1,2,3) on rgb(4,5,6)",
    ]  # fmt: skip


def test_a_terminal_is_drawn_on_and_a_pipe_is_not(call):
    environment = {**os.environ, "FORCE_COLOR": "1", "COLORTERM": "truecolor", "COLUMNS": "40"}

    terminal = subprocess.run(process("light", "gradient"), capture_output=True, text=True, env=environment)
    pipe = call("light", "gradient")

    assert (terminal.returncode, terminal.stderr) == (pipe.code, pipe.err) == (0, "")
    assert "▀" not in pipe.out
    assert terminal.stdout.count("▀") == 40 * 10
    assert "\x1b[38;2;" in terminal.stdout


def test_a_run_takes_the_name_of_a_light(call):
    code, out, err = call("run", "tiny.yaml", "--light", "constant", "--dry-run")

    assert (code, err) == (0, "")
    assert all(line.startswith("new  constant  ") for line in out.splitlines()[:-1])
    assert out.splitlines()[-1] == "4 cells would go to results/tiny_constant: 4 new"


def test_a_run_takes_a_name_of_the_catalogue_and_fetches_nothing_before_it_starts(call, here):
    code, out, err = call("run", "tiny.yaml", "--light", "grace_cross", "--dry-run")

    assert (code, err) == (0, "")
    assert out.splitlines()[-1] == "4 cells would go to results/tiny_grace_cross: 4 new"
    assert not (here / "no cache").exists()


# Public files


def test_data_list_says_what_is_here(call, here, monkeypatch):
    content = b"v 0 0 0\n"
    stated = Entry("dot", "mesh", "dot.obj", "http://127.0.0.1:9/dot.obj", hashlib.sha256(content).hexdigest(),
                   len(content), "CC0", "one point")  # fmt: skip
    gone = Entry("gone", "mesh", "gone.obj", "http://127.0.0.1:9/gone.obj", "0" * 64, 2_400_000, "CC0", "no point")
    monkeypatch.setattr("glossbench.commands.data.entries", lambda kind=None: [stated, gone])
    monkeypatch.setenv("GLOSSBENCH_DATA", str(here))
    (here / "dot.obj").write_bytes(content)

    table, listed = call("data", "list"), call("data", "list", "--json")

    lines = [words(line) for line in table.out.splitlines()]
    assert lines[1:3] == ["dot mesh 0.00 yes one point", "gone mesh 2.40 no no point"]
    assert f"here: {here}" in lines
    assert [one["local"] for one in json.loads(listed.out)] == [str(here / "dot.obj"), None]
    assert json.loads(listed.out)[0]["licence"] == "CC0"


def test_data_fetch_prints_where_each_file_is(call, monkeypatch):
    asked = []
    monkeypatch.setattr("glossbench.commands.data.fetch", lambda name, progress: asked.append(name) or Path(name))

    named = call("data", "fetch", "teapot", "spot", "teapot")
    of_a_kind = call("data", "fetch", "--kind", "mesh")
    everything_there_is = call("data", "fetch", "--all")

    assert named.out == "teapot\nspot\n"
    assert set(of_a_kind.out.split()) == {e.name for e in entries("mesh")}
    assert everything_there_is.out.split() == [e.name for e in entries()]
    assert len(asked) == 2 + len(entries("mesh")) + len(entries())


def test_data_fetch_without_a_network_is_one_line(call, monkeypatch):
    unreachable = replace(catalog.entry("teapot"), url="http://127.0.0.1:9/teapot.obj")
    monkeypatch.setattr(catalog, "entries", lambda kind=None: [unreachable])
    monkeypatch.setattr("glossbench.commands.data.entry", lambda name: unreachable)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")

    code, out, err = call("data", "fetch", "teapot")

    assert (code, out) == (2, "")
    told, error = err.splitlines()
    assert told == "teapot.obj is not here: fetching 0.2 MB from 127.0.0.1:9"
    assert error.startswith("error: cannot reach 127.0.0.1:9: Connection refused; the file may be put into ")


# The Tab key


OFFERED = {
    "glossbench run qui": ["quickstart"],
    "glossbench validate qui": ["quickstart"],
    "glossbench run quickstart --light grace_l": ["grace_latlong"],
    "glossbench run quickstart --light spo": ["spots"],
    "glossbench run quickstart -f regular": ["regular_sampling"],
    "glossbench check-method env": ["environment_sampling"],
    "glossbench info quick": ["quickstart"],
    "glossbench info kur": ["kurt"],
    "glossbench data fetch teap": ["teapot"],
    "glossbench figure results conv": ["convergence"],
    "glossbench light orient": ["orientation"],
    "glossbench vali": ["validate"],
    "glossbench run ./my": [],
}
COMPLETE = """
import contextlib, io, json, os, sys
from glossbench.commands.cli import main
sys.argv[0] = "glossbench"
said = []
for variables in json.loads(sys.stdin.read()):
    os.environ.update(variables)
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.suppress(SystemExit):
        main()
    said.append(out.getvalue())
print(json.dumps([said, "torch" in sys.modules]))
"""


@pytest.fixture(scope="module")
def completed():
    """What another process offers after lines, by line and shell, and whether it has imported torch."""
    asked = {(line, "bash"): {"COMP_WORDS": line, "COMP_CWORD": str(len(line.split(" ")) - 1)} for line in OFFERED}
    asked["glossbench run qui", "zsh"] = {"_TYPER_COMPLETE_ARGS": "glossbench run qui"}
    asked["glossbench run qui", "fish"] = asked["glossbench run qui", "zsh"] | {
        "_TYPER_COMPLETE_FISH_ACTION": "get-args"
    }
    variables = [given | {"_GLOSSBENCH_COMPLETE": f"complete_{shell}"} for (_, shell), given in asked.items()]
    command = [sys.executable, "-c", COMPLETE]
    done = subprocess.run(command, input=json.dumps(variables), capture_output=True, text=True, check=True)
    said, has_torch = json.loads(done.stdout)
    return dict(zip(asked, said, strict=True)), has_torch


@pytest.mark.parametrize("line", OFFERED)
def test_the_tab_key_offers_names_without_importing_torch(completed, line):
    said, has_torch = completed

    assert said[line, "bash"].split() == OFFERED[line]
    assert not has_torch


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_are_offered_the_same(completed, shell):
    said, _ = completed

    assert "quickstart" in said["glossbench run qui", shell]


def test_completion_can_be_shown_for_installation(call):
    assert "--install-completion" in call("--help").out


@pytest.mark.parametrize("kind", registries())
def test_names_read_from_sources_are_those_that_are_registered(kind):
    named_by_the_catalogue = {e.name for kind in ("environment", "brdf") for e in entries(kind)}

    assert set(completion.registered(kind)) == set(registries()[kind].names()) - named_by_the_catalogue


def test_results_are_offered_as_folders():
    Path("results/tiny").mkdir(parents=True)
    Path("results/tiny/cells.parquet").touch()
    Path("results/other").mkdir()

    assert completion.results("results/t") == ["results/tiny"]
    assert completion.results("") == ["results/tiny"]


def test_importing_glossbench_imports_torch_only_when_a_name_is_asked_for():
    code = "import sys, glossbench as gb\nprint('torch' in sys.modules)\nsys.modules['torch'] = None\n" \
        "try: gb.Method\nexcept ModuleNotFoundError as error: print(error.name)"  # fmt: skip

    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)

    assert (done.stdout, done.stderr) == ("False\ntorch\n", "")


def test_every_public_name_can_be_imported():
    import glossbench

    assert all(getattr(glossbench, name) is not None for name in glossbench.__all__)
    assert set(glossbench.__all__) <= set(dir(glossbench))
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        glossbench.nothing  # noqa: B018


# The machine, and old results


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
    ("flags", "names"), [([], "html pdf"), (["--pdf"], "pdf"), (["--html"], "html"), (["--pdf", "--html"], "html pdf")]
)
def test_report_writes_those_that_are_asked_for(call, monkeypatch, flags, names):
    written = []
    writers = {name: lambda folder, name=name: written.append(name) or folder / name for name in ("html", "pdf")}
    monkeypatch.setattr(run_command, "_report_writers", lambda: writers)

    code, out, _ = call("report", "results/tiny", *flags)

    assert (code, out) == (0, "".join(f"report: results/tiny/{name}\n" for name in written))
    assert written == names.split()


@pytest.mark.parametrize("changes", [["-f", "environment_sampling"], ["-f", "importance_sampling", "--seed", "3"]])
def test_a_run_does_not_write_over_results_of_another(call, results, changes):
    before = everything(results)

    code, out, err = call("run", "tiny.yaml", *changes)

    assert (code, out) == (2, "")
    assert err.startswith("error: results/tiny holds results that this run does not have, and that would be lost: ")
    assert everything(results) == before


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
        "answer", "convergence", "costs", "crops", "images", "profile"
    ]  # fmt: skip
    assert (code, out) == (0, "figure: c.svg\n")
    assert Path("c.svg").read_text().startswith("<svg")
    assert by_default == "figure: results/tiny/answer.pdf\n"
    assert Path("results/tiny/answer.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["crop"], "error: no figure is called 'crop'; did you mean 'crops'?"),
        (["costs", "--crop", "1,2,3,4"], "error: the figure costs takes no --crop"),
        (["crops", "--crop", "1,2,3"], "error: --crop must be four whole numbers X,Y,WIDTH,HEIGHT, got '1,2,3'"),
        (["crops", "--group", "2"], "error: --group must be one of 1: "),
        (["convergence", "--over", "k"], "error: results/tiny sweeps no 'k': --over must be one of "),
        (["crops", "-o", "a.gif"], "error: a.gif: the extension must be .pdf, .svg or .png, got '.gif'"),
    ],
)
@pytest.mark.usefixtures("results")
def test_a_wrong_call_of_figure_is_one_line(call, arguments, message):
    code, out, err = call("figure", "results/tiny", *arguments)

    assert (code, out) == (2, "")
    assert err.startswith(message)
    assert err.count("\n") == 1


# What a run says before and while its reports are written


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
        r"error: the broken report was not written: RuntimeError: planted \[/fault\] \(test_cli.py:\d+\)", line
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


@pytest.mark.parametrize("name", ["regular_sampling", "importance_sampling"])
def test_info_has_the_formula_in_plain_letters_and_not_in_the_notation_of_print(call, name):
    out = call("info", name).out

    assert "Lo ~ (1/N) sum of" in out
    assert "approx" not in out
    assert "sum_(i=1)" not in out
