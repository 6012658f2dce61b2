"""Files: what is written comes back, and every damaged file is one clear line."""

import re
import struct
from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest
import torch

from glossbench.envmap import files
from glossbench.envmap.files import read_image, write_exr
from glossbench.errors import InputError

HDR_HEADER = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n"


def an_image(height=6, width=16, channels=3):
    generator = torch.Generator().manual_seed(3)
    image = torch.rand(height, width, channels, generator=generator) * 100
    image[:, 4:12] = 0.5  # runs, so that run-length coding has something to do
    return image


def write_hdr(path, image):
    out = oiio.ImageOutput.create(str(path))
    out.open(str(path), oiio.ImageSpec(image.shape[1], image.shape[0], 3, "float"))
    out.write_image(image.numpy())
    out.close()
    return path


def flat_hdr(path, resolution=b"-Y 2 +X 3", n_pixels=6):
    """Pixels without run-length coding: pixel i is grey, (10 i + 1) / 128 times 1.28."""
    rgbe = np.full((n_pixels, 4), 129, np.uint8)
    rgbe[:, :3] = (np.arange(n_pixels) * 10 + 1)[:, None]
    path.write_bytes(HDR_HEADER + resolution + b"\n" + rgbe.tobytes())
    return path


def write_planes(path, planes):
    OpenEXR.File({"type": OpenEXR.scanlineimage}, planes).write(str(path))
    return path


def accepted_cuts(path, data, reader):
    """Lengths at which the file, cut short, is read without an error."""
    accepted = []
    for n_bytes in range(len(data)):
        path.write_bytes(data[:n_bytes])
        try:
            reader(path)
        except InputError:
            continue
        accepted.append(n_bytes)
    return accepted


def test_an_exr_comes_back_bit_for_bit(tmp_path):
    image = an_image()

    write_exr(tmp_path / "a.exr", image)

    back = read_image(tmp_path / "a.exr")
    assert back.dtype == torch.float32
    assert torch.equal(back, image)


def test_an_hdr_comes_back_within_its_eight_bit_mantissa(tmp_path):
    image = an_image()

    back = read_image(write_hdr(tmp_path / "a.hdr", image))

    # A shared exponent: at most 1/256 of a pixel's largest channel, twice that where it truncates.
    assert ((back - image).abs() <= image.amax(2, keepdim=True) / 128).all()


def test_the_same_image_gives_the_same_bytes(tmp_path):
    image = an_image()

    write_exr(tmp_path / "a.exr", image)
    write_exr(tmp_path / "b.exr", image)

    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()


def test_writing_replaces_the_file_and_leaves_nothing_beside_it(tmp_path):
    write_exr(tmp_path / "a.exr", torch.zeros(4, 4, 3))

    write_exr(tmp_path / "a.exr", torch.ones(4, 4, 3))

    assert [p.name for p in tmp_path.iterdir()] == ["a.exr"]
    assert read_image(tmp_path / "a.exr").min() == 1


def test_a_write_that_fails_leaves_the_old_file_whole(tmp_path, monkeypatch):
    write_exr(tmp_path / "a.exr", torch.ones(4, 4, 3))

    def break_off(self, name):
        Path(name).write_bytes(b"half")
        raise RuntimeError("disk full")

    monkeypatch.setattr(OpenEXR.File, "write", break_off)

    with pytest.raises(InputError, match="disk full"):
        write_exr(tmp_path / "a.exr", torch.zeros(4, 4, 3))
    assert [p.name for p in tmp_path.iterdir()] == ["a.exr"]
    assert read_image(tmp_path / "a.exr").min() == 1


def test_channels_have_their_names(tmp_path):
    image = an_image(channels=2)

    write_exr(tmp_path / "a.exr", image, channels=("mean", "error"))

    with OpenEXR.File(str(tmp_path / "a.exr")) as file:
        assert np.array_equal(file.channels()["error"].pixels, image[..., 1].numpy())


