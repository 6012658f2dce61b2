"""The catalogue: its entries, its names as lights, and downloads that break, resume, and are verified."""

import hashlib
import json
import socket
import threading
import time
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
import torch
import yaml

import glossbench as gb
from glossbench.catalog import download, folders
from glossbench.catalog import entries as catalog
from glossbench.catalog.entries import Entry, fetch, find_entry, list_entries
from glossbench.catalog.locate import locate
from glossbench.envmap.formats.files import write_exr
from glossbench.envmap.lights.catalog_light import CatalogLight
from glossbench.envmap.lights.file_light import FileLight, make_light
from glossbench.envmap.lights.light import LIGHTS
from glossbench.errors import InputError
from glossbench.study.study import load_study

CONTENT = bytes(i * 7919 >> 3 & 255 for i in range(300_000))


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """An empty folder of fetched files, and no other data."""
    for module in (catalog, folders):
        monkeypatch.setattr(module, "cache_folder", lambda: tmp_path / "cache")
    monkeypatch.delenv("GLOSSBENCH_DATA", raising=False)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    return tmp_path / "cache"


# The entries


def test_each_file_of_the_manifest_is_an_entry_as_stated_there(shared_data):
    manifest = yaml.safe_load((shared_data / "MANIFEST.yaml").read_text())
    kinds = {"environments": "environment", "brdfs": "brdf", "meshes": "mesh"}

    stated = {
        (kinds[group], Path(one["file"]).name, one["url"], one["sha256"], one["bytes"], one["licence"])
        for group, listed in manifest.items()
        for one in listed
    }

    assert {(e.kind, e.file, e.url, e.sha256, e.bytes, e.licence) for e in list_entries()} == stated


def test_each_entry_is_found_among_the_data_by_its_hash(shared_data, monkeypatch):
    monkeypatch.setenv("GLOSSBENCH_DATA", str(shared_data))

    missing = [e.name for e in list_entries() if e.find_local() is None]

    assert missing == []


def test_names_are_unique_and_pinned():
    names = [e.name for e in list_entries()]

    assert len(set(names)) == len(names)
    assert all(len(e.sha256) == 64 and e.bytes > 0 and e.stresses and e.licence for e in list_entries())


def test_entries_of_one_kind():
    assert {e.kind for e in list_entries("mesh")} == {"mesh"}
    with pytest.raises(InputError, match=r"^unknown kind 'meshes'; did you mean 'mesh'\?$"):
        list_entries("meshes")


def test_another_file_of_the_same_name_is_not_the_entry(tmp_path, monkeypatch):
    monkeypatch.setenv("GLOSSBENCH_DATA", str(tmp_path))
    (tmp_path / "teapot.obj").write_bytes(b"v 0 0 0")

    assert find_entry("teapot").find_local() is None


# Names as lights


@pytest.fixture
def probe(tmp_path, monkeypatch):
    """One entry, an upside-down image of one lit row, whose file is among the data."""
    image = torch.zeros(8, 16, 3)
    image[7] = 2.0
    (tmp_path / "data").mkdir()
    write_exr(tmp_path / "data" / "probe.exr", image)
    content = (tmp_path / "data" / "probe.exr").read_bytes()
    stated = Entry(
        "grace_cross", "environment", "probe.exr", "http://127.0.0.1:9/probe.exr", hashlib.sha256(content).hexdigest(),
        len(content), "none", "a test", {"projection": "lat_long", "flip_vertical": True, "scale": 3.0},
    )  # fmt: skip
    monkeypatch.setattr(catalog, "list_entries", lambda kind=None: [stated])
    monkeypatch.setenv("GLOSSBENCH_DATA", str(tmp_path / "data"))
    return tmp_path / "data" / "probe.exr"


def test_a_name_is_the_light_of_its_file_read_as_the_catalogue_says(probe):
    by_name = LIGHTS.create("grace_cross", {"resolution": 4})
    by_file = FileLight(file=str(probe), resolution=4, projection="lat_long", flip_vertical=True, scale=3.0)

    assert torch.equal(by_name.cubemap().faces, by_file.cubemap().faces)
    assert by_name.key() == by_file.key()
    up, down = by_name.cubemap().faces[2].mean(), by_name.cubemap().faces[3].mean()
    assert up > 0.5
    assert down == 0


