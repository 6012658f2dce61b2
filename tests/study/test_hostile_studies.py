"""Broken studies through the command line: one line that says what and where, exit code 2, nothing written."""

import os
import sys
import time
import tracemalloc
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from glossbench.commands import cli
from glossbench.errors import InputError
from glossbench.study.study import load_study
from oracles.forks import ran


class Called(NamedTuple):
    code: Any
    out: str
    err: str


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """An empty current folder, and no folder of data."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("GLOSSBENCH_DATA", raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


@pytest.fixture
def call(monkeypatch, capfd):
    """Calls the command line in this process."""

    def called(*arguments: str) -> Called:
        monkeypatch.setattr(sys, "argv", ["glossbench", *arguments])
        capfd.readouterr()
        with pytest.raises(SystemExit) as stopped:
            cli.main()
        return Called(stopped.value.code, *capfd.readouterr())

    return called


def everything() -> dict[str, bytes]:
    return {str(path): path.read_bytes() if path.is_file() else b"" for path in Path().rglob("*")
            if "__pycache__" not in path.parts}  # fmt: skip


def a_study(**changes: str) -> str:
    """A study in flow style, a key a line: title, light, material, view, methods, then what is added."""
    keys = {
        "title": "T",
        "light": "{constant: {resolution: 8}}",
        "material": "{ggx: {alpha: 0.5}}",
        "view": "{sphere: {resolution: 4}}",
        "methods": "{importance_sampling: {samples: [4, 8]}}",
    } | changes
    return "".join(f"{key}: {value}\n" for key, value in keys.items())


def a_claim(rest: str, **changes: str) -> str:
    return a_study(**changes, claims=f"[{{text: A, value: importance_sampling, of: rms, between: [0, 1], {rest}}}]")


def bomb() -> str:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 12)]
    return "".join(lines)


def plugin(name: str, code: str) -> str:
    Path(f"{name}.py").write_text(code)
    return a_study(plugins=f"[{name}]")


MANY = f"[{', '.join(map(str, range(1, 1001)))}]"
SAMPLES = "methods.importance_sampling.samples"
# Name -> the file, or what makes it; the place that the line names; what else it says.
BROKEN: dict[str, tuple[Any, str, list[str]]] = {
    # Bytes and syntax
    "nothing in it": (b"", "1:1", ["the file is empty"]),
    "spaces only": (b" \n\n  \n", "1:1", ["the file is empty"]),
    "a null document": (b"null\n", "1:1", ["the top must be a mapping"]),
    "a list at the top": (b"- title: T\n", "1:1", ["the top must be a mapping", "a list"]),
    "two documents": ((a_study() + "---\n" + a_study()).encode(), "6:1", ["another document"]),
    "UTF-16": (a_study().encode("utf-16"), "1:1", ["byte 0xff is not UTF-8"]),
    "UTF-16 without a mark": (a_study().encode("utf-16-be"), "1:1", ["character U+0000"]),
    "Latin-1": ("title: f\xfcr\n".encode("latin-1"), "1:9", ["byte 0xfc is not UTF-8"]),
    "NUL bytes": (a_study(title="a\0b").encode(), "1:9", ["character U+0000"]),
    "half a character": (a_study(title='"\\ud800"'), "1:8", ["U+D800 is half a character"]),
    "a tab that indents": ("title: T\nlight:\n\tconstant: \n", "3:1", ["a tab cannot indent"]),
    "an open bracket": (a_study(methods="[importance_sampling"), "6:1", ["expected ',' or ']'"]),
    "an open quote": (a_study(title='"T'), "6:1", ["unexpected end of stream"]),
    "a wrong indent": ("title: T\n light: constant\n", "2:7", ["mapping values are not allowed here"]),
    "a key twice": (a_study() + "title: U\n", "6:1", ["key 'title' is already on line 1"]),
    "an option twice": (a_study(methods="{importance_sampling: {samples: 4, samples: 8}}"), "5:45", ["already"]),
    "an unknown alias": (a_study(view="*v"), "4:7", ["undefined alias 'v'"]),
    "an alias inside itself": (a_study(methods="&a [*a]"), "5:10", ["alias inside itself"]),
    "aliases for gigabytes": (bomb(), "1:37", ["more than 100000 values", "aliases"]),
    "a merge key": (a_study(methods="{<<: {importance_sampling: }}"), "5:11", ["keys cannot be merged by <<"]),
    "a Python object": (a_study(title="!!python/object/apply:os.system [x]"), "1:8", ["title", "must be"]),
    "a Python tag on text": (a_study(title="!!python/name:os.system x"), "1:8", ["tag", "is not allowed"]),
    "a tag of one's own": (a_study(title="!mine x"), "1:8", ["tag '!mine' is not allowed"]),
    "a binary tag": (a_study(title="!!binary eA=="), "1:8", ["is not allowed"]),
    "a hundred thousand brackets": ("title: " + "[" * 100_000, "1:1", ["nested more than 64 levels"]),
    "70 levels": (a_study(title="[" * 70 + "]" * 70), "1:72", ["more than 64 levels deep"]),
    "a file of 50 MB": (b"#" * 50_000_000, "1:1", ["larger than 1000000 bytes"]),
    "a number for a key": ("1: T\n", "1:1", ["a key must be text"]),
    "a list for a key": ("? [a]\n: T\n", "1:3", ["a key must be text"]),
    # Keys and values
    "a title that is a list": (a_study(title="[T, U]"), "1:8", ["title must be a valid string"]),
    "an empty title": (a_study(title="''"), "1:8", ["title", "at least 1 character"]),
    "a misspelt key": (a_study(metric="rms"), "6:1", ["unknown key 'metric'", "did you mean 'metrics'?"]),
    "a missing key": (a_study().replace("view:", "source:").replace("{sphere: {resolution: 4}}", "x"), "1:1",
                      ["key 'view' is required"]),
    "a date": (a_study(seed="2002-06-26"), "6:7", ["seed must be a valid integer", "'2002-06-26'"]),
    "a Boolean for a number": (a_study(seed="true"), "6:7", ["seed must be a valid integer", "True"]),
    "a negative seed": (a_study(seed="-1"), "6:7", ["seed must be greater than or equal to 0"]),
    "a huge seed": (a_study(seed="1" + "0" * 40), "6:7", ["seed must be less than 4294967296"]),
    "an integer of 5000 digits": (a_study(seed="1" * 5000), "6:7", ["is not a valid int"]),
    "an unknown device": (a_study(device="tpu"), "6:9", ["device must be 'cpu' or 'cuda'"]),
    "an infinite error": (a_study(reference="{relative_error: .inf}"), "6:29", ["must be a finite number"]),
    "an error of NaN": (a_study(reference="{relative_error: .nan}"), "6:29", ["relative_error must be"]),
    "an error beyond floats": (a_study(reference="{relative_error: 1e400}"), "6:29", ["must be a finite number"]),
    "no time at all": (a_study(time_limit="0"), "6:13", ["time_limit must be greater than 0"]),
    "endless time": (a_study(time_limit=".inf"), "6:13", ["time_limit must be less than or equal to"]),
    "an unknown metric": (a_study(metrics="[rms, rsm]"), "6:16", ["unknown metric 'rsm'", "'rms'"]),
    "a metric twice": (a_study(metrics="[rms, rms]"), "6:16", ["states the same twice: rms"]),
    "no metric": (a_study(metrics="[]"), "6:10", ["metrics"]),
    # Items, options, sweeps
    "an unknown method": (a_study(methods="importance_samplin"), "5:10", ["did you mean 'importance_sampling'?"]),
    "a misspelt option": (a_study(methods="{importance_sampling: {sample: 4}}"), "5:33", ["did you mean 'samples'?"]),
    "an integer as text": (a_study(methods="{importance_sampling: {samples: '4'}}"), "5:42", [SAMPLES, "got '4'"]),
    "an integer with a point": (a_study(methods="{importance_sampling: {samples: 4.5}}"), "5:42", [SAMPLES]),
    "a Boolean for samples": (a_study(methods="{importance_sampling: {samples: true}}"), "5:42", [SAMPLES, "True"]),
    "samples without end": (a_study(methods="{importance_sampling: {samples: 1000000000}}"), "5:42", ["1048576"]),
    "a huge seed of a method": (a_study(methods=f"{{importance_sampling: {{seed: {10**30}}}}}"), "5:39", ["seed must"]),
    "a width of NaN": (a_study(material="{ggx: {alpha: .nan}}"), "3:25", ["material.ggx.alpha"]),
    "an infinite radiance": (a_study(light="{constant: {radiance: .inf}}"), "2:30", ["light.constant.radiance"]),
    "a negative radiance": (a_study(light="{constant: {radiance: -1}}"), "2:30", ["light.constant.radiance"]),
    "a negative size": (a_study(view="{sphere: {resolution: -4}}"), "4:29", ["view.sphere.resolution", "-4"]),
    "no pixels": (a_study(view="{sphere: {resolution: 0}}"), "4:29", ["view.sphere.resolution", "1"]),
    "more pixels than memory": (a_study(view="{sphere: {resolution: 65536}}"), "4:29", ["8192"]),
    "a light larger than memory": (a_study(light="{constant: {resolution: 16384}}"), "2:32", ["8192"]),
    "a cube of 100 texels": (a_study(light="{constant: {resolution: 100}}"), "2:32", ["a power of two, got 100"]),
    "an empty sweep": (a_study(methods="{importance_sampling: {samples: []}}"), "5:42", [SAMPLES, "empty list"]),
    "no methods": (a_study(methods="[]"), "5:10", ["methods needs at least one item"]),
    "a null method": (a_study(methods="[~]"), "5:11", ["methods[0] must be a name"]),
    "lists of two lengths in zip": (a_study(methods="{importance_sampling: {zip: {samples: [4, 8], seed: [1]}}}"),
                                    "5:38", ["samples has 2, seed has 1"]),
    "two tuned options": (a_study(methods="{regular_sampling: {mip_bias: {tune: rms}, xi: {tune: rms}}}"), "5:57",
                          ["only one option of an item can be tuned"]),
    "a tuned light": (a_study(light="{constant: {radiance: {tune: rms}}}"), "2:30", ["only an option of a method"]),
    "the same method twice": (a_study(methods="[importance_sampling, importance_sampling]"), "5:32",
                              ["states the same twice"]),
    "1e9 cells": (a_study(light=f"{{spots: {{seed: {MANY}, resolution: 8}}}}",
                          view=f"{{sphere: {{resolution: {MANY}}}}}",
                          methods=f"{{importance_sampling: {{samples: {MANY}}}}}"),
                  "5:1", ["the study has 1000000000 cells, more than 100000"]),
    # Files of light
    "a missing image": (a_study(light="gone.hdr"), "2:8", ["no image file 'gone.hdr'"]),
    "no image at all": (a_study(light="{file: ''}"), "2:15", ["light.file"]),
    "a name of 5000 characters": (a_study(light=f"{{file: {'x' * 5000}.hdr}}"), "2:15", ["light.file"]),
    "a name with a NUL": (a_study(light='{file: "a\\0b.hdr"}'), "2:15", ["light.file", "no image file"]),
    "a name that is a pattern": (a_study(light='{file: "**/[.hdr"}'), "2:15", ["light.file", "no image file"]),
    "a folder as an image": (a_study(light="{file: /}"), "2:15", ["light.file"]),
    # Claims and exclusions
    "a claim about no method": (a_study(claims="[{text: A, value: fis, of: rms, equals: 1}]"), "6:", ["method 'fis'"]),
    "a claim about no metric": (a_claim("where: {}").replace("of: rms", "of: flop"), "6:", ["'flop'"]),
    "a claim about no option": (a_claim("where: {sample: 4}"), "6:", ["no option 'sample'", "'samples'"]),
    "a claim about no value": (a_claim("where: {samples: 5}"), "6:", ["claims[0].where", "fits no cell", "4, 8"]),
    "a claim about no light": (a_claim("where: {light: spots}"), "6:", ["no light 'spots' in this study"]),
    "a claim about no pair": (a_claim("where: {samples: 4, alpha: 0.4}"), "6:", ["fits no cell", "alpha [0.5, 0.5]"]),
    "a claim about excluded cells": (a_claim("where: {samples: 4}", exclude="[{samples: 4}]"), "7:",
                                     ["fits no cell", "samples 8"]),
    "too many claims": (a_study(claims=f"[{', '.join(['{}'] * 1001)}]"), "6:9", ["claims", "at most 1000"]),
    "a claim without a bound": (a_study(claims="[{text: A, value: importance_sampling, of: rms}]"), "6:",
                                ["either 'between' or 'equals'"]),
    "an exclusion of all": (a_study(exclude="[{light: constant}]"), "6:10", ["exclude leaves no cell"]),
    "an exclusion of nothing": (a_study(exclude="[{samples: 5}]"), "6:11", ["exclude[0] fits no cell"]),
    # Plug-ins
    "a plug-in that is not there": (a_study(plugins="[no_such_lab]"), "6:11",
                                    ["'no_such_lab': no such module: not in "]),
    "a plug-in by path": (a_study(plugins="[../evil]"), "6:11", ["plugins[0]", "dotted name of a module", "'../evil'"]),
    "a plug-in by absolute path": (a_study(plugins="[/tmp/evil.py]"), "6:11", ["dotted name of a module"]),
    "a relative plug-in": (a_study(plugins="[.evil]"), "6:11", ["dotted name of a module"]),
    "a plug-in without a name": (a_study(plugins="['']"), "6:11", ["dotted name of a module"]),
    "a plug-in that raises": (lambda: plugin("raises", "raise RuntimeError('a\\nb')"), "6:11", ["RuntimeError: a b"]),
    "a plug-in that leaves": (lambda: plugin("leaves", "import sys; sys.exit(0)"), "6:11", ["SystemExit: 0"]),
    "a plug-in that is no Python": (lambda: plugin("broken", "def ("), "6:11", ["SyntaxError"]),
    "a plug-in that takes a name": (
        lambda: plugin("takes", "from glossbench.shading.method import METHODS, Method\n"
                                "@METHODS.register('importance_sampling')\nclass Mine(Method): pass\n"),
        "6:11", ["is registered twice"]),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_study_is_one_line_with_its_place_and_nothing_is_written(call, name):
    content, place, words = BROKEN[name]
    text = content() if callable(content) else content
    Path("my.yaml").write_bytes(text.encode("utf-8") if isinstance(text, str) else text)
    before = everything()
    started = time.perf_counter()

    code, out, err = call("run", "my.yaml")

    assert (code, out) == (2, "")
    assert err.startswith(f"error: my.yaml:{place}")
    assert err.count("\n") == 1
    assert len(err) < 800
    assert [word for word in words if word not in err] == []
    assert everything() == before
    # The slowest, the hundred thousand brackets, takes 1.8 s on a busy machine.
    assert time.perf_counter() - started < 20


def test_the_study_that_the_broken_ones_come_from_is_whole(call):
    """Twin of the above: without its fault it is checked, and counted."""
    Path("my.yaml").write_text(a_claim("where: {samples: 4, alpha: 0.5}", plugins="[json]", time_limit="60"))

    code, out, err = call("validate", "my.yaml")

    assert (code, out.splitlines()[0], err) == (0, "T: 1 light, 1 material, 1 view, 2 cells, 1 claim", "")


def pipe(name: str) -> str:
    os.mkfifo(name)
    return name


def linked(name: str, target: str) -> str:
    os.symlink(target, name)
    return name


@pytest.mark.skipif(os.name != "posix", reason="pipes and links of POSIX")
@pytest.mark.parametrize(
    ("make", "why"),
    [
        (lambda: "gone.yaml", "No such file or directory"),
        (lambda: "a/../../b.yaml", "No such file or directory"),
        (lambda: str(Path("folder.yaml").mkdir() or "folder.yaml"), "Is a directory"),
        (lambda: pipe("pipe.yaml"), "it is a device or pipe"),
        (lambda: linked("null.yaml", "/dev/zero"), "it is a device or pipe"),
        (lambda: linked("loop.yaml", "loop.yaml"), "Too many levels of symbolic links"),
        (lambda: "x" * 5000 + ".yaml", "File name too long"),
        (lambda: str(Path("file").touch() or "file/my.yaml"), "Not a directory"),
    ],
    ids=["missing", "missing elsewhere", "folder", "pipe", "device", "loop", "long name", "below a file"],
)
def test_what_cannot_be_read_is_one_line(call, make, why):
    path = make()
    before = everything() if path != "pipe.yaml" else {}

    code, out, err = call("run", path)

    assert (code, out) == (2, "")
    assert err == f"error: cannot read the study {path!r}: {why}\n"
    assert path == "pipe.yaml" or everything() == before


@pytest.mark.skipif(sys.platform != "linux", reason="a file of Linux that no one can read")
def test_a_file_that_refuses_to_be_read_is_one_line(call):
    linked("mem.yaml", "/proc/self/mem")

    code, _, err = call("run", "mem.yaml")

    assert (code, err) == (2, "error: cannot read the study 'mem.yaml': Input/output error\n")


@pytest.mark.parametrize("name", ["../my", "a/b", "/etc/passwd", "", "quickstart/..", "quickstart.yaml/"])
def test_a_name_of_a_study_is_not_a_path(call, name):
    code, out, err = call("run", name)

    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert everything() == {}


def test_results_lie_below_results_wherever_the_study_lies(call):
    folder = Path("a b/../..c")
    Path("a b").mkdir()
    folder.mkdir()
    (folder / "my.study.yaml").write_text(a_study())

    code, out, _ = call("run", str(folder / "my.study.yaml"), "--dry-run")

    assert code == 0
    assert out.splitlines()[-2] == "2 cells would go to results/my.study: 2 new"


def test_a_plugin_that_imports_itself_and_prints_is_welcome(call):
    text = plugin("myself", "import myself, sys\nprint('hello'); print('there', file=sys.stderr)")
    Path("my.yaml").write_text(text)

    code, out, _ = call("validate", "my.yaml")

    assert (code, out.splitlines()[:2]) == (0, ["hello", "T: 1 light, 1 material, 1 view, 2 cells, 0 claims"])


def test_another_process_ends_with_2_and_one_line(here):
    content, _, words = BROKEN["a plug-in that leaves"]
    Path("my.yaml").write_text(content())
    main = "from glossbench.commands.cli import main; main()"

    done = ran(main, "validate", "my.yaml", log=here / "log", PYTHONPATH=str(here))

    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert words[0] in done.stderr


@pytest.mark.parametrize("name", ["aliases for gigabytes", "1e9 cells", "a file of 50 MB"])
def test_what_is_refused_is_refused_before_it_takes_memory(name):
    content, _, _ = BROKEN[name]
    Path("my.yaml").write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError):
        load_study("my.yaml")
    tracemalloc.start()

    with pytest.raises(InputError):
        load_study("my.yaml")

    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # Measured: 21, 2.7 and 1.0 MB; written out, the bomb would be 1e12 values.
    assert peak < 50e6


def seconds_to_load(n: int) -> float:
    Path("many.yaml").write_text(a_study(methods=f"{{importance_sampling: {{samples: {list(range(1, n + 1))}}}}}"))
    started = time.process_time()
    assert len(load_study("many.yaml").cells()) == n
    return time.process_time() - started


def test_the_time_to_load_grows_with_the_cells_and_not_with_their_square():
    few, many = min(seconds_to_load(500) for _ in range(3)), seconds_to_load(5000)

    # Measured: 6.7 times the cells take 6.2 times as long; comparing all with all, 3 times took 9.4 times as long.
    assert many < 30 * few


def test_a_where_of_two_sides_may_fit_each(call):
    claim = (
        "{text: A, lower: {importance_sampling: {samples: 8}}, than: {importance_sampling: {samples: 4}}, metric: rms}"
    )
    Path("my.yaml").write_text(a_study(claims=f"[{claim}]"))

    code, out, err = call("validate", "my.yaml")

    assert (code, out.splitlines()[0], err) == (0, "T: 1 light, 1 material, 1 view, 2 cells, 1 claim", "")


def test_a_side_that_no_cell_has_is_pointed_at(call):
    claim = (
        "{text: A, lower: {importance_sampling: {samples: 8}}, than: {importance_sampling: {samples: 5}}, metric: rms}"
    )
    Path("my.yaml").write_text(a_study(claims=f"[{claim}]"))

    _, _, err = call("validate", "my.yaml")

    assert err.startswith("error: my.yaml:6:")
    assert "claims[0].than.importance_sampling fits no cell of importance_sampling; they have samples 4, 8" in err


@pytest.mark.parametrize(("bias", "said"), [("{tune: rms}", "1 cell: A"), ("0.125", "fits no cell")])
def test_a_claim_is_about_a_tuned_option_as_the_study_states_it(call, bias, said):
    methods = "{regular_sampling: {samples: 14, mip_bias: {tune: rms}}}"
    claim = f"{{text: A, value: regular_sampling, of: rms, between: [0, 1], where: {{mip_bias: {bias}}}}}"
    Path("my.yaml").write_text(a_study(methods=methods, claims=f"[{claim}]"))

    _, out, err = call("validate", "my.yaml")

    assert said in out + err
