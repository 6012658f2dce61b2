"""Broken images of every format: one line that says what, within bounded memory, and no file left over."""

import os
import resource
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest
from skimage.io import imsave

from glossbench.envmap.formats.files import read_image
from glossbench.errors import InputError

PIXELS = np.random.default_rng(1).random((8, 16, 3), dtype=np.float32) + 0.5
HDR = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n"


def dds(width: int = 8, height: int = 8, n_levels: int = 0, fourcc: int = 116, caps: int = 0xFE00) -> bytes:
    return struct.pack("<4s7I44x2I4s5I4I4x", b"DDS ", 124, 0x1007 | (0x20000 if n_levels else 0), height, width, 0, 0,
                       n_levels, 32, 4, struct.pack("<I", fourcc), 0, 0, 0, 0, 0, 0x1008, caps, 0, 0)  # fmt: skip


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def sound(here) -> dict[str, bytes]:
    """A small sound image of each format, by name."""
    planes = {name: np.ascontiguousarray(PIXELS[..., i]) for i, name in enumerate("RGB")}
    for name, compression in (("zip.exr", OpenEXR.ZIP_COMPRESSION), ("raw.exr", OpenEXR.NO_COMPRESSION)):
        OpenEXR.File({"compression": compression, "type": OpenEXR.scanlineimage}, planes).write(name)
    output = oiio.ImageOutput.create("planes.hdr")
    output.open("planes.hdr", oiio.ImageSpec(16, 8, 3, oiio.FLOAT))
    output.write_image(PIXELS)
    output.close()
    Path("flat.hdr").write_bytes(HDR + b"ab\3\x80" * 128)
    Path("small.pfm").write_bytes(b"PF\n16 8\n-1.0\n" + PIXELS.tobytes())
    Path("small.dds").write_bytes(dds() + np.ones((6, 8, 8, 4), np.float32).tobytes())
    imsave("small.png", (PIXELS * 100).astype(np.uint8), check_contrast=False)
    made = {path.name: path.read_bytes() for path in Path().iterdir()}
    for name in made:
        Path(name).unlink()
    return made


NAMES = ["zip.exr", "raw.exr", "planes.hdr", "flat.hdr", "small.pfm", "small.dds", "small.png"]


def refusal(name: str, content: bytes | None = None) -> str:
    """The one line that refuses a file, which is alone in the folder before and after."""
    if content is not None:
        Path(name).write_bytes(content)
    before = sorted(os.listdir())
    with pytest.raises(InputError) as caught:
        read_image(name, ldr=True)
    message = str(caught.value)
    assert message.startswith(f"{name}: ")
    assert "\n" not in message
    assert len(message) < 400
    assert sorted(os.listdir()) == before
    return message


@pytest.mark.parametrize("name", NAMES)
def test_a_sound_image_loads(sound, name):
    Path(name).write_bytes(sound[name])

    assert read_image(name, ldr=True).shape == ((48, 8, 3) if name == "small.dds" else (8, 16, 3))


# Of the file: nothing, in the magic, in the header, about its end, in the first row, in the middle, near the end.
CUTS = (0, 2, 5, 0.02, 0.05, 0.08, 0.1, 0.15, 0.2, 0.3, 0.5, 0.7, 0.9)


@pytest.mark.parametrize("cut", [*CUTS, -2, -1])
@pytest.mark.parametrize("name", [name for name in NAMES if name != "small.png"])
def test_an_image_cut_short_is_refused(sound, name, cut):
    content = sound[name]
    end = int(cut * len(content)) if isinstance(cut, float) else cut

    message = refusal(name, content[:end])

    assert "is truncated or damaged" in message or "is not" in message or "is empty (0 bytes)" in message


@pytest.mark.parametrize("cut", [5, 0.1, 0.3, 0.5, 0.9])
def test_a_png_cut_short_is_refused(sound, cut):
    content = sound["small.png"]

    refusal("small.png", content[: int(cut * len(content)) if isinstance(cut, float) else cut])


@pytest.mark.parametrize("name", NAMES)
def test_noise_behind_a_good_beginning_is_refused(sound, name):
    noise = np.random.default_rng(2).bytes(5000)

    for n in (4, 12, 40):
        refusal(name, sound[name][:n] + noise)