def test_the_key_depends_on_the_bytes_of_the_file(probe, monkeypatch):
    before = LIGHTS.create("grace_cross", {}).key()
    write_exr(probe, torch.ones(8, 16, 3))
    stated = replace(catalog.list_entries()[0], sha256=hashlib.sha256(probe.read_bytes()).hexdigest())
    monkeypatch.setattr(catalog, "list_entries", lambda kind=None: [stated])

    assert LIGHTS.create("grace_cross", {}).key() != before


def test_the_key_depends_on_how_the_file_is_read(probe, monkeypatch):
    before = LIGHTS.create("grace_cross", {}).key()
    stated = replace(catalog.list_entries()[0], reading={"projection": "lat_long"})
    monkeypatch.setattr(catalog, "list_entries", lambda kind=None: [stated])

    assert LIGHTS.create("grace_cross", {}).key() != before


def test_every_environment_is_a_light_and_nothing_else_of_the_catalogue_is():
    lights = {name for name in LIGHTS.names() if issubclass(LIGHTS.get(name), CatalogLight)}

    assert lights == {e.name for e in list_entries("environment")}


@pytest.mark.parametrize("stated", [pytest.param(e, id=e.name) for e in list_entries()])
def test_reading_names_only_options_of_a_file(stated):
    light = FileLight.create({"file": stated.file, **stated.reading})

    assert light.as_dict().items() >= json.loads(json.dumps(stated.reading)).items()


def test_a_reading_that_names_no_option_is_refused():
    with pytest.raises(InputError, match="unknown option 'projektion'; did you mean 'projection'"):
        FileLight.create({"file": "a.hdr", "projektion": "lat_long"})


# Against up, right and forward of the MANIFEST, at 64 texels a face. Measured 3.7e-4, 2.5e-4 and 3.9e-4; 4.3e-3 for
# grace_latlong, which is another file of the light of grace_cross, against whose numbers it stands.
@pytest.mark.parametrize(
    ("name", "tolerance"),
    [("grace_cross", 1e-3), ("rnl_probe", 1e-3), ("grace_cross_dds", 1e-3), ("grace_latlong", 1e-2)],
)
def test_a_light_of_the_catalogue_is_the_right_way_up_and_round(shared_data, monkeypatch, name, tolerance):
    monkeypatch.setenv("GLOSSBENCH_DATA", str(shared_data))
    manifest = yaml.safe_load((shared_data / "MANIFEST.yaml").read_text())
    # Upside down and scaled, it is grace_cross in another projection.
    known = "grace_cross.hdr" if name == "grace_latlong" else find_entry(name).file
    stated = next(e for e in manifest["environments"] if Path(e["file"]).name == known)["irradiance"]

    facts = make_light(name, {"resolution": 64}).facts()

    measured = [facts.irradiance_up, facts.irradiance_right, facts.irradiance_forward]
    expected = [stated[side] for side in ("up", "right", "forward")]
    assert torch.allclose(torch.tensor(measured), torch.tensor(expected), rtol=tolerance, atol=0)


def test_a_file_taken_as_it_is_would_be_upside_down(shared_data, monkeypatch):
    """Twin of the above."""
    monkeypatch.setenv("GLOSSBENCH_DATA", str(shared_data))

    right = make_light("grace_latlong", {"resolution": 64}).facts()
    wrong = make_light("grace_latlong.exr", {"resolution": 64}).facts()

    assert right.irradiance_up[0] > 2 * 127.35 * wrong.irradiance_up[0]


def test_python_takes_the_name(probe):
    light = gb.light("grace_cross", resolution=4)

    assert light.resolution == 4


