"""What does not fit into memory is refused by numbers, before it is allocated."""

import os
import resource
import struct
import subprocess
import sys

import numpy as np
import pytest

from glossbench import memory
from glossbench.envmap.formats import dds, hdr, pfm
from glossbench.envmap.formats.files import read_file
from glossbench.envmap.lights.file_light import make_light
from glossbench.errors import InputError
from glossbench.memory import check_memory, read_available, read_capacity
from glossbench.scene.mesh_view import MeshView
from glossbench.scene.sphere import Sphere
from glossbench.scene.virtual_cube import VirtualCube

GB = 10**9


@pytest.fixture
def small_machine(monkeypatch):
    """4 GB are free."""
    monkeypatch.setattr(memory, "read_available", lambda: 4 * GB)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: make_light("sky", {"resolution": 8192}),
         r"sky.resolution: a cube of 6 x 8192 x 8192 texels needs about 36.2 GB of memory, 4.0 GB are available"),
        (lambda: make_light("constant", {"resolution": 4096}), "constant.resolution: .* needs about 9.1 GB"),
        (lambda: make_light("a.hdr", {"resolution": 8192}), "file.resolution: .* needs about 36.2 GB"),
        (lambda: Sphere(resolution=8192), "sphere: a view of 8192 x 8192 pixels needs about 26.8 GB"),
        (lambda: Sphere(resolution=4096, width=8192), "view of 8192 x 4096 pixels"),
        (lambda: MeshView(resolution=8192), "mesh: a view of 8192 x 8192 pixels needs about 26.8 GB"),
        (lambda: VirtualCube(edge=24), "virtual_cube: a view of 3456 x 3456 pixels needs about 4.8 GB"),
    ],
)  # fmt: skip
def test_a_size_that_does_not_fit_is_one_line_with_the_numbers(small_machine, make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_what_fits_is_let_through_and_a_system_that_says_nothing_refuses_nothing(monkeypatch, small_machine):
    check_memory("this", 4 * GB)
    with pytest.raises(InputError, match=r"this needs about 4.1 GB of memory, 4.0 GB are"):
        check_memory("this", 4 * GB + GB // 10)

    monkeypatch.setattr(memory, "read_available", lambda: None)

    check_memory("this", 400 * GB)


HEADERS = {
    "a.hdr": b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8192 +X 8192\n",
    "a.pfm": b"PF\n8192 8192\n-1\n",
    "a.dds": struct.pack("<4s7I44x2I4s5I4I4x", b"DDS ", 124, 0x1007, 4096, 4096, 0, 0, 0, 32, 4,
                         struct.pack("<I", 116), 0, 0, 0, 0, 0, 0x1008, 0xFE00, 0, 0),
}  # fmt: skip


def sparse(path, n_bytes=3 * GB):
    """A sound header, and zeros that take no room on the disk."""
    path.write_bytes(HEADERS[path.name])
    os.truncate(path, n_bytes)
    return path


@pytest.mark.parametrize("name", HEADERS)
def test_a_large_image_is_refused_before_its_pixels_are_read(small_machine, tmp_path, name):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    with pytest.raises(InputError, match=f"{name}: an image of .* pixels needs about .* GB of memory, 4.0 GB are"):
        read_file(sparse(tmp_path / name))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kilobytes


@pytest.mark.parametrize("name", HEADERS)
def test_only_the_image_is_read_of_a_file_that_is_larger(tmp_path, name):
    small = HEADERS[name].replace(b"8192", b"0064").replace(struct.pack("<I", 4096), struct.pack("<I", 64))
    path = tmp_path / name
    path.write_bytes(small)
    os.truncate(path, 3 * GB)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    image = read_file(path).image

    assert image.shape[1] == 64
    assert not image.any()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000


def test_five_pixels_cannot_be_8192_lines(tmp_path):
    path = tmp_path / "a.hdr"
    path.write_bytes(HEADERS["a.hdr"] + bytes([9, 9, 200, 129, *[1, 1, 1, 255] * 4])[: 71 - len(HEADERS["a.hdr"])])

    with pytest.raises(InputError, match="too few bytes for the 8192 x 8192 pixels that its header claims: 20"):
        read_file(path)


def test_the_smallest_limit_counts(monkeypatch, tmp_path):
    group = tmp_path / "a" / "b"
    group.mkdir(parents=True)
    for folder, limit in ((group, "max"), (group.parent, "5000")):
        (folder / "memory.max").write_text(f"{limit}\n")
        (folder / "memory.current").write_text("3000\n")
        (folder / "memory.stat").write_text("anon 1\ninactive_file 500\n")
    lines = memory._read_lines
    monkeypatch.setattr(memory, "_CGROUPS", tmp_path)
    monkeypatch.setattr(memory, "_read_lines", lambda p: ["0::/a/b"] if p.name == "cgroup" else lines(p))

    assert read_available() == 5000 - 3000 + 500
    assert read_capacity() == 5000


def test_a_limit_on_the_address_space_counts():
    code = (
        "import resource; resource.setrlimit(resource.RLIMIT_AS, (3 * 10**9,) * 2)\n"
        "from glossbench.memory import read_available; print(read_available())"
    )

    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert 2.5 * GB < int(done.stdout) < 3 * GB


def test_readers_agree_with_arrays_of_the_file(tmp_path):
    values = np.random.default_rng(0).random((4, 6, 3), dtype=np.float32)
    (tmp_path / "a.pfm").write_bytes(b"PF 6 4 -2.5\n" + values.tobytes() + b"more")

    assert np.array_equal(read_file(tmp_path / "a.pfm").image, values[::-1] * np.float32(2.5))
    assert {hdr.KIND, pfm.KIND, dds.KIND} == {"a Radiance HDR image", "a portable float map", "a DDS cube map"}
