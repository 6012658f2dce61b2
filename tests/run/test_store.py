"""Results at any address: the same files as in a folder, damage is found, and reports read them there."""

import pickle
import socket
import subprocess
import sys
import time
from uuid import uuid4

import pytest

from glossbench.errors import InputError, WriteError
from glossbench.run import reservation
from glossbench.run.folder import Folder
from glossbench.run.results import Results
from glossbench.run.runner import Progress, run_study
from glossbench.run.store import open_store
from oracles.flat_studies import TIMES, registered, study_in

METHODS = {"methods": "[{flat: {samples: 1, level: {tune: distance}}}, {regular_sampling: }]"}
PLACES = ["file", "memory", "s3"]


@pytest.fixture(autouse=True)
def names():
    with registered():
        yield


@pytest.fixture(scope="module")
def s3():
    """A server of S3 in a process of its own, with one bucket; skips where it is not installed."""
    pytest.importorskip("s3fs", reason="no client of S3; pip install s3fs")
    pytest.importorskip("moto.server", reason="no server of S3; pip install 'moto[server]'")
    import s3fs

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    server = subprocess.Popen(
        [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)], stderr=subprocess.DEVNULL
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}")
        for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
            patch.setenv(name, "test")
        try:
            for _ in range(300):
                with socket.socket() as probe:
                    if probe.connect_ex(("127.0.0.1", port)) == 0:
                        break
                time.sleep(0.1)
            s3fs.S3FileSystem().mkdir("results")
            yield "s3://results"
        finally:
            server.terminate()
            server.wait()


@pytest.fixture
def address(request, tmp_path):
    """The address of a new store of each kind."""
    if request.param == "s3":
        return f"{request.getfixturevalue('s3')}/{uuid4().hex}"
    pytest.importorskip("fsspec", reason="pip install 'glossbench[distributed]'")
    places = {"file": f"file://{tmp_path}/r", "memory": f"memory://{uuid4().hex}"}
    return places[request.param]


def remains(results):
    """All that a run left but times, wherever it lies."""
    names = [name for kind in ("images", "references") for name in results.store.list(f"{kind}/")]
    kept = {name: results.store.get(name) for name in names if not name.endswith(".json")}
    whole = {name: results.store.get(name) for name in ("study.yaml", "claims.json", "columns.json")}
    return {"table": results.cells.drop(columns=TIMES).to_parquet(), **kept, **whole}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The study, and what its run leaves in a folder."""
    folder = tmp_path_factory.mktemp("whole")
    with registered():
        study = study_in(folder, **METHODS)
        return study, remains(run_study(study, folder / "r"))


@pytest.mark.parametrize("address", PLACES, indirect=True)
def test_a_run_leaves_the_same_bytes_at_every_address_and_its_reports_are_there(address, whole, monkeypatch):
    from glossbench.reports.page import html

    study, expected = whole

    results = run_study(study, address)

    assert remains(results) == expected
    assert remains(Results.open(address)) == expected
    page = html.write_report(address)
    assert str(page) == f"{address.removeprefix('file://')}/report.html"
    assert b"<html" in results.store.get("report.html")


def flip(data: bytes) -> bytes:
    """One bit in the middle is another."""
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]


HARM = [flip, lambda data: data[: len(data) // 2], lambda data: b'{"version": 7}']


@pytest.mark.parametrize("address", ["memory", "s3"], indirect=True)
def test_what_is_damaged_there_is_computed_again_with_one_line(address, whole):
    study, expected = whole
    results = run_study(study, address)
    image = next(name for name in results.store.list("images/") if name.endswith(".exr"))
    truth = next(name for name in results.store.list("references/") if name.endswith("_deviates.npz"))

    for harm in HARM:
        damaged = {image: "cell", truth: "reference"}
        for name in damaged:
            results.store.put(name, harm(results.store.get(name)))
        told = []
        run_study(study, address, progress=Progress(note=told.append))

        assert sorted(told) == [
            f"{address}/{name} is damaged: this {damaged[name]} is computed again" for name in damaged
        ]
        assert remains(results) == expected


def test_a_store_that_cannot_be_written_stops_the_run(whole, monkeypatch):
    pytest.importorskip("fsspec")
    from fsspec.implementations.memory import MemoryFileSystem

    def full(self, path, value, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(MemoryFileSystem, "pipe_file", full)

    with pytest.raises(WriteError, match=r"^memory://full/begun/run\.json: cannot be written: .*No space left"):
        run_study(whole[0], "memory://full")


@pytest.mark.parametrize("n_writes", [3, 8, 12])
def test_a_store_that_becomes_read_only_in_mid_run_stops_it_fails_no_cell_and_the_run_goes_on(
    whole, monkeypatch, n_writes
):
    pytest.importorskip("fsspec")
    from fsspec.implementations.memory import MemoryFileSystem

    (study, expected), address, written = whole, f"memory://{uuid4().hex}", []
    write = MemoryFileSystem.pipe_file

    def refuse(*args, **kwargs):
        raise OSError(30, "Read-only file system")

    def write_some(self, path, value, **kwargs):
        if len(written) == n_writes:
            refuse()
        written.append(path)
        write(self, path, value, **kwargs)

    with monkeypatch.context() as patch:
        patch.setattr(MemoryFileSystem, "pipe_file", write_some)
        patch.setattr(MemoryFileSystem, "rm_file", lambda *args: refuse() if len(written) == n_writes else None)
        with pytest.raises(WriteError, match=r"cannot be written: .*Read-only file system"):
            run_study(study, address)

    assert len(written) == n_writes
    monkeypatch.setattr(reservation, "PATIENCE", 0.0)  # its record could not be removed, and this process lives
    results = run_study(study, address)
    assert remains(results) == expected
    assert set(results.cells["status"]) == {"done"}


@pytest.mark.parametrize(
    ("address", "words"), [("nosuch://x", "nosuch://x: .*[Pp]rotocol"), ("memory://empty", "holds no results")]
)
def test_an_address_without_results_is_one_line(address, words):
    pytest.importorskip("fsspec")

    with pytest.raises(InputError, match=words):
        Results.open(address)


def test_a_path_is_always_a_folder_and_a_store_can_be_pickled(tmp_path):
    assert open_store(tmp_path / "s3://bucket") == Folder(tmp_path / "s3://bucket")
    for store in (open_store(tmp_path), open_store("memory://x")):
        assert pickle.loads(pickle.dumps(store)) == store