def test_a_study_takes_the_name_and_its_options(probe, tmp_path):
    (tmp_path / "s.yaml").write_text(
        "title: T\nlight: [grace_cross, {grace_cross: {resolution: [4, 8]}}]\nmaterial: ggx\n"
        "view: {sphere: {resolution: 8}}\nmethods: importance_sampling\n"
    )

    study = load_study(tmp_path / "s.yaml")

    assert [(item.name, item.as_dict()) for item in study.lights] == [
        ("grace_cross", {"resolution": None}), ("grace_cross", {"resolution": 4}), ("grace_cross", {"resolution": 8}),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("teapot", "unknown light 'teapot'; the catalogue has a mesh of this name"),
        ("cayman", "unknown light 'cayman'; the catalogue has a measured or fitted BRDF of this name"),
        ("grace_cros", "unknown light 'grace_cros'; did you mean 'grace_cross'?"),
    ],
)
def test_a_name_that_is_not_a_light_says_what_it_is(tmp_path, name, message):
    text = f"title: T\nlight: {name}\nmaterial: ggx\nview: sphere\nmethods: importance_sampling\n"
    (tmp_path / "s.yaml").write_text(text)

    with pytest.raises(InputError) as python:
        gb.light(name)
    with pytest.raises(InputError) as study:
        load_study(tmp_path / "s.yaml")

    assert str(python.value) == message
    assert str(study.value) == f"{tmp_path / 's.yaml'}:2:8: light: {message}"


def test_a_fetched_file_is_found_by_its_file_name_too(cache):
    cache.mkdir()
    (cache / "grace_cross.hdr").write_bytes(b"#?RADIANCE")

    assert locate("grace_cross.hdr") == cache / "grace_cross.hdr"


# Downloads


class Server:
    """CONTENT over HTTP on the loopback, with the faults that networks have.

    Attributes:
        requests: the Range header of each request, or None.
        cut: after how many bytes of the body each connection breaks; None is never.
        ranges: whether Range is honoured.
        status: instead of the file.
        slow: how many bytes come one at a time, 50 per second.
    """

    def __init__(self) -> None:
        self.requests: list[str | None] = []
        self.content, self.cut, self.ranges, self.status, self.slow = CONTENT, None, True, 200, 0
        self.gate = threading.Event()
        self.gate.set()
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                outer.answer(self)

            def log_message(self, *arguments):
                pass

        self.http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.http.handle_error = lambda *arguments: None  # a client that has gone
        self.url = f"http://127.0.0.1:{self.http.server_port}/folder/file.bin"
        threading.Thread(target=self.http.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True).start()

    def answer(self, handler):
        asked = handler.headers.get("Range")
        self.requests.append(asked)
        self.gate.wait(10)
        if self.status != 200:
            handler.send_error(self.status)
            return
        start = int(asked.removeprefix("bytes=").removesuffix("-")) if asked and self.ranges else 0
        if start >= len(self.content):
            handler.send_error(416)
            return
        body = self.content[start:]
        handler.send_response(206 if start else 200)
        if start:
            handler.send_header("Content-Range", f"bytes {start}-{len(self.content) - 1}/{len(self.content)}")
        handler.send_header("Content-Length", str(len(body)))
        handler.end_headers()
        for i in range(self.slow):
            handler.wfile.write(body[i : i + 1])
            time.sleep(0.02)
        handler.wfile.write(body[self.slow : self.cut])


@pytest.fixture
def server():
    started = Server()
    yield started
    started.http.shutdown()
    started.http.server_close()


def brought(server, target, content=CONTENT, **arguments):
    return download.download(server.url, target, hashlib.sha256(content).hexdigest(), len(content), **arguments)


def names(folder):
    return sorted(path.name for path in folder.iterdir() if path.name != ".lock")


def test_a_file_is_downloaded_whole_with_its_progress(server, tmp_path):
    told = []

    path = brought(server, tmp_path / "new" / "file.bin", progress=told.append)

    assert path.read_bytes() == CONTENT
    assert names(tmp_path / "new") == ["file.bin"]
    assert (told[0], told[-1], told) == (0, len(CONTENT), sorted(told))


