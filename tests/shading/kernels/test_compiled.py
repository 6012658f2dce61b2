"""Compiled kernels: the values of the eager ones, from a cache that may be damaged, shared or absent."""

import logging
import os
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
import torch

from glossbench.directions import points_2d, spherical, to_local
from glossbench.errors import WriteError
from glossbench.scene.mesh_view import MeshView
from glossbench.scene.sphere import Sphere
from glossbench.shading.kernels import artefacts, backend, build, check, kernel, over_points
from glossbench.shading.kernels.backend import always, choosing, never, noting
from glossbench.shading.kernels.programs import program
from glossbench.shading.visibility import unhidden
from glossbench.strict_json import seal, unseal

N = 16


@dataclass(frozen=True)
class Table:
    """Weights by row, and a number that is a part of the kernel."""

    weights: torch.Tensor
    factor: float


@kernel("of_tests")
def cosines(points, samples, table):
    """Sums over samples: their number, that of the points and that of the weights are all free."""
    value = (points.n.z * samples).clamp(min=0).sqrt() * table.factor
    at = (value * (table.weights.shape[0] - 1)).long().clamp(0, table.weights.shape[0] - 1)
    return torch.stack([(table.weights[at] * value).sum(1), value.sum(1)], dim=1)


def arguments(n_samples=N, n_weights=7):
    generator = torch.Generator().manual_seed(n_samples)
    return torch.rand(1, n_samples, generator=generator), Table(torch.rand(n_weights, generator=generator), 0.75)


def image(choose, n_samples=N, n_weights=7, resolution=20):
    """The kernel's sums, and how it ran."""
    with choosing(choose), noting() as used:
        found = over_points(
            cosines, Sphere(resolution=resolution).points(), n_samples, *arguments(n_samples, n_weights)
        )
    return found, used["of_tests"]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with the compiled kernel."""
    if not build.has_compiler():
        pytest.skip("no C++ compiler")
    folder = tmp_path_factory.mktemp("made")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        patch.setattr(backend, "loaded", {})
        assert image(always)[1] == "compiled"
    return folder


@pytest.fixture
def cache(made, tmp_path, monkeypatch):
    """A copy of that folder, which this process has not read yet, and no compiler."""
    shutil.copytree(made, tmp_path / "cache")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(backend, "loaded", {})
    monkeypatch.setattr(backend, "has_compiler", lambda: False)
    artefacts.warn_of.cache_clear()
    return artefacts.folder()


def facts_of(cache):
    (path,) = cache.glob("*.json")
    return path


def library_of(cache):
    (path,) = cache.glob("*.so")
    return path


def check_refused(caplog, words):
    """The kernel runs eagerly, with the eager numbers, and one line says why."""
    found, how = image(always)

    assert how == "eager"
    assert (found == image(never)[0]).all()
    assert len(caplog.records) == 1
    assert words in caplog.records[0].getMessage()


@pytest.mark.parametrize(("n_samples", "n_weights", "resolution"), [(N, 7, 20), (33, 5, 9), (N, 900, 64)])
def test_one_compiled_kernel_serves_all_sizes(cache, n_samples, n_weights, resolution):
    eager, _ = image(never, n_samples, n_weights, resolution)

    found, how = image(always, n_samples, n_weights, resolution)

    assert how == "compiled"
    torch.testing.assert_close(found, eager, rtol=1e-6, atol=0)


SLOW_COMPILER = """
import os, subprocess, sys
def main():
    program = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(300)"])
    with open(f"{os.getpid()}.begun", "w") as file:
        file.write(str(program.pid))
    program.wait()
