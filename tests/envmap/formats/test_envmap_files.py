"""Files: what is written comes back, and every damaged file is one clear line."""

import re
import struct
from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest
import torch
from PIL import Image

from glossbench.envmap.formats import refusals
from glossbench.envmap.formats.files import read_image, read_pixels, write_exr
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
    """Lengths at which the file, cut short, is read without an error.

    It is cut at each byte of its header and of its end, and at each seventh between.
    """
    accepted = []
    for n_bytes in (n for n in range(len(data)) if n < 128 or n % 7 == 0 or n >= len(data) - 32):
        path.write_bytes(data[:n_bytes])
        try:
            reader(path)
        except InputError:
            continue
        accepted.append(n_bytes)
    return accepted


def test_an_exr_is_read_as_it_was_written_bit_for_bit(tmp_path):
    image = an_image()

    write_exr(tmp_path / "a.exr", image)

    back = read_image(tmp_path / "a.exr")
    assert back.dtype == torch.float32
    assert torch.equal(back, image)


def test_an_hdr_is_read_as_it_was_written_within_its_eight_bit_mantissa(tmp_path):
    image = an_image()

    back = read_image(write_hdr(tmp_path / "a.hdr", image))

    # A shared exponent: at most 1/256 of a pixel's largest channel, twice that where it truncates.
    assert ((back - image).abs() <= image.amax(2, keepdim=True) / 128).all()


def test_the_same_image_gives_the_same_bytes(tmp_path):
    image = an_image()

    write_exr(tmp_path / "a.exr", image)
    write_exr(tmp_path / "b.exr", image)

    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()


def test_writing_replaces_the_file_and_leaves_no_other_file(tmp_path):
    write_exr(tmp_path / "a.exr", torch.zeros(4, 4, 3))

    write_exr(tmp_path / "a.exr", torch.ones(4, 4, 3))

    assert [p.name for p in tmp_path.iterdir()] == ["a.exr"]
    assert read_image(tmp_path / "a.exr").min() == 1


def test_a_write_that_fails_leaves_the_old_file_whole(tmp_path, monkeypatch):
    write_exr(tmp_path / "a.exr", torch.ones(4, 4, 3))

    def break_off(self, data):
        with self.open("wb") as file:
            file.write(data[:4])
        raise OSError(28, "disk full")

    monkeypatch.setattr(Path, "write_bytes", break_off)

    with pytest.raises(InputError, match="disk full"):
        write_exr(tmp_path / "a.exr", torch.zeros(4, 4, 3))
    assert [p.name for p in tmp_path.iterdir()] == ["a.exr"]
    assert read_image(tmp_path / "a.exr").min() == 1


def test_nothing_is_in_the_folder_while_an_image_is_coded(tmp_path, monkeypatch):
    def killed(self, target):
        target.write(b"half")
        assert list(tmp_path.iterdir()) == []
        raise KeyboardInterrupt

    monkeypatch.setattr(OpenEXR.File, "write", killed)

    with pytest.raises(KeyboardInterrupt):
        write_exr(tmp_path / "a.exr", torch.zeros(4, 4, 3))
    assert list(tmp_path.iterdir()) == []


def test_channels_have_their_names(tmp_path):
    image = an_image(channels=2)

    write_exr(tmp_path / "a.exr", image, channels=("mean", "error"))

    with OpenEXR.File(str(tmp_path / "a.exr")) as file:
        assert np.array_equal(file.channels()["error"].pixels, image[..., 1].numpy())


def test_half_floats_are_read_as_float32(tmp_path):
    half = an_image().half().numpy()

    write_planes(tmp_path / "a.exr", {c: half[..., i].copy() for i, c in enumerate("RGB")})

    assert torch.equal(read_image(tmp_path / "a.exr"), torch.from_numpy(half).float())


def test_channels_beyond_rgb_are_dropped_in_any_order(tmp_path):
    image = an_image(channels=5)

    write_exr(tmp_path / "a.exr", image, channels=("A", "depth.Z", "B", "G", "R"))

    assert torch.equal(read_image(tmp_path / "a.exr"), image[..., [4, 3, 2]])