def test_a_download_that_is_too_slow_is_stopped(server, tmp_path, monkeypatch):
    monkeypatch.setattr(download, "PATIENCE", 0.2)
    server.slow = 1000

    with pytest.raises(InputError, match=r"is too slow: it sent \d+ bytes in 0 s, and the file has 300000; the same "):
        brought(server, tmp_path / "file.bin")
    have = (tmp_path / "file.bin.part").stat().st_size
    server.slow = 0
    brought(server, tmp_path / "file.bin")

    assert 0 < have < 100
    assert server.requests[1] == f"bytes={have}-"
    assert (tmp_path / "file.bin").read_bytes() == CONTENT


def test_a_slow_moment_of_a_server_is_waited_for(server, tmp_path, monkeypatch):
    """Twin of the above: the mean over the time of patience counts."""
    monkeypatch.setattr(download, "PATIENCE", 5.0)
    server.slow = 10

    assert brought(server, tmp_path / "file.bin").read_bytes() == CONTENT


def test_a_file_that_exists_is_not_downloaded(server, tmp_path):
    (tmp_path / "file.bin").write_bytes(CONTENT)

    brought(server, tmp_path / "file.bin")

    assert server.requests == []


def test_a_broken_download_continues_where_it_stopped(server, tmp_path):
    server.cut = 25 * download.BLOCK
    with pytest.raises(InputError, match=r"^127.0.0.1:\d+ broke off after 102400 of 300000 bytes; the same command"):
        brought(server, tmp_path / "file.bin")
    assert names(tmp_path) == ["file.bin.part"]
    server.cut = None

    brought(server, tmp_path / "file.bin")

    assert server.requests == [None, "bytes=102400-"]
    assert (tmp_path / "file.bin").read_bytes() == CONTENT
    assert names(tmp_path) == ["file.bin"]


def test_a_download_that_breaks_again_and_again_arrives(server, tmp_path):
    server.cut = 17 * download.BLOCK
    for _ in range(4):
        with pytest.raises(InputError, match="broke off"):
            brought(server, tmp_path / "file.bin")

    brought(server, tmp_path / "file.bin")

    assert server.requests == [None, *(f"bytes={n * server.cut}-" for n in (1, 2, 3, 4))]
    assert (tmp_path / "file.bin").read_bytes() == CONTENT


def test_a_part_that_is_complete_is_only_verified(server, tmp_path):
    (tmp_path / "file.bin.part").write_bytes(CONTENT)

    brought(server, tmp_path / "file.bin")

    assert server.requests == []
    assert names(tmp_path) == ["file.bin"]


def test_a_download_from_a_server_that_ignores_ranges_starts_again(server, tmp_path):
    (tmp_path / "file.bin.part").write_bytes(CONTENT[:100])
    server.ranges = False

    brought(server, tmp_path / "file.bin")

    assert server.requests == ["bytes=100-"]
    assert (tmp_path / "file.bin").read_bytes() == CONTENT


def test_a_whole_file_appended_to_a_part_would_be_noticed(server, tmp_path, monkeypatch):
    """Twin of the above: an answer of the whole file that is taken for the rest."""
    (tmp_path / "file.bin.part").write_bytes(CONTENT[:100])
    server.ranges = False
    plain = download.requests.get

    def get(*arguments, **options):
        answer = plain(*arguments, **options)
        answer.status_code, answer.headers["Content-Range"] = 206, "bytes 100-299999/300000"
        return answer

    monkeypatch.setattr(download.requests, "get", get)

    with pytest.raises(InputError, match="its sha256 differs"):
        brought(server, tmp_path / "file.bin")


def test_other_bytes_are_thrown_away_and_said_so(server, tmp_path):
    server.content = CONTENT[::-1]

    with pytest.raises(InputError, match=r"file.bin is not the file of the catalogue: its sha256 differs; nothing"):
        brought(server, tmp_path / "file.bin")

    assert names(tmp_path) == []


def test_a_part_of_another_file_is_thrown_away_and_the_next_try_succeeds(server, tmp_path):
    (tmp_path / "file.bin.part").write_bytes(b"other" * 100)
    with pytest.raises(InputError, match="its sha256 differs"):
        brought(server, tmp_path / "file.bin")

    brought(server, tmp_path / "file.bin")

    assert server.requests == ["bytes=500-", None]