"""


def is_running(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_an_interruption_ends_the_compilers_that_run_and_begins_no_other(tmp_path, monkeypatch, caplog):
    (tmp_path / "slow_compiler.py").write_text(SLOW_COMPILER)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(build, "COMPILER", "slow_compiler")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    with backend.recording() as recorded:
        over_points(cosines, Sphere(resolution=20).points(), N, *arguments())

    def find_calls():
        yield from recorded[:1] * 20
        while not any(file.stat().st_size for file in tmp_path.glob("*.begun")):
            time.sleep(0.01)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        build.build_all(find_calls())

    begun = {int(file.stem): int(file.read_text() or 0) for file in tmp_path.glob("*.begun")}
    assert 1 <= len(begun) <= (os.cpu_count() or 1)
    time.sleep(0.1)
    assert not [pid for pid in (*begun, *begun.values()) if is_running(pid)]
    assert not caplog.records


def test_the_check_sees_a_compiled_kernel_that_is_wrong(cache, monkeypatch):
    with backend.recording() as calls:
        over_points(cosines, Sphere(resolution=20).points(), N, *arguments())
    assert check.difference(calls[0]) < 1e-6

    load = backend.load
    monkeypatch.setattr(check, "load", lambda call: lambda tensors: load(call)(tensors) * (1 + 1e-4))

    assert check.difference(calls[0]) > 5e-5


def test_what_is_compiled_runs_without_being_asked_for(cache):
    found = over_points(cosines, Sphere(resolution=20).points(), N, *arguments())

    assert (found == image(always)[0]).all()
    assert backend.loaded


def test_a_kernel_with_other_numbers_in_it_is_another_kernel(cache):
    points, (samples, table) = Sphere(resolution=20).points(), arguments()

    with choosing(always), noting() as used:
        over_points(cosines, points, N, samples, replace(table, factor=0.5))

    assert used == {"of_tests": "eager"}


@pytest.mark.parametrize("at", [0, 0.3, 0.999])
def test_a_damaged_byte_of_the_library_is_seen_before_it_is_loaded(cache, caplog, at):
    data = bytearray(library_of(cache).read_bytes())
    data[int(at * len(data))] ^= 1
    library_of(cache).write_bytes(data)

    check_refused(caplog, "is damaged")


def test_a_library_that_is_cut_short_is_refused(cache, caplog):
    data = library_of(cache).read_bytes()
    library_of(cache).write_bytes(data[: len(data) // 2])

    check_refused(caplog, "is damaged")


def test_a_library_that_is_missing_is_refused(cache, caplog):
    library_of(cache).unlink()

    check_refused(caplog, "is damaged")


def test_damaged_facts_are_refused(cache, caplog):
    facts_of(cache).write_bytes(facts_of(cache).read_bytes().replace(b"of_tests", b"of_texts"))

    check_refused(caplog, "is damaged")


@pytest.mark.parametrize("target", ["torch 2.0.0, 0123456789abcdef", artefacts.target()[:-1] + "x"])
def test_what_another_torch_or_processor_compiled_is_refused(cache, caplog, target):
    facts = unseal(facts_of(cache).read_bytes())
    facts_of(cache).write_text(seal(facts | {"target": target}))

    check_refused(caplog, "compiled elsewhere")


@pytest.mark.parametrize("part", ["torch", "flags"])
def test_the_key_names_torch_and_the_processor(cache, monkeypatch, part):
    assert image(always)[1] == "compiled"

    monkeypatch.setattr(artefacts, "target", lambda: f"another {part}")

    assert image(always)[1] == "eager"


def test_without_a_compiler_one_line_says_so(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(backend, "loaded", {})
    monkeypatch.setattr(build.shutil, "which", lambda name: None)
    build.has_compiler.cache_clear()
    with caplog.at_level(logging.WARNING, logger="glossbench"):
        images = [image(always) for _ in range(3)]
    build.has_compiler.cache_clear()

    assert all(how == "eager" for _, how in images)
    assert [r.getMessage() for r in caplog.records] == [
        "no C++ compiler found: kernels run eagerly, 5 to 10 times slower"
    ]


def test_a_compiler_that_fails_is_one_line_and_is_not_tried_again(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(backend, "loaded", {})
    (tmp_path / "failing_compiler.py").write_text("def main(): raise OSError('main.so: file too short')")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(build, "COMPILER", "failing_compiler")
    monkeypatch.setattr(build, "failed", set())
    monkeypatch.setattr(backend, "failed", build.failed)
    monkeypatch.setattr(backend, "has_compiler", lambda: True)

    images = [image(always) for _ in range(2)]

    assert [how for _, how in images] == ["eager", "eager"]
    assert [record.getMessage() for record in caplog.records] == [
        "of_tests is not compiled and runs eagerly: OSError: main.so: file too short"
    ]


def store_again(cache, name="of_tests"):
    facts = unseal(facts_of(cache).read_bytes())
    facts.pop("library")
    return lambda key, library: artefacts.store(key, library, facts | {"kernel": name})


def test_a_folder_that_may_only_be_read_is_an_error_with_its_name(cache, tmp_path, monkeypatch):
    store, library = store_again(cache), tmp_path / "other.so"
    library.write_bytes(b"other")
    monkeypatch.setattr(artefacts, "folder", lambda: tmp_path / "other.so" / "kernels")

    with pytest.raises(WriteError, match=r"other\.so"):
        store("0" * 20, library)


def test_the_cache_is_bounded_and_the_least_recently_used_goes(cache, tmp_path):
    store = store_again(cache)
    for i in range(4):
        library = tmp_path / f"{i}.so"
        library.write_bytes(bytes([i]) * 1000)
        artefact = store(f"{i:020}", library)
        (path,) = cache.glob(f"*.{i:020}.*.json")
        os.utime(path, (i, i))
        assert artefacts.library_of(artefact).read_bytes() == library.read_bytes()
    os.utime(facts_of_key(cache, 0), (9, 9))
    for path in cache.glob("of_tests.*"):
        if ".0000" not in path.name:
            path.unlink()

    artefacts.bound(2500)

    kept = sorted(path.name.split(".")[1].lstrip("0") or "0" for path in cache.glob("*.json"))
    assert kept == ["0", "3"]
    assert {path.read_bytes()[0] for path in cache.glob("*.so")} == {0, 3}


def facts_of_key(cache, i):
    (path,) = cache.glob(f"*.{i:020}.*.json")
    return path


def test_a_library_that_another_process_is_storing_stays(cache):
    (cache / "new.so").write_bytes(b"new")
    (cache / "old.so").write_bytes(b"old")
    os.utime(cache / "old.so", (0, 0))

    artefacts.bound(1 << 30)

    assert (cache / "new.so").is_file()
    assert not (cache / "old.so").exists()
    assert image(always)[1] == "compiled"


def test_clear_removes_all(cache):
    assert artefacts.clear() == 1
    assert list(cache.iterdir()) == []
    assert artefacts.clear() == 0


def test_two_processes_that_store_at_once_both_end_well(cache, tmp_path):
    program = (
        "import sys; from pathlib import Path; from glossbench.shading.kernels import artefacts;"
        "from glossbench.strict_json import unseal;"
        "facts = unseal(Path(sys.argv[1]).read_bytes()); facts.pop('library');"
        "[artefacts.store(sys.argv[2], Path(sys.argv[3]), facts) for _ in range(30)]"
    )
    key = facts_of(cache).name.split(".")[1]
    copy = shutil.copy(library_of(cache), tmp_path / "copy.so")
    command = [sys.executable, "-c", program, str(facts_of(cache)), key, str(copy)]

    both = [subprocess.Popen(command) for _ in range(2)]

    assert [process.wait() for process in both] == [0, 0]
    assert sorted(path.suffix for path in cache.iterdir()) == [".json", ".so"]
    assert image(always)[1] == "compiled"


def test_much_work_is_compiled_without_being_asked_for_and_little_is_not(cache, monkeypatch):
    asked = []
    monkeypatch.setattr(backend, "has_compiler", lambda: True)
    monkeypatch.setattr(backend, "build", lambda call: asked.append(call.pairs))
    monkeypatch.setattr(backend, "compile_seconds", lambda: 10.0)
    points, table = Sphere(resolution=20).points(), arguments()[1]
    other = replace(table, factor=0.25), 10 * backend.EAGER_RATE / len(points)

    for width in (1.01 * other[1], 0.99 * other[1]):
        monkeypatch.setattr("glossbench.shading.kernels.chunks.CHUNK", 1 << 40)
        over_points(cosines, points, int(width), arguments()[0], other[0])

    assert len(asked) == 1


def test_a_function_without_a_name_runs_eagerly():
    points = Sphere(resolution=4).points()

    with choosing(always):
        found = over_points(lambda chunk: chunk.n.x, points, 1)

    assert (found[:, 0] == points.n.x).all()


def test_a_local_kernel_runs_eagerly(cache):
    local = kernel("local")(lambda points: points.n.x)

    with choosing(always), noting() as used:
        over_points(local, Sphere(resolution=4).points(), 1)

    assert used == {"local": "eager"}


@kernel("with_rays")
def lit(points, directions, occluder):
    """The sum of the cosines of directions that nothing hides."""
    cosine = to_local(directions, points.t, points.b, points.n).z.clamp(min=0)
    return unhidden((cosine,), points, directions, occluder)[0].sum(1)


def test_a_kernel_in_two_programs_with_rays_between_them_sees_what_the_whole_one_sees(monkeypatch):
    """The programs run eagerly: compiling both takes 45 s of processor time."""
    monkeypatch.setattr(backend, "compiled", lambda call: program(call.kernel.function, call.form, call.part))
    view, u = MeshView(shape="bowl", resolution=8), points_2d(64)
    directions = spherical(torch.pi * u[None, :, 0], 2 * torch.pi * u[None, :, 1])
    whole, blind = (over_points(lit, view.points(), 64, directions, each) for each in (view.scene(), None))

    with choosing(always), noting() as used:
        parts = over_points(lit, view.points(), 64, directions, view.scene())

    assert used == {"with_rays": "compiled"}
    assert (parts == whole).all()
    assert (whole <= blind).all()
    assert (whole < blind).any()
