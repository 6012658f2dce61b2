"""Fixtures that more than one test module asks for."""

import gc
import os
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
import shape_checks
from platformdirs import user_cache_path

pytest.register_assert_rewrite("oracles")  # before any of it is imported

from oracles.browser import Browser, find  # noqa: E402

# Compiled kernels of the user are not run here, nor ours kept: the numbers of tests do not depend on what is compiled.
_cache = TemporaryDirectory(prefix="glossbench-tests-")
os.environ.setdefault("MPLCONFIGDIR", str(user_cache_path("matplotlib")))  # its fonts, which take seconds to list
os.environ["XDG_CACHE_HOME"] = _cache.name
if "PYTEST_XDIST_WORKER" in os.environ:  # a process a core: torch, not yet imported, takes no more than its own
    os.environ.setdefault("OMP_NUM_THREADS", "1")
shape_checks.install()


SLOW = {line for line in (Path(__file__).parent / "slow.txt").read_text().split("\n") if line and line[0] != "#"}


def _is_slow(name: str) -> bool:
    """Whether slow.txt lists a test, for all its parameters, or its whole file."""
    return name.partition("[")[0] in SLOW or name.partition("::")[0] in SLOW


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """The fast tier does not even import files that are slow as a whole."""
    named = collection_path.relative_to(Path(__file__).parent).as_posix() in SLOW
    return True if named and config.option.markexpr == "not slow" else None


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Iterator[None]:
    """No search for garbage among what the collection makes: it stays, and each search would look at all of it."""
    gc.disable()
    result = yield
    gc.freeze()
    gc.enable()
    return result


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with many slow tests come first, so that no worker is left with one of them at the end."""
    n_slow: Counter[Path] = Counter()
    for item in items:
        if _is_slow(item.nodeid.removeprefix("tests/")):
            item.add_marker(pytest.mark.slow)
            n_slow[item.path] += 1
    items.sort(key=lambda item: -n_slow[item.path])


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One worker more than cores: tests wait for a browser, for other processes and for time limits."""
    return (os.cpu_count() or 1) + 1


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Shapes are compared in the fast tier, which calls all of the code: it costs a quarter of a test's time.

    Not in tests of runs: these compare tracebacks byte by byte, in which the comparison has its own lines.
    """
    is_left_out = item.get_closest_marker("slow") or item.path.parent.name == "run"
    with shape_checks.off() if is_left_out else nullcontext():
        return (yield)


@pytest.fixture(scope="module", autouse=True)
def _registries_as_they_were():
    """What a module's tests register is gone when the next module's begin."""
    from glossbench.study.registries import REGISTRIES  # late, as it imports torch

    with ExitStack() as stack:
        for registry in REGISTRIES.values():
            stack.enter_context(registry.isolated())
        yield


@pytest.fixture(scope="session", autouse=True)
def _nothing_waits():
    """Work is timed once, except with the fixture `several_runs`; no write waits for the disk."""
    from glossbench.shading import image, stage_cache  # late, as they import torch
    from glossbench.shading.costs import time_work

    with pytest.MonkeyPatch.context() as patch:
        for module in (image, stage_cache):
            patch.setattr(module, "time_work", lambda work, device, patience: time_work(work, device, 0))
        patch.setattr(os, "fsync", lambda opened: None)
        yield


@pytest.fixture
def several_runs(monkeypatch):
    """Work is timed as outside of tests: run again and again."""
    from glossbench.shading.costs import time_work

    for module in ("image", "stage_cache"):
        monkeypatch.setattr(f"glossbench.shading.{module}.time_work", time_work)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real light files and its MANIFEST.yaml; skips where it is absent."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("GLOSSBENCH_DATA") or default)
    if not (folder / "MANIFEST.yaml").is_file():
        pytest.skip(f"no light files in {folder}; set GLOSSBENCH_DATA")
    return folder


@pytest.fixture(scope="session")
def browser():
    """A chromium without a window; skips where none is installed."""
    if find() is None:
        pytest.skip("no chromium to open a report in; install the package chromium")
    with Browser() as opened:
        yield opened