def test_one_channel_becomes_three(tmp_path):
    image = an_image(channels=1)

    write_exr(tmp_path / "a.exr", image, channels=("Y",))

    assert torch.equal(read_image(tmp_path / "a.exr"), image.expand(-1, -1, 3))


@pytest.mark.parametrize(
    ("resolution", "rows"),
    [
        (b"-Y 2 +X 3", [[0, 1, 2], [3, 4, 5]]),
        (b"-Y 2 -X 3", [[2, 1, 0], [5, 4, 3]]),
        (b"+Y 2 -X 3", [[5, 4, 3], [2, 1, 0]]),
        (b"+Y 2 +X 3", [[3, 4, 5], [0, 1, 2]]),
        # Column by column: the first three pixels of the file are the left column for +X.
        (b"+X 2 -Y 3", [[0, 3], [1, 4], [2, 5]]),
        (b"+X 2 +Y 3", [[2, 5], [1, 4], [0, 3]]),
        (b"-X 2 -Y 3", [[3, 0], [4, 1], [5, 2]]),
        (b"-X 2 +Y 3", [[5, 2], [4, 1], [3, 0]]),
    ],
)
def test_the_scan_order_that_an_hdr_names_is_undone(tmp_path, resolution, rows):
    path = flat_hdr(tmp_path / "a.hdr", resolution)

    image = read_image(path)

    assert (image[..., 0] * 12.8).floor().tolist() == rows


def test_run_length_coded_columns_are_columns(tmp_path):
    image = an_image(height=12, width=9)
    data = write_hdr(tmp_path / "rows.hdr", image.transpose(0, 1)).read_bytes()
    (tmp_path / "columns.hdr").write_bytes(data.replace(b"-Y 9 +X 12", b"+X 9 -Y 12"))

    columns, rows = read_image(tmp_path / "columns.hdr"), read_image(tmp_path / "rows.hdr")

    assert columns.shape == (12, 9, 3)
    assert torch.equal(columns, rows.transpose(0, 1))


def old_rle_hdr(path, records, resolution=b"-Y 2 +X 400"):
    path.write_bytes(HDR_HEADER + resolution + b"\n" + np.array(records, np.uint8).tobytes())
    return path


def test_old_run_length_coding_repeats_the_pixel_before_it(tmp_path):
    # 1 + 3, then 1 + (44 + 256), then 495 more of the last: 1 + (238 + 256).
    records = [(200, 100, 50, 129), (1, 1, 1, 3), (10, 20, 130, 128), (1, 1, 1, 44), (1, 1, 1, 1),
               (255, 0, 0, 130), (1, 1, 1, 238), (1, 1, 1, 1)]  # fmt: skip

    image = read_image(old_rle_hdr(tmp_path / "a.hdr", records)).reshape(800, 3)

    # value = mantissa * 2^(exponent - 136), by hand.
    first, second, third = (torch.tensor(v) for v in ([200 / 128, 100 / 128, 50 / 128], [10 / 256, 20 / 256, 130 / 256],
                                                     [255 / 64, 0, 0]))  # fmt: skip
    assert torch.equal(image[:4], first.expand(4, 3))
    assert torch.equal(image[4:305], second.expand(301, 3))
    assert torch.equal(image[305:], third.expand(495, 3))


@pytest.mark.parametrize(
    ("lines", "factors"),
    [
        (b"", (1, 1, 1)),
        (b"EXPOSURE=4\n", (1 / 4, 1 / 4, 1 / 4)),
        (b"EXPOSURE=          4.0000\npfilt -e 0.5\nEXPOSURE=0.5\n", (1 / 2, 1 / 2, 1 / 2)),
        (b"EXPOSURE=2\nCOLORCORR=1 2 4\nGAMMA=1\n", (1 / 2, 1 / 4, 1 / 8)),
    ],
)
def test_the_exposure_of_an_hdr_is_divided_out(tmp_path, lines, factors):
    plain, exposed = flat_hdr(tmp_path / "a.hdr"), tmp_path / "b.hdr"
    exposed.write_bytes(plain.read_bytes().replace(b"FORMAT", lines + b"FORMAT"))

    ratio = read_image(exposed) / read_image(plain)

    assert torch.equal(ratio, torch.tensor(factors).expand(2, 3, 3))