OTHERS = [(name, other) for name in NAMES for other in (".exr", ".hdr", ".pfm", ".dds", ".png", ".jpg", ".tif")
          if not name.endswith(other)]  # fmt: skip


@pytest.mark.parametrize(("name", "other"), OTHERS)
def test_an_image_under_another_extension_is_refused(sound, name, other):
    assert "is not a" in refusal(f"other{other}", sound[name])


def exr_of(size: tuple[int, int, int, int], sound: dict[str, bytes]) -> bytes:
    """The sound EXR with other windows."""
    content = sound["raw.exr"]
    for window in (b"dataWindow\0box2i\0", b"displayWindow\0box2i\0"):
        at = content.index(window) + len(window) + 4
        content = content[:at] + struct.pack("<4i", *size) + content[at + 16 :]
    return content


def png_of(width: int, height: int, sound: dict[str, bytes]) -> bytes:
    """The sound PNG with another size."""
    return sound["small.png"][:16] + struct.pack(">2I", width, height) + sound["small.png"][24:]


CLAIMS = {
    "hdr of 1e6 x 1e6": ("a.hdr", lambda s: HDR.replace(b"8 +X 16", b"1000000 +X 1000000") + b"a" * 99, "1000000"),
    "hdr of 16000 x 16000": ("a.hdr", lambda s: HDR.replace(b"-Y 8 +X 16", b"-Y 16000 +X 16000") + b"\2\2\x3e\x80" * 9,
                             "16000"),
    "hdr of 0 rows": ("a.hdr", lambda s: HDR.replace(b"-Y 8", b"-Y 0") + b"a" * 99, "at least 1x1"),
    "hdr of -8 rows": ("a.hdr", lambda s: HDR.replace(b"-Y 8", b"-Y -8") + b"a" * 99, "size"),
    "hdr of 1e30 rows": ("a.hdr", lambda s: HDR.replace(b"-Y 8", b"-Y 1" + b"0" * 30) + b"a" * 99, "size"),
    "hdr of two rows": ("a.hdr", lambda s: HDR.replace(b"+X", b"+Y") + b"a" * 600, "size"),
    "hdr without an end": ("a.hdr", lambda s: b"#?RADIANCE\n" + b"A=" * 100_000, "header does not end"),
    "exr of 1e6 x 1e6": ("a.exr", lambda s: exr_of((0, 0, 999_999, 999_999), s), ""),
    "exr of 16000 x 16000": ("a.exr", lambda s: exr_of((0, 0, 15_999, 15_999), s), ""),
    "exr of 0 rows": ("a.exr", lambda s: exr_of((0, 0, 15, -1), s), ""),
    "exr of negative rows": ("a.exr", lambda s: exr_of((0, 0, 15, -9), s), ""),
    "exr that overflows": ("a.exr", lambda s: exr_of((-(2**31), -(2**31), 2**31 - 1, 2**31 - 1), s), ""),
    "pfm of 1e6 x 1e6": ("a.pfm", lambda s: b"PF\n1000000 1000000\n-1.0\n" + b"a" * 99, "1000000 x 1000000"),
    "pfm of 16000 x 16000": ("a.pfm", lambda s: b"PF\n16000 16000\n-1.0\n" + b"a" * 99, "99 of 3072000000 bytes"),
    "pfm of 0 columns": ("a.pfm", lambda s: b"PF\n0 8\n-1.0\n" + b"a" * 99, "at least 1x1"),
    "pfm of -16 columns": ("a.pfm", lambda s: b"PF\n-16 8\n-1.0\n" + b"a" * 99, "no header"),
    "pfm of scale 0": ("a.pfm", lambda s: b"PF\n1 1\n0\n" + b"a" * 99, "scale"),
    "pfm of scale NaN": ("a.pfm", lambda s: b"PF\n1 1\nnan\n" + b"a" * 99, "no header"),
    "pfm of scale 1e999": ("a.pfm", lambda s: b"PF\n1 1\n1e999\n" + b"a" * 99, "scale"),
    "dds of 1e6 x 1e6": ("a.dds", lambda s: dds(1_000_000, 1_000_000) + b"a" * 99, "1000000"),
    "dds of 6000 x 6000": ("a.dds", lambda s: dds(6000, 6000) + b"a" * 99, "99 of 3456000000 bytes"),
    "dds of 0 rows": ("a.dds", lambda s: dds(8, 0) + b"a" * 9999, "at least 1x1"),
    "dds of 2^32 - 1 rows": ("a.dds", lambda s: dds(8, 2**32 - 1) + b"a" * 9999, ""),
    "dds not square": ("a.dds", lambda s: dds(8, 4) + b"a" * 9999, "square"),
    "dds of 2^32 - 1 levels": ("a.dds", lambda s: dds(8, 8, 2**32 - 1) + b"a" * 9999, "MIP levels"),
    "dds that is no cube": ("a.dds", lambda s: dds(caps=0) + b"a" * 9999, "cube map"),
    "dds of an unknown format": ("a.dds", lambda s: dds(fourcc=77) + b"a" * 9999, "77"),
    "png of 1e6 x 1e6": ("a.png", lambda s: png_of(10**6, 10**6, s), ""),
    "png of 0 columns": ("a.png", lambda s: png_of(0, 8, s), ""),
}  # fmt: skip


