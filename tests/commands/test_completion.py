"""The Tab key: what it offers, and that nothing heavy is imported for it."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from glossbench.catalog.entries import list_entries
from glossbench.commands import completion
from glossbench.study.registries import REGISTRIES

pytestmark = pytest.mark.usefixtures("here")


OFFERED = {
    "glossbench run qui": ["quickstart"],
    "glossbench validate qui": ["quickstart"],
    "glossbench run quickstart --light grace_l": ["grace_latlong"],
    "glossbench run quickstart --light spo": ["spots"],
    "glossbench run quickstart -m regular": ["regular_sampling"],
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


@pytest.mark.parametrize("kind", REGISTRIES)
def test_names_read_from_sources_are_those_that_are_registered(kind):
    named_by_the_catalogue = {e.name for kind in ("environment", "brdf") for e in list_entries(kind)}

    assert set(completion.list_registered(kind)) == set(REGISTRIES[kind].names()) - named_by_the_catalogue


def test_results_are_offered_as_folders():
    Path("results/tiny").mkdir(parents=True)
    Path("results/tiny/cells.parquet").touch()
    Path("results/other").mkdir()

    assert completion.results("results/t") == ["results/tiny"]
    assert completion.results("") == ["results/tiny"]


def test_importing_glossbench_imports_torch_only_when_a_name_is_used():
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