# OpenEXR


def test_unsigned_integers_are_the_numbers_that_they_are(tmp_path):
    planes = {
        "R": np.full((2, 3), 7, np.uint32),
        "G": np.full((2, 3), 2.5, np.float32),
        "B": np.zeros((2, 3), np.uint32),
    }

    write_planes(tmp_path / "a.exr", planes)

    assert torch.allclose(read_image(tmp_path / "a.exr"), torch.tensor([7, 2.5, 0]).expand(2, 3, 3), rtol=1e-6)


def tiled_exr(path, image):
    """Tiles of 16 with all MIP levels."""
    source = oiio.ImageBuf(oiio.ImageSpec(image.shape[1], image.shape[0], 3, "float"))
    source.set_pixels(oiio.ROI(), image.numpy())
    config = oiio.ImageSpec()
    config.tile_width = config.tile_height = 16
    assert oiio.ImageBufAlgo.make_texture(oiio.MakeTxTexture, source, str(path), config)
    return path


def test_the_finest_mip_level_of_a_tiled_exr_is_read(tmp_path):
    image = an_image(32, 64)

    back = read_image(tiled_exr(tmp_path / "a.exr", image))

    assert torch.equal(back, image)


def parts_exr(path):
    grey = np.ones((2, 3), np.float32)
    beauty = np.stack([grey * 3, grey * 4, grey * 5], axis=-1)
    parts = [OpenEXR.Part({"name": "depth"}, {"Z": grey}), OpenEXR.Part({"name": "beauty"}, {"RGB": beauty}),
             OpenEXR.Part({"name": "half"}, {"RGB": beauty / 2})]  # fmt: skip
    OpenEXR.File(parts).write(str(path))
    return path


def layers_exr(path):
    planes = {f"{layer}{c}": np.full((2, 3), k + i, np.float32)
              for layer, k in (("diffuse.", 1), ("sky.left.", 7)) for i, c in enumerate("RGB")}  # fmt: skip
    return write_planes(path, planes | {"A": np.zeros((2, 3), np.float32)})


@pytest.mark.parametrize(
    ("make", "layer", "colour"),
    [
        (parts_exr, None, (3, 4, 5)),
        (parts_exr, "half", (1.5, 2, 2.5)),
        (layers_exr, "diffuse", (1, 2, 3)),
        (layers_exr, "sky.left", (7, 8, 9)),
    ],
)
def test_the_colour_of_an_exr_is_found_among_parts_and_layers(tmp_path, make, layer, colour):
    image = read_image(make(tmp_path / "a.exr"), layer)

    assert torch.equal(image, torch.tensor(colour).expand(2, 3, 3).float())


# Portable float maps


@pytest.mark.parametrize(("scale", "order"), [("-1.0", "<"), ("1.0", ">"), ("-2.5", "<"), ("1e-1", ">")])
@pytest.mark.parametrize("channels", [1, 3])
def test_a_pfm_has_its_bottom_row_first_and_its_scale_as_a_factor(tmp_path, scale, order, channels):
    image = an_image(3, 2, channels)
    header = f"{'PF' if channels == 3 else 'Pf'}\n2 3\n{scale}\n".encode()
    (tmp_path / "a.pfm").write_bytes(header + image.numpy()[::-1].astype(f"{order}f4").tobytes())

    back = read_image(tmp_path / "a.pfm")

    assert torch.equal(back, (image * abs(float(scale))).expand(3, 2, 3))