def test_half_floats_are_read_as_float32(tmp_path):
    half = an_image().half().numpy()

    write_planes(tmp_path / "a.exr", {c: half[..., i].copy() for i, c in enumerate("RGB")})

    assert torch.equal(read_image(tmp_path / "a.exr"), torch.from_numpy(half).float())


def test_channels_beyond_rgb_are_dropped_whatever_their_order(tmp_path):
    image = an_image(channels=5)

    write_exr(tmp_path / "a.exr", image, channels=("A", "depth.Z", "B", "G", "R"))

    assert torch.equal(read_image(tmp_path / "a.exr"), image[..., [4, 3, 2]])


def test_one_channel_becomes_three(tmp_path):
    image = an_image(channels=1)

    write_exr(tmp_path / "a.exr", image, channels=("Y",))

    assert torch.equal(read_image(tmp_path / "a.exr"), image.expand(-1, -1, 3))


@pytest.mark.parametrize(
    ("resolution", "first_row"),
    [
        (b"-Y 2 +X 3", [0, 1, 2]),
        (b"-Y 2 -X 3", [2, 1, 0]),
        (b"+Y 2 -X 3", [5, 4, 3]),
        (b"+Y 2 +X 3", [3, 4, 5]),
    ],
)
def test_the_scan_order_that_an_hdr_names_is_undone(tmp_path, resolution, first_row):
    path = flat_hdr(tmp_path / "a.hdr", resolution)

    image = read_image(path)

    assert image.shape == (2, 3, 3)
    assert (image[0, :, 0] * 12.8).floor().tolist() == first_row


@pytest.mark.parametrize("coding", ["rle.hdr", "flat.hdr", "float.exr", "half.exr"])
def test_a_file_cut_short_anywhere_is_refused(tmp_path, coding):
    path = tmp_path / coding
    if coding == "rle.hdr":
        write_hdr(path, an_image())
    elif coding == "flat.hdr":
        flat_hdr(path)
    elif coding == "float.exr":
        write_exr(path, an_image())
    else:
        write_planes(path, {c: an_image(6, 8)[..., 0].half().numpy() for c in "RGB"})

    accepted = accepted_cuts(path, path.read_bytes(), read_image)

    assert accepted == []


def test_the_truncation_check_notices_a_reader_that_accepts_what_there_is(tmp_path):
    path = flat_hdr(tmp_path / "a.hdr")

    def forgiving(path):
        try:
            return read_image(path)
        except InputError as error:
            if "on scanline" not in str(error):
                raise

    assert accepted_cuts(path, path.read_bytes(), forgiving) != []


def with_data_window(path, *corners):
    """The EXR with another data window in its header."""
    data = write_planes(path, {"Y": np.ones((6, 16), np.float32)}).read_bytes()
    at = data.index(b"dataWindow\0box2i\0") + 21
    path.write_bytes(data[:at] + struct.pack("<4i", *corners) + data[at + 16 :])


def valued(path, *values):
    image = torch.ones(3, 4, 3)
    for i, value in enumerate(values):
        image[1, 2 + i, 1] = value
    write_exr(path, image)


