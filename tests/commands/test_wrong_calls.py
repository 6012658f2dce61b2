"""Wrong studies and wrong calls: one line, exit code 2, nothing written."""

from pathlib import Path

import pytest
import torch

from glossbench.envmap.formats.files import write_exr
from oracles.command_line import files_under, written

pytestmark = pytest.mark.usefixtures("here")


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
    before = files_under(here)

    code, out, err = call("run", study)

    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert message in err
    assert err.count("\n") == 1
    assert err.endswith("\n")
    assert files_under(here) == before


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
            ["run", "tiny.yaml", "-m", "importance_samplin"],
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
        (["light", "constant", "--as", "cross"], "error: --as and --as-axes need -o, the file to write"),
        (["data", "fetch"], "error: data fetch needs a name of `glossbench data list`, --all or --kind"),
        (["data", "fetch", "teapot", "--all"], "error: data fetch takes names, or --all, or --kind, not both"),
        (["data", "fetch", "teapo"], "error: the catalogue has no 'teapo'; did you mean 'teapot'?"),
        (["data", "list", "--kind", "meshes"], "error: unknown kind 'meshes'; did you mean 'mesh'?"),
        (["report", "."], "error: . holds no results: cells.parquet is missing"),
        (["report", "nowhere"], "error: nowhere holds no results: cells.parquet is missing"),
        (["info", "importance_samplin"], "error: nothing is called 'importance_samplin'; did you mean"),
    ],
)
def test_a_wrong_call_is_one_line_and_nothing_is_written(call, here, arguments, message):
    before = files_under(here)

    code, out, err = call(*arguments)

    assert (code, out) == (2, "")
    assert err.startswith(message)
    assert err.count("\n") == 1
    assert files_under(here) == before