def test_the_pfm_check_notices_the_other_endianness(tmp_path):
    image = an_image(3, 2)
    (tmp_path / "a.pfm").write_bytes(b"PF\n2 3\n1.0\n" + image.numpy()[::-1].astype("<f4").tobytes())

    back = read_pixels(tmp_path / "a.pfm")

    assert not torch.isclose(back, image).any()


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b" \n", b" \t\r\n"])
def test_a_header_of_a_pfm_ends_with_its_line(tmp_path, end):
    image = an_image(3, 2)
    (tmp_path / "a.pfm").write_bytes(b"PF\n2 3\n-1" + end + image.numpy()[::-1].tobytes())

    assert torch.equal(read_image(tmp_path / "a.pfm"), image)


def test_pixels_of_a_pfm_may_begin_with_white_space(tmp_path):
    image = torch.from_numpy(np.frombuffer(b"\n \x0a\x41" * 6, "<f4").reshape(1, 2, 3).copy())
    (tmp_path / "a.pfm").write_bytes(b"PF 2 1 -1\n" + image.numpy().tobytes())

    assert torch.equal(read_image(tmp_path / "a.pfm"), image)


# Eight bits


def write_ldr(path, values, mode="RGB"):
    Image.fromarray(np.array(values, np.uint8), mode=None).convert(mode).save(path)
    return path


# By hand from the definition: 0, the linear toe, middle grey, white.
SRGB = {0: 0.0, 10: 10 / 255 / 12.92, 128: 0.2158605, 255: 1.0}


@pytest.mark.parametrize("suffix", [".png", ".tif", ".TIFF"])
def test_an_8_bit_image_is_decoded_from_srgb_when_asked(tmp_path, suffix):
    path = write_ldr(tmp_path / f"a{suffix}", [[[v, 255, 0] for v in SRGB]])

    image = read_image(path, ldr=True)

    assert torch.allclose(image[0, :, 0], torch.tensor(list(SRGB.values())), rtol=1e-5, atol=0)
    assert image[0, :, 1:].tolist() == [[1, 0]] * 4


def test_a_jpeg_and_a_grey_image_with_alpha_are_read_too(tmp_path):
    write_ldr(tmp_path / "a.jpg", np.full((8, 8, 3), 128))
    write_ldr(tmp_path / "a.png", np.full((8, 8, 3), 128), "LA")

    images = [read_image(tmp_path / name, ldr=True) for name in ("a.jpg", "a.png")]

    assert all(torch.allclose(i, torch.full((8, 8, 3), SRGB[128])) for i in images)


# Damage


def make_file(path, coding):
    """A small sound file of a coding."""
    image, rgb = an_image(), an_image(6, 8)[..., 0].half().numpy()
    if coding == "rle.hdr":
        write_hdr(path, image)
    elif coding == "flat.hdr":
        flat_hdr(path)
    elif coding == "old_rle.hdr":
        old_rle_hdr(
            path, [(200, 100, 50, 129), (1, 1, 1, 24), (1, 1, 1, 3), (9, 9, 200, 129), (1, 1, 1, 5), (2, 3, 200, 99)]
        )
    elif coding == "float.exr":
        write_exr(path, image)
    elif coding == "half.exr":
        write_planes(path, {c: rgb for c in "RGB"})
    elif coding == "tiled.exr":
        tiled_exr(path, an_image(16, 32)[:, :, :1].expand(-1, -1, 3) * 0 + 1)
    elif coding == "parts.exr":
        parts_exr(path)
    elif coding == "colour.pfm":
        path.write_bytes(b"PF 16 6 -1.0\n" + image.numpy().tobytes())
    else:
        write_ldr(path, (image * 2).int().numpy())
    return path


CODINGS = ["rle.hdr", "flat.hdr", "old_rle.hdr", "float.exr", "half.exr", "tiled.exr", "parts.exr", "colour.pfm",
           "ldr.png", "ldr.jpg", "ldr.tif"]  # fmt: skip


