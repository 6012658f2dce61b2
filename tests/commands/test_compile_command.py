"""`glossbench compile`: what it compiles, compares and removes."""

import pytest

from glossbench.commands import printing
from glossbench.shading.kernels import artefacts, build

pytestmark = pytest.mark.usefixtures("here")


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache, and a compiler that writes nothing."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(build, "has_compiler", lambda: True)
    monkeypatch.setattr(build, "build", lambda call, processes: asked.append(call.kernel.name))
    asked = []
    return asked


def test_it_wants_a_study(call):
    called = call("compile")

    assert called.code == 2
    assert called.err == "error: compile: name a study, or --all\n"


def test_an_unknown_study_is_one_line(call):
    called = call("compile", "quickstar")

    assert called.code == 2
    assert called.err.count("\n") == 1
    assert "quickstart" in called.err


def test_without_a_compiler_it_is_one_line(call, monkeypatch):
    monkeypatch.setattr(build, "has_compiler", lambda: False)

    called = call("compile", "tiny.yaml")

    assert called.code == 2
    assert called.err == "error: compile: there is no C++ compiler; install g++ or clang++\n"


def test_it_compiles_the_kernels_that_the_cells_call_and_counts_what_failed(call, cache):
    called = call("compile", "tiny.yaml", "--check")

    assert called.code == 1
    assert {"importance_sampling", "sum_by_moments"} <= set(cache)
    first, *rest = called.out.splitlines()
    assert first == f"{len(cache)} kernels: 0 were there, 0 compiled, {len(cache)} failed"
    assert all(line.endswith(": not compiled") for line in rest)


def test_a_log_gets_a_line_of_progress_now_and_then(call, cache, monkeypatch):
    monkeypatch.setattr(printing, "PULSE", 0.0)
    monkeypatch.setattr(build, "build", lambda call, processes: cache.append(call.kernel.name))

    err = call("compile", "tiny.yaml").err

    assert f"{len(cache)} of {len(cache)} kernels, " in err


def test_clear_removes_what_is_compiled(call, cache):
    artefacts.folder().mkdir(parents=True)
    (artefacts.folder() / "one.json").write_text("{}")

    called = call("compile", "--clear")

    assert called.code == 0
    assert called.out.split() == ["1", "compiled", "kernels", "removed", "from", *str(artefacts.folder()).split()]
    assert list(artefacts.folder().iterdir()) == []