@pytest.mark.parametrize(
    ("name", "make", "message"),
    [
        ("a.hdr", lambda p: None, "no such file"),
        ("a.exr", lambda p: None, "no such file"),
        ("a.exr", lambda p: p.mkdir(), "must be an image file, is a folder"),
        ("a.hdr", lambda p: p.write_bytes(b""), r"is empty \(0 bytes\)"),
        ("a.png", lambda p: p.write_bytes(b"x"), r"unknown extension '.png'; known: .hdr, .exr"),
        ("light", lambda p: p.write_bytes(b"x"), "unknown extension ''; known"),
        ("a.hdr", lambda p: p.write_bytes(b"\x89PNG\r\n\x1a\n" * 9), r"not a Radiance HDR image: .*PNG"),
        ("a.exr", lambda p: p.write_bytes(b"\xff\xd8\xff\xe0" * 9), "not an OpenEXR image"),
        ("a.exr", flat_hdr, r"not an OpenEXR image: .*#\?RADIAN"),
        (
            "a.hdr",
            lambda p: p.write_bytes(b"#?RADIANCE\n" + b"x\n" * 99),
            "truncated or damaged as a Radiance",
        ),
        ("a.hdr", lambda p: flat_hdr(p, b"-Y 0 +X 0"), "damaged.*at least 1x1.*0x0"),
        ("a.hdr", lambda p: flat_hdr(p, b"-Y -2 +X 3"), "damaged.*at least 1x1"),
        ("a.hdr", lambda p: flat_hdr(p, b"-Y 60000 +X 60000"), "damaged.*(claims|exceeds)"),
        ("a.hdr", lambda p: flat_hdr(p, b"+X 3 -Y 2"), "must be stored row by row"),
        ("a.exr", lambda p: with_data_window(p, 0, 0, -1, -1), "damaged.*data window"),
        ("a.exr", lambda p: with_data_window(p, 0, 0, 16384, 16384), "damaged.*claims"),
        ("a.exr", lambda p: with_data_window(p, 0, 0, 999999, 999999), "damaged.*exceeds"),
        (
            "a.exr",
            lambda p: valued(p, float("nan")),
            "finite, but 1 pixels are not, first at row 1, column 2: nan",
        ),
        ("a.exr", lambda p: valued(p, float("inf"), float("-inf")), "finite, but 2 pixels .* column 2: inf"),
        ("a.exr", lambda p: valued(p, -0.5), "not negative, but 1 pixels are not, .*column 2: -0.5"),
    ],
)
def test_a_bad_file_is_one_clear_line(tmp_path, capfd, name, make, message):
    path = tmp_path / name
    make(path)

    with pytest.raises(InputError, match=message) as raised:
        read_image(path)

    assert str(raised.value).startswith(f"{path}: ")
    assert "\n" not in str(raised.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("name", "image", "channels", "message"),
    [
        ("a.hdr", torch.ones(2, 2, 3), ("R", "G", "B"), "extension must be .exr, got '.hdr'"),
        ("a.exr", torch.ones(2, 2), ("Y",), r"need an image \(H, W, 1\), got \(2, 2\)"),
        ("a.exr", torch.ones(2, 2, 3), ("R", "G"), r"need an image \(H, W, 2\), got \(2, 2, 3\)"),
        ("a.exr", torch.ones(0, 2, 3), ("R", "G", "B"), r"got \(0, 2, 3\)"),
        (
            "nowhere/a.exr",
            torch.ones(2, 2, 3),
            ("R", "G", "B"),
            "cannot be written: No such file or directory",
        ),
    ],
)
def test_what_cannot_be_written_is_one_clear_line(tmp_path, name, image, channels, message):
    with pytest.raises(InputError, match=f"^{re.escape(str(tmp_path / name))}: .*{message}"):
        write_exr(tmp_path / name, image, channels)


def test_more_pixels_than_the_limit_are_refused_before_they_are_read(tmp_path, monkeypatch):
    write_exr(tmp_path / "a.exr", torch.ones(6, 16, 3))
    monkeypatch.setattr(files, "_MAX_PIXELS", 95)

    with pytest.raises(InputError, match="must have at most 95 pixels, its header claims 16 x 6"):
        read_image(tmp_path / "a.exr")


def test_damaged_bytes_never_do_worse_than_an_input_error(tmp_path):
    generator = np.random.default_rng(5)
    paths = [write_hdr(tmp_path / "a.hdr", an_image()), tmp_path / "a.exr"]
    write_exr(paths[1], an_image())

    for path in paths:
        whole = np.frombuffer(path.read_bytes(), np.uint8)
        for _ in range(200):
            damaged = whole.copy()
            damaged[generator.integers(0, len(whole), 3)] = generator.integers(0, 256, 3)
            path.write_bytes(damaged.tobytes())
            try:
                outcome = read_image(path)
            except InputError as error:
                outcome = str(error)
            assert "\n" not in outcome if isinstance(outcome, str) else torch.isfinite(outcome).all()