@pytest.mark.parametrize("claim", CLAIMS)
def test_a_header_that_claims_too_much_or_nothing_is_refused_before_it_takes_memory(sound, claim):
    name, make, words = CLAIMS[claim]
    content = make(sound)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    message = refusal(name, content)

    assert words in message
    # Kilobytes. Measured at most 128; 16000 x 16000 pixels are 3 GB.
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000


def spoilt(name: str, sound: dict[str, bytes], value: float) -> bytes:
    """A sound image of floats, one of them replaced."""
    content, size = sound[name], 4 * (6 * 8 * 8 * 4 if name == "small.dds" else 8 * 16 * 3)
    at = len(content) - size
    return content[:at] + struct.pack("<f", value) + content[at + 4 :]


@pytest.mark.parametrize("name", ["small.pfm", "small.dds"])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf"), -1.0])
def test_invalid_radiance_is_refused(sound, name, value):
    rule = "not negative" if value == -1 else "finite"

    assert f"radiance must be {rule}, but 1 pixels are not" in refusal(name, spoilt(name, sound, value))


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1.0])
def test_invalid_radiance_is_refused_in_an_exr(here, value):
    planes = {name: np.ascontiguousarray(PIXELS[..., i]) for i, name in enumerate("RGB")}
    planes["G"][3, 2] = value
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, planes).write("a.exr")

    assert "at row 3, column 2" in refusal("a.exr")


@pytest.mark.skipif(os.name != "posix", reason="pipes and links of POSIX")
@pytest.mark.parametrize("suffix", [".exr", ".hdr", ".pfm", ".dds", ".png"])
@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda name: None, "no such file"),
        (os.mkdir, "is a folder"),
        (os.mkfifo, "is a device or a pipe"),
        (lambda name: os.symlink(name, name), ""),
        (lambda name: os.symlink("/dev/zero", name), "is a device or a pipe"),
        (lambda name: os.symlink("gone", name), "no such file"),
    ],
    ids=["missing", "folder", "pipe", "loop of links", "device", "dangling link"],
)
def test_what_is_not_a_file_is_refused_at_once(here, suffix, make, words):
    make(f"a{suffix}")

    assert words in refusal(f"a{suffix}")


def test_a_light_that_is_broken_is_one_line_on_the_command_line(sound):
    Path("a.exr").write_bytes(sound["zip.exr"][:300])
    study = "title: T\nlight: a.exr\nmaterial: {ggx: {alpha: 0.5}}\nview: sphere\nmethods: importance_sampling\n"
    Path("my.yaml").write_text(study)

    main = [sys.executable, "-c", "from glossbench.commands.cli import main; main()", "run", "my.yaml"]
    done = subprocess.run(main, capture_output=True, text=True, timeout=120)

    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: ")
    assert "a.exr: is truncated or damaged as an OpenEXR image" in done.stderr
    assert done.stderr.count("\n") == 1
    assert sorted(os.listdir()) == ["a.exr", "my.yaml"]