def test_a_part_longer_than_the_server_s_file_starts_again(server, tmp_path):
    (tmp_path / "file.bin.part").write_bytes(CONTENT[:5000])
    server.content = CONTENT[:4000]

    with pytest.raises(InputError, match="broke off after 4000 of 300000 bytes"):
        brought(server, tmp_path / "file.bin")

    assert server.requests == ["bytes=5000-", None]


def test_no_more_is_taken_than_the_catalogue_says(server, tmp_path):
    server.content = CONTENT * 10

    with pytest.raises(InputError, match="its sha256 differs"):
        brought(server, tmp_path / "file.bin")

    assert names(tmp_path) == []


def test_a_missing_file_is_one_line_with_the_status(server, tmp_path):
    server.status = 404

    with pytest.raises(InputError) as error:
        brought(server, tmp_path / "file.bin")

    assert str(error.value) == (
        f"{download.host(server.url)} answers 404 Not Found for {server.url}; the file may be put into {tmp_path} as "
        "file.bin by hand, or a folder that has it named by GLOSSBENCH_DATA"
    )
    assert names(tmp_path) == []


def test_a_refused_connection_is_one_line_with_a_way_out(tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]

    with pytest.raises(InputError) as error:
        download.download(f"http://127.0.0.1:{port}/file.bin", tmp_path / "file.bin", "0" * 64, 10)

    assert str(error.value) == (
        f"cannot reach 127.0.0.1:{port}: Connection refused; the file may be put into {tmp_path} as file.bin by hand, "
        "or a folder that has it named by GLOSSBENCH_DATA"
    )
    assert names(tmp_path) == []


def test_a_download_from_a_server_that_does_not_answer_is_stopped(server, tmp_path, monkeypatch):
    monkeypatch.setattr(download, "TIMEOUT", (1.0, 0.05))
    server.gate.clear()

    with pytest.raises(InputError, match=r"^cannot reach 127.0.0.1:\d+: no answer in time; "):
        brought(server, tmp_path / "file.bin")

    server.gate.set()


def test_a_folder_that_cannot_be_written_is_one_line(server, tmp_path):
    (tmp_path / "file").touch()

    with pytest.raises(InputError, match=r"^cannot write to .*/file/below: Not a directory$"):
        brought(server, tmp_path / "file" / "below" / "file.bin")


def test_two_at_once_fetch_once(server, tmp_path):
    server.gate.clear()
    found = []
    threads = [threading.Thread(target=lambda: found.append(brought(server, tmp_path / "file.bin"))) for _ in range(2)]
    for thread in threads:
        thread.start()
    server.gate.set()
    for thread in threads:
        thread.join()

    assert [path.read_bytes() == CONTENT for path in found] == [True, True]
    assert server.requests == [None]
    assert names(tmp_path) == ["file.bin"]


def test_an_entry_is_fetched_into_the_cache_and_reported(server, cache, monkeypatch, caplog):
    stated = replace(
        find_entry("teapot"), url=server.url, sha256=hashlib.sha256(CONTENT).hexdigest(), bytes=len(CONTENT)
    )
    monkeypatch.setattr(catalog, "list_entries", lambda kind=None: [stated])

    path = fetch("teapot")

    assert path == cache / "teapot.obj"
    assert stated.find_local() == path
    assert caplog.messages == [f"teapot.obj is not here: fetching 0.3 MB from {download.host(server.url)}"]
    fetch("teapot")
    assert len(server.requests) == len(caplog.messages) == 1


def test_an_unknown_entry_offers_the_nearest():
    with pytest.raises(InputError, match=r"^the catalogue has no 'teapott'; did you mean 'teapot'\?$"):
        fetch("teapott")


def test_the_catalogue_as_json_is_plain_data():
    assert json.loads(json.dumps([e.reading for e in list_entries()])) == [e.reading for e in list_entries()]
