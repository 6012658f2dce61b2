"""PNG, TIFF and JPEG: floats are radiance, integers of 8 and 16 bits are decoded; what is not read says what it is."""

import struct
import zlib

import numpy as np
import OpenImageIO as oiio
import pytest
import tifffile
from PIL import Image, ImageCms

from glossbench.envmap.formats.files import read_file, read_image
from glossbench.errors import InputError
from glossbench.srgb import decode

FLOATS = (np.random.default_rng(1).random((32, 64, 3)) * 90).astype(np.float32)
BITS_16 = (np.arange(4 * 8 * 3).reshape(4, 8, 3) * 683).astype(np.uint16)
SRGB_16 = decode(BITS_16 / 65535)


def tiff(path, image, **options):
    tifffile.imwrite(path, image, **{"photometric": "rgb"} | options)
    return path


def chunk(name, data):
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def png(path, pixels, kind=2, extra=(), depth=16):
    """A PNG without filters; kind: 0 grey, 2 colour, 3 palette, 4 grey and alpha, 6 colour and alpha."""
    rows = b"".join(b"\0" + row.tobytes() for row in pixels.astype(">u2" if depth == 16 else np.uint8))
    width = pixels.shape[1] * (8 // depth if depth < 8 else 1)
    head = struct.pack(">2I5B", width, pixels.shape[0], depth, kind, 0, 0, 0)
    chunks = [(b"IHDR", head), *extra, (b"IDAT", zlib.compress(rows)), (b"IEND", b"")]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*each) for each in chunks))
    return path


def gamma(value):
    return b"gAMA", struct.pack(">I", value)


@pytest.mark.parametrize("ldr", [False, True])
@pytest.mark.parametrize(
    ("options", "image"),
    [
        ({}, FLOATS),
        ({"tile": (16, 16)}, FLOATS),
        ({"planarconfig": "separate"}, np.moveaxis(FLOATS, 2, 0)),
        ({"compression": "zlib"}, FLOATS),
        ({"bigtiff": True}, FLOATS),
        ({"byteorder": ">"}, FLOATS),
        ({}, FLOATS.astype(np.float64)),
    ],
)
def test_a_tiff_of_floats_is_radiance_as_it_stands(tmp_path, options, image, ldr):
    decoded_file = read_file(tiff(tmp_path / "a.tif", image, **options), ldr=ldr)

    assert np.array_equal(decoded_file.image, FLOATS)
    assert decoded_file.notes == ()


def test_a_tiff_of_half_floats_one_channel_or_alpha_is_radiance_too(tmp_path):
    half = FLOATS.astype(np.float16)
    alpha = np.concatenate([FLOATS, np.full((32, 64, 1), 0.5, np.float32)], axis=2)

    assert np.array_equal(read_image(tiff(tmp_path / "half.tif", half)), half.astype(np.float32))
    grey = read_image(tiff(tmp_path / "grey.tif", FLOATS[..., 0], photometric="minisblack"))
    assert np.array_equal(grey, FLOATS[..., :1].repeat(3, 2))
    assert np.array_equal(read_image(tiff(tmp_path / "a.TIFF", alpha, extrasamples=["unassalpha"])), FLOATS)


def test_the_first_of_several_pages_is_read_with_a_note(tmp_path):
    read = read_file(tiff(tmp_path / "a.tif", np.stack([FLOATS, FLOATS / 2])))

    assert np.array_equal(read.image, FLOATS)
    assert read.notes == ("the first of its pages is read",)


@pytest.mark.parametrize(
    ("orientation", "upright"),
    [
        (2, FLOATS[:, ::-1]),
        (3, FLOATS[::-1, ::-1]),
        (4, FLOATS[::-1]),
        (6, np.rot90(FLOATS, -1)),
        (8, np.rot90(FLOATS)),
    ],
)
def test_a_tiff_is_turned_upright(tmp_path, orientation, upright):
    path = tiff(tmp_path / "a.tif", FLOATS, extratags=[(274, 3, 1, orientation, True)])

    assert np.array_equal(read_image(path), upright)