def read_any(path):
    return read_image(path, ldr=path.name.startswith("ldr"))


@pytest.mark.parametrize("coding", CODINGS)
def test_a_file_cut_short_anywhere_is_refused(tmp_path, capfd, coding):
    path = make_file(tmp_path / coding, coding)
    read_any(path)

    accepted = accepted_cuts(path, path.read_bytes(), read_any)

    assert accepted == []
    assert capfd.readouterr() == ("", "")


def test_the_truncation_check_notices_a_reader_that_accepts_what_there_is(tmp_path):
    path = flat_hdr(tmp_path / "a.hdr")

    def forgiving(path):
        try:
            return read_image(path)
        except InputError as error:
            if "its runs make" not in str(error) and "too few bytes" not in str(error):
                raise

    assert accepted_cuts(path, path.read_bytes(), forgiving) != []


def with_data_window(path, *corners):
    """The EXR with another data window in its header."""
    data = write_planes(path, {"Y": np.ones((6, 16), np.float32)}).read_bytes()
    at = data.index(b"dataWindow\0box2i\0") + 21
    path.write_bytes(data[:at] + struct.pack("<4i", *corners) + data[at + 16 :])


def headed(path, line):
    flat_hdr(path)
    path.write_bytes(path.read_bytes().replace(b"FORMAT", line + b"\nFORMAT"))


def claiming(path, size):
    """Run-length coded planes of a far larger image."""
    path.write_bytes(HDR_HEADER + f"-Y {size} +X {size}\n".encode() + bytes([2, 2, size >> 8, size & 255]) * 9)