@pytest.mark.parametrize("make", [lambda p: tiff(p.with_suffix(".tif"), BITS_16), lambda p: png(p, BITS_16)])
def test_16_bits_are_decoded_from_srgb_and_none_is_lost(tmp_path, make):
    image = read_image(make(tmp_path / "a.png"), ldr=True)

    assert image.numpy() == pytest.approx(SRGB_16, rel=1e-6)


def test_the_check_of_16_bits_notices_a_reader_of_8():
    assert decode((BITS_16 >> 8) / 255) != pytest.approx(SRGB_16, rel=1e-2)


@pytest.mark.parametrize(
    ("extra", "linear", "note"),
    [
        ((gamma(100000),), BITS_16 / 65535, "its integers are linear, as it states"),
        ((gamma(55556),), (BITS_16 / 65535) ** 1.8, "decoded by the power 1.8 that it states"),
        ((gamma(45455),), SRGB_16, None),
        (((b"sRGB", b"\0"), gamma(45455)), SRGB_16, None),
        (((b"cICP", bytes([1, 13, 0, 1])),), SRGB_16, None),
    ],
)
def test_a_png_is_decoded_by_the_curve_that_it_states(tmp_path, extra, linear, note):
    read = read_file(png(tmp_path / "a.png", BITS_16, extra=extra), ldr=True)

    assert read.image == pytest.approx(linear, rel=1e-4)
    assert read.notes == ((note,) if note else ())


def test_a_colour_profile_that_is_not_applied_is_noted(tmp_path):
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    other = srgb.replace("sRGB".encode("utf-16-be"), "wide".encode("utf-16-be")).replace(b"sRGB built", b"wide built")
    for name, profile in (("a.png", srgb), ("b.png", other)):
        Image.new("RGB", (4, 4), (9, 9, 9)).save(tmp_path / name, icc_profile=profile)

    a, b = (read_file(tmp_path / name, ldr=True) for name in ("a.png", "b.png"))

    assert a.notes == ()
    assert b.notes == ("its colour profile 'wide built-in' is not applied: its values are taken for sRGB",)
    assert np.array_equal(a.image, b.image)


def test_grey_palette_alpha_and_single_bits_of_a_png_are_colour(tmp_path):
    grey = read_image(png(tmp_path / "grey.png", BITS_16[..., :1], 0), ldr=True)
    with_alpha = np.concatenate([BITS_16, np.full((4, 8, 1), 100, np.uint16)], axis=2)
    alpha = read_image(png(tmp_path / "alpha.png", with_alpha, 6), ldr=True)
    palette = (b"PLTE", bytes([0, 0, 0, 255, 0, 0, 0, 128, 255]))
    indexed = read_image(png(tmp_path / "palette.png", np.array([[2, 1, 0]]), 3, [palette], 8), ldr=True)
    bits = read_image(png(tmp_path / "bits.png", np.array([[0b10100000]]), 0, depth=1), ldr=True)

    assert grey.numpy() == pytest.approx(SRGB_16[..., :1].repeat(3, 2), rel=1e-6)
    assert alpha.numpy() == pytest.approx(SRGB_16, rel=1e-6)
    assert indexed[0].numpy() == pytest.approx(np.array([[0, 0.2158605, 1], [1, 0, 0], [0, 0, 0]]), rel=1e-5)
    assert bits[0, :, 1].tolist() == [1, 0, 1, 0, 0, 0, 0, 0]


def test_an_interlaced_png_is_the_same_image(tmp_path):
    # Adam7 of 1 x 1 pixels is one pass, and of 2 x 2 three: the corners, then what is right, then what is below.
    rows = [[10], [20], [30, 40]]
    data = b"".join(b"\0" + bytes(row) for row in rows)
    chunks = [(b"IHDR", struct.pack(">2I5B", 2, 2, 8, 0, 0, 0, 1)), (b"IDAT", zlib.compress(data)), (b"IEND", b"")]
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*each) for each in chunks))

    image = read_image(tmp_path / "a.png", ldr=True)[..., 0]

    assert image.numpy() == pytest.approx(decode(np.array([[10, 20], [30, 40]]) / 255), rel=1e-5)


def logluv(path, photometric=32845, compression=34676, bits=16):
    """A TIFF whose tags say SGI LogLuv, or another coding of colour, by hand; its pixels do not matter."""
    tags = [(256, 4, 2), (257, 4, 1), (258, 3, bits), (259, 3, compression), (262, 3, photometric),
            (273, 4, 8), (277, 3, 3), (278, 4, 1), (279, 4, 40)]  # fmt: skip
    entries = b"".join(struct.pack("<2H2I", tag, kind, 1, value) for tag, kind, value in tags)
    path.write_bytes(
        b"II*\0" + struct.pack("<I", 48) + b"\x82\1" * 20 + struct.pack("<H", len(tags)) + entries + b"\0" * 4
    )
    return path


@pytest.mark.parametrize(
    ("name", "make", "message"),
    [
        (
            "a.tif",
            lambda p: tiff(p, BITS_16),
            "is not a high-dynamic-range image; to use its integers .* set ldr: true",
        ),
        ("a.tif", lambda p: tiff(p, BITS_16.astype(np.uint32)), "holds integers of the type uint.*convert them"),
        ("a.tif", lambda p: tiff(p, BITS_16.astype(np.int16)), "holds integers of the type int16"),
        ("a.tif", logluv, "holds SGI Logluv, which is not read; convert it to .exr"),
        ("a.tif", lambda p: logluv(p, 8, 1, 8), "holds CIELAB, which is not read; convert it to .exr"),
        ("a.tif", lambda p: tiff(p, FLOATS) and p.write_bytes(p.read_bytes()[:9000]), "truncated or damaged as a TIFF"),
        ("a.hdr", lambda p: tiff(p, FLOATS), "is not a Radiance HDR image: .* as a TIFF image does; name it .tif"),
        ("a.exr", lambda p: p.write_bytes(b"#?RADIANCE\n"), "as a Radiance HDR image does; name it .hdr"),
        ("a.hdr", lambda p: p.write_bytes(b"RIFF\0\0\0\0WEBPVP8 "), "as a WebP image does; convert it to .exr"),
        ("a.exr", lambda p: p.write_bytes(b"<!DOCTYPE html><html>"), "as a web page does; download the image itself"),
        ("a.webp", lambda p: p.write_bytes(b"RIFF\0\0\0\0WEBPVP8 "), "unknown extension '.webp'; .*a WebP image does"),
        ("a.ktx2", lambda p: p.write_bytes(b"\xabKTX 20\xbb\r\n"), "unknown extension '.ktx2'; .*a KTX 2 texture does"),
        ("a.avif", lambda p: p.write_bytes(b"\0\0\0\x1cftypavif"), "unknown extension '.avif'; .*an AVIF image does"),
        ("a.rgbe", lambda p: p.write_bytes(b"#?RGBE\n"), "unknown extension '.rgbe'; .*a Radiance HDR.*name it .hdr"),
    ],
)
def test_what_is_not_read_says_what_it_is_and_what_to_do(tmp_path, name, make, message):
    make(tmp_path / name)

    with pytest.raises(InputError, match=f"{name}: .*{message}") as raised:
        read_image(tmp_path / name)
    assert "\n" not in str(raised.value)


def test_a_png_of_another_range_is_refused(tmp_path):
    path = png(tmp_path / "a.png", BITS_16, extra=[(b"cICP", bytes([9, 16, 0, 1]))])

    with pytest.raises(InputError, match=r"states the colours CICP \(9, 16, 0, 1\), which are not read"):
        read_image(path, ldr=True)


def test_a_jpeg_keeps_its_eight_bits(tmp_path):
    Image.new("RGB", (16, 16), (128, 128, 128)).save(tmp_path / "a.jpg")

    assert read_image(tmp_path / "a.jpg", ldr=True).numpy() == pytest.approx(np.full((16, 16, 3), 0.2158605), rel=1e-5)
    assert oiio.ImageInput.open(str(tmp_path / "a.jpg")).spec().format == oiio.UINT8