def xyze(path, name=b"xyze"):
    flat_hdr(path)
    path.write_bytes(path.read_bytes().replace(b"rgbe", name))


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
        ("a.exr", lambda p: p.mkdir(), "must be an image file, but is a folder"),
        ("a.hdr", lambda p: p.write_bytes(b""), r"is empty \(0 bytes\)"),
        ("a.gif", lambda p: p.write_bytes(b"x"), r"unknown extension '.gif'; known: .exr, .hdr, .pfm, .dds, .tif"),
        ("a.png", lambda p: p.write_bytes(b"x"), "is not a high-dynamic-range image; .* set ldr: true"),
        ("a.JPG", lambda p: p.write_bytes(b"x"), "is not a high-dynamic-range image; .* set ldr: true"),
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
        ("a.hdr", lambda p: flat_hdr(p, b"-Y -2 +X 3"), "damaged.*its size must be a line .*-Y -2"),
        ("a.hdr", lambda p: flat_hdr(p, b"-Y 60000 +X 60000"), "at most 268435456 pixels, .* 60000 x 60000"),
        ("a.hdr", lambda p: flat_hdr(p, b"-Y 3 +Y 2"), "damaged.*its size must be a line"),
        (
            "a.hdr",
            lambda p: old_rle_hdr(p, [(9, 9, 200, 129)] * 6),
            "damaged.*runs make 6 pixels, its header claims 800",
        ),
        ("a.hdr", lambda p: old_rle_hdr(p, [(1, 1, 1, 9)] * 2), "damaged.*begins with a repetition, before any pixel"),
        ("a.hdr", lambda p: old_rle_hdr(p, [(9, 9, 9, 9), *[(1, 1, 1, 255)] * 9]), "damaged.*its header claims 800"),
        ("a.hdr", lambda p: headed(p, b"GAMMA=2.2"), "must be linear .* remove it"),
        ("a.hdr", lambda p: headed(p, b"EXPOSURE=bright"), "damaged.*EXPOSURE must be 1 positive number, got 'bright'"),
        (
            "a.hdr",
            lambda p: headed(p, b"EXPOSURE=-1"),
            "EXPOSURE must be 1 positive number, got '-1'; correct or remove",
        ),
        ("a.hdr", lambda p: headed(p, b"EXPOSURE=1,5"), "EXPOSURE must be 1 positive number, got '1,5'"),
        ("a.hdr", lambda p: headed(p, b"EXPOSURE=nan"), "EXPOSURE must be 1 positive number, got 'nan'"),
        ("a.hdr", lambda p: headed(p, b"COLORCORR=1 0 1"), "COLORCORR must be 3 positive numbers, got '1 0 1'"),
        ("a.hdr", lambda p: headed(p, b"PRIMARIES=0.6 0.3"), "PRIMARIES must be 8 numbers, got '0.6 0.3'"),
        ("a.hdr", lambda p: headed(p, b"EXPOSURE=1e300\nEXPOSURE=1e300"), "damaged.*multiply to inf"),
        ("a.hdr", lambda p: headed(p, b"COLORCORR=1 2"), "damaged.*COLORCORR must be 3 positive numbers"),
        ("a.hdr", lambda p: xyze(p, b"luv"), "FORMAT must be 32-bit_rle_rgbe or 32-bit_rle_xyze, is 32-bit_rle_luv"),
        ("a.pfm", lambda p: p.write_bytes(b"PF\n3 2\nx\n"), "damaged.*no header such as"),
        ("a.pfm", lambda p: p.write_bytes(b"PF" + b" " * 999), "damaged.*no header such as"),
        ("a.pfm", lambda p: p.write_bytes(b"PF 3 2 0.0\n"), "damaged.*scale must be a number other than 0, got 0.0"),
        ("a.pfm", lambda p: p.write_bytes(b"PF 3 2 1-e\n"), "damaged.*scale must be a number"),
        ("a.pfm", lambda p: p.write_bytes(b"PF 99999 99999 1\n"), "at most 268435456 pixels"),
        ("a.pfm", lambda p: p.write_bytes(b"PF 3 0 1\n"), "at least 1x1"),
        ("a.pfm", lambda p: p.write_bytes(b"Pf 1 1 -1e9\n" + struct.pack("<f", 1e38)), "finite, but 1 pixels"),
        ("a.hdr", lambda p: claiming(p, 16000), "damaged.*too few bytes for the 16000 x 16000 pixels"),
        ("a.pfm", lambda p: p.write_bytes(b"PF 3 2 1\n" + b"x" * 71), "damaged.*71 of 72 bytes"),
        ("a.exr", lambda p: write_planes(p, {c: np.ones((2, 2), np.float32) for c in ("Y", "RY", "BY")}), "luminance"),
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
    monkeypatch.setattr(refusals, "MAX_PIXELS", 95)

    with pytest.raises(InputError, match="must have at most 95 pixels, its header claims 16 x 6"):
        read_image(tmp_path / "a.exr")


@pytest.mark.parametrize(
    ("make", "options", "message"),
    [
        (layers_exr, {"layer": "difuse"}, "has no layer 'difuse' with R, G, B; did you mean 'diffuse'"),
        (parts_exr, {"layer": "depth"}, "has no layer 'depth' with R, G, B"),
        (flat_hdr, {"layer": "sky"}, "only an OpenEXR image has layers, got layer 'sky'"),
    ],
)
def test_a_missing_layer_is_one_clear_line(tmp_path, make, options, message):
    path = make(tmp_path / ("a.hdr" if make is flat_hdr else "a.exr"))

    with pytest.raises(InputError, match=message):
        read_image(path, **options)


@pytest.mark.parametrize("coding", CODINGS)
def test_damaged_bytes_never_do_worse_than_an_input_error(tmp_path, coding):
    generator = np.random.default_rng(5)
    path = make_file(tmp_path / coding, coding)
    whole = np.frombuffer(path.read_bytes(), np.uint8)

    for _ in range(60):
        damaged = whole.copy()
        damaged[generator.integers(0, len(whole), 3)] = generator.integers(0, 256, 3)
        path.write_bytes(damaged.tobytes())
        try:
            outcome = read_any(path)
        except InputError as error:
            outcome = str(error)
        assert "\n" not in outcome if isinstance(outcome, str) else torch.isfinite(outcome).all()
