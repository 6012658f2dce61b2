"""OpenEXR as other programs write it: windows, layers, colour, and what has no radiance is one clear line."""

import struct

import numpy as np
import OpenEXR
import pytest

from glossbench.envmap.formats.files import read_file, read_image
from glossbench.errors import InputError

SHAPE = (4, 8)


def planes(colours, shape=SHAPE, dtype=np.float32):
    """A constant plane for each channel, by name."""
    return {name: np.full(shape, value, dtype) for name, value in colours.items()}


def rgb(prefix="", colour=(1, 2, 3)):
    return {f"{prefix}{c}": value for c, value in zip("RGB", colour, strict=True)}


def write(path, channels, **header):
    OpenEXR.File({"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION, **header}, channels).write(
        str(path)
    )
    return path


def window(x, y, width, height):
    return np.array((x, y), np.int32), np.array((x + width - 1, y + height - 1), np.int32)


def colour_of(path, layer=None):
    """The one colour of a constant image."""
    image = read_image(path, layer)
    assert (image == image[0, 0]).all()
    return tuple(image[0, 0].tolist())


# Windows


def a_picture(height=12, width=20):
    return np.random.default_rng(4).random((height, width), np.float32) + 0.5


@pytest.mark.parametrize("storage", [OpenEXR.scanlineimage, OpenEXR.tiledimage])
@pytest.mark.parametrize(
    "data", [(0, 0, 20, 12), (0, 3, 20, 5), (7, 2, 6, 3), (-5, -4, 30, 20), (-5, 4, 9, 20), (18, 11, 9, 9)]
)
@pytest.mark.parametrize("corner", [(0, 0), (-30, 17)])
def test_the_picture_is_the_display_window_black_without_data(tmp_path, storage, data, corner):
    x, y, width, height = data
    shown = a_picture()
    large = np.pad(shown, 40, constant_values=9)  # 9 is overscan, which is not part of the picture
    stored = np.ascontiguousarray(large[40 + y : 40 + y + height, 40 + x : 40 + x + width])
    header = {
        "type": storage,
        "dataWindow": window(x + corner[0], y + corner[1], width, height),
        "displayWindow": window(*corner, 20, 12),
    }
    if storage == OpenEXR.tiledimage:
        header["tiles"] = OpenEXR.TileDescription()
    write(tmp_path / "a.exr", {"Y": stored}, **header)

    decoded = read_file(tmp_path / "a.exr")

    wanted = np.zeros_like(shown)
    rows, columns = slice(max(y, 0), y + height), slice(max(x, 0), x + width)
    wanted[rows, columns] = shown[rows, columns]
    assert np.array_equal(decoded.image, np.repeat(wanted[..., None], 3, axis=2))
    assert [n.split(":")[0] for n in decoded.notes] == [
        "the picture is the display window, black without data"
    ] * (data != (0, 0, 20, 12))  # fmt: skip


@pytest.mark.parametrize("compression", ["NO", "ZIP", "HTJ2K256"])
def test_a_picture_larger_than_a_block_of_rows_is_whole(tmp_path, monkeypatch, compression):
    monkeypatch.setattr("glossbench.envmap.formats.exr._BLOCK", 1000)
    shown = np.arange(600 * 3, dtype=np.float32).reshape(600, 3)
    header = {"dataWindow": window(0, 5, 3, 600), "displayWindow": window(0, 0, 3, 610)}
    header["compression"] = getattr(OpenEXR, f"{compression}_COMPRESSION")
    write(tmp_path / "a.exr", {"Y": shown}, **header)

    image = read_image(tmp_path / "a.exr")

    assert np.array_equal(image[5:605, :, 0], shown)
    assert image[:5].max() == image[605:].max() == 0


def test_each_part_has_its_own_data_window(tmp_path):
    parts = [
        OpenEXR.Part({"name": name, "dataWindow": window(x, 0, 2, 4), "displayWindow": window(0, 0, 8, 4)},
                     planes(rgb(), (4, 2)))
        for name, x in (("beauty", 3), ("glow", 6))
    ]  # fmt: skip
    OpenEXR.File(parts).write(str(tmp_path / "a.exr"))

    lit = {
        layer: read_image(tmp_path / "a.exr", layer)[0, :, 0].nonzero()[:, 0].tolist() for layer in ("beauty", "glow")
    }

    assert lit == {"beauty": [3, 4], "glow": [6, 7]}


# Layers

ALL_OF_THE_LIGHT = {
    "plain names": rgb(),
    "lower case": {"r": 1, "g": 2, "b": 3},
    "words": {"red": 1, "green": 2, "blue": 3},
    "capital words": {"Red": 1, "Green": 2, "Blue": 3, "Alpha": 1},
    "with a depth": rgb() | {"Z": 9, "A": 1, "id": 4},
    "Blender": rgb("View Layer.AO.", (7, 8, 9)) | rgb("View Layer.Combined.") | {"View Layer.Depth.Z": 9},
    "Arnold": rgb("AO.", (7, 8, 9)) | rgb("RGBA.") | rgb("diffuse.", (7, 8, 9)),
    "beauty": rgb("albedo.", (7, 8, 9)) | rgb("beauty."),
    "no name beside names": rgb("albedo.", (7, 8, 9)) | rgb() | rgb("zenith.", (7, 8, 9)),
    "Nuke": {"rgba.red": 1, "rgba.green": 2, "rgba.blue": 3, "depth.Z": 5, "aov.red": 5, "aov.green": 5, "aov.blue": 5},
    "a colour before luminance": rgb() | {"Y": 9},
    "the only colour": rgb("sun.") | {"N.X": 0, "N.Y": 0, "N.Z": 1, "uv.U": 0, "uv.V": 1},
}


@pytest.mark.parametrize("case", ALL_OF_THE_LIGHT)
def test_the_layer_that_holds_all_of_the_light_is_read(tmp_path, case):
    assert colour_of(write(tmp_path / "a.exr", planes(ALL_OF_THE_LIGHT[case]))) == (1, 2, 3)


@pytest.mark.parametrize("channels", [{"Y": 4}, {"Y": 4, "A": 1}, {"Y": 4, "Z": 2}, {"L": 4}, {"mist.Y": 4, "id": 3}])
def test_luminance_alone_is_grey(tmp_path, channels):
    assert colour_of(write(tmp_path / "a.exr", planes(channels))) == (4, 4, 4)


NO_RADIANCE = {
    "depth": ({"Z": 1}, "its channels are Z"),
    "texture coordinates": ({"U": 1, "V": 1}, "its channels are U, V"),
    "three that are no colour": ({"N.X": 1, "N.Y": 1, "N.Z": 1}, r"its channels are N.X, N.Y, N.Z"),
    "a place": ({"X": 1, "Y": 1, "Z": 1}, "its channels are X, Y, Z"),
    "motion": ({"forward.u": 1, "forward.v": 1, "id": 1}, "its channels are id, forward.u, forward.v"),
    "no blue": ({"R": 1, "G": 1}, "its channels are R, G"),
    "alpha": ({"A": 1}, "its channels are A"),
    "names of objects": (rgb("ViewLayer.CryptoObject00."), "its channels are ViewLayer.CryptoObject00.R, .*00.G"),
    "very many": ({f"id{i:02}": 1 for i in range(40)}, r"its channels are id00, .* id11 and 28 more$"),
}


@pytest.mark.parametrize("case", NO_RADIANCE)
def test_channels_that_are_not_colours_are_refused_with_their_names(tmp_path, case):
    channels, message = NO_RADIANCE[case]
    path = write(tmp_path / "a.exr", planes(channels))

    with pytest.raises(InputError, match=f"holds no colour: a light needs channels R, G, B or Y, {message}"):
        read_image(path)


def test_layers_without_a_combined_one_are_refused(tmp_path):
    two = write(tmp_path / "a.exr", planes(rgb("specular.") | rgb("diffuse.")))
    twice = write(tmp_path / "b.exr", planes(rgb("A.Combined.") | rgb("B.Combined.")))

    with pytest.raises(InputError, match=r"several layers, .* name one by layer: diffuse, specular"):
        read_image(two)
    with pytest.raises(InputError, match=r"several layers, .* name one by layer: A.Combined, B.Combined"):
        read_image(twice)
    assert colour_of(twice, "B.Combined") == (1, 2, 3)


def test_what_was_chosen_is_in_the_notes(tmp_path):
    notes = {
        name: read_file(write(tmp_path / "a.exr", planes(channels))).notes
        for name, channels in (("bare", rgb() | rgb("AO.")), ("combined", rgb("Combined.") | rgb("AO.")),
                               ("only", rgb("sun.") | {"Z": 1}))
    }  # fmt: skip

    assert notes == {
        "bare": (),
        "combined": ("the layer Combined is read, one of AO, Combined",),
        "only": ("the layer sun is read, because only this one has colour",),
    }


def parts(path, *stated):
    """A part for each (name, view, first colour)."""
    made = [OpenEXR.Part({"name": name, **({"view": view} if view else {})}, planes(rgb("", (value, value, value))))
            for name, view, value in stated]  # fmt: skip
    OpenEXR.File(made).write(str(path))
    return path


@pytest.mark.parametrize(
    ("stated", "value"),
    [
        ([("diffuse", "", 5), ("RGBA", "", 1)], 1),
        ([("rgba.left", "left", 1), ("rgba.right", "right", 5)], 1),
        ([("left", "left", 1), ("right", "right", 5)], 1),
        ([("diffuse.right", "right", 5), ("beauty.right", "right", 1), ("beauty.left", "left", 5)], 1),
    ],
)
def test_the_combined_part_of_the_first_view_is_read(tmp_path, stated, value):
    assert colour_of(parts(tmp_path / "a.exr", *stated))[0] == value


def test_parts_without_a_combined_one_are_refused(tmp_path):
    path = parts(tmp_path / "a.exr", ("specular", "", 5), ("diffuse", "", 1))

    with pytest.raises(InputError, match=r"several layers, .* name one by layer: specular, diffuse"):
        read_image(path)
    assert colour_of(path, "diffuse") == (1, 1, 1)


def test_the_first_view_of_a_stereo_image_is_read_with_a_note(tmp_path):
    path = write(tmp_path / "a.exr", planes(rgb() | rgb("left.", (7, 8, 9))), multiView=["right", "left"])

    assert colour_of(path) == (1, 2, 3)
    assert colour_of(path, "left") == (7, 8, 9)
    assert read_file(path).notes == ("the view right is read, one of right, left",)


# Values


@pytest.mark.parametrize(
    "compression",
    ["NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB", "HTJ2K256", "HTJ2K32", "ZSTD"],
)  # fmt: skip
def test_every_compression_is_read(tmp_path, compression):
    ramp = np.linspace(0.5, 2, 64 * 64, dtype=np.float16).reshape(64, 64)
    channels = {"R": ramp, "G": 2 * ramp, "B": ramp}
    path = write(tmp_path / "a.exr", channels, compression=getattr(OpenEXR, f"{compression}_COMPRESSION"))

    image = read_image(path)

    # B44 keeps six bits of a half, DWA is set to what is seen: measured 0.015 and 0.02.
    lossy = compression in ("B44", "B44A", "DWAA", "DWAB")
    assert np.abs(image.numpy() / np.stack([ramp, 2 * ramp, ramp], -1) - 1).max() <= (0.04 if lossy else 0)


def test_half_float_full_float_and_integer_channels_mix(tmp_path):
    channels = {
        "R": np.full(SHAPE, 0.5, np.float16), "G": np.full(SHAPE, 1e5, np.float32), "B": np.full(SHAPE, 3, np.uint32),
    }  # fmt: skip

    assert colour_of(write(tmp_path / "a.exr", channels)) == pytest.approx((0.5, 1e5, 3), rel=1e-6)


def test_a_half_float_that_overflowed_is_refused_by_its_pixel(tmp_path):
    channels = planes(rgb(), dtype=np.float16)
    channels["G"][1, 6] = np.inf

    with pytest.raises(InputError, match=r"finite, but 1 pixels are not, first at row 1, column 6: inf"):
        read_image(write(tmp_path / "a.exr", channels))


def test_colour_counts_as_stored_where_alpha_is_below_one_with_a_note(tmp_path):
    channels = planes(rgb() | {"A": 1})
    channels["A"][:2] = 0.5

    decoded = read_file(write(tmp_path / "a.exr", channels))

    assert (decoded.image == (1, 2, 3)).all()
    assert decoded.notes == ("alpha is below 1 in 16 pixels: their colour counts as stored, with black behind it",)


def test_the_shape_of_a_pixel_is_left_out_and_this_is_said(tmp_path):
    assert read_file(write(tmp_path / "a.exr", planes(rgb()), pixelAspectRatio=2.0)).notes == (
        "its pixelAspectRatio of 2 is ignored",
    )


REC_2020 = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)


def test_chromaticities_are_converted_to_rec_709(tmp_path):
    path = write(tmp_path / "a.exr", planes(rgb("", (0.5, 0.4, 0.3))), chromaticities=REC_2020)

    # ITU-R BT.2087.
    assert colour_of(path) == pytest.approx((0.57337, 0.38837, 0.28627), abs=1e-4)
    assert read_file(path).notes[0].startswith("converted from the chromaticities (0.708, 0.292)")


def test_a_colour_beyond_rec_709_is_cut_at_zero_and_counted(tmp_path):
    channels = planes(rgb("", (1, 1, 1)))
    channels["R"][0, :3] = channels["B"][0, :3] = 0
    decoded = read_file(write(tmp_path / "a.exr", channels, chromaticities=REC_2020))

    assert decoded.image[0, 0] == pytest.approx((0, 1.1329, 0), abs=1e-4)
    assert decoded.image[1, 0] == pytest.approx((1, 1, 1), abs=1e-5)
    assert decoded.notes[0].endswith("; 3 pixels have colours beyond Rec. 709, their negative channels are 0")


def test_a_negative_pixel_of_the_file_itself_is_not_hidden_by_the_conversion(tmp_path):
    channels = planes(rgb("", (1, 1, 1)))
    channels["G"][0, 5] = -2

    with pytest.raises(InputError, match="not negative, but 1 pixels are not, first at row 0, column 5"):
        read_image(write(tmp_path / "a.exr", channels, chromaticities=REC_2020))


def test_impossible_chromaticities_leave_the_colour_with_a_note(tmp_path):
    decoded = read_file(write(tmp_path / "a.exr", planes(rgb()), chromaticities=(0.0,) * 8))

    assert (decoded.image == (1, 2, 3)).all()
    assert decoded.notes[0].startswith("taken as linear Rec. 709, for its chromaticities must be a triangle")


def test_luminance_has_no_chromaticities(tmp_path):
    path = write(tmp_path / "a.exr", planes({"Y": 4}), chromaticities=REC_2020)

    assert colour_of(path) == (4, 4, 4)
    assert read_file(path).notes == ()


# What is not read


def attribute(name, kind, value):
    return name + b"\0" + kind + b"\0" + struct.pack("<I", len(value)) + value


def subsampled(path, steps):
    """An image of 8 x 4 by hand: channels of ones, each with one pixel per given number of columns and rows."""
    steps = dict(sorted(steps.items()))
    channels = b"".join(name.encode() + b"\0" + struct.pack("<iB3xii", 2, 0, n, n) for name, n in steps.items())
    box = struct.pack("<4i", 0, 0, 7, 3)
    header = b"\x76\x2f\x31\x01" + struct.pack("<I", 2)
    header += attribute(b"channels", b"chlist", channels + b"\0") + attribute(b"compression", b"compression", b"\0")
    header += attribute(b"dataWindow", b"box2i", box) + attribute(b"displayWindow", b"box2i", box)
    header += attribute(b"lineOrder", b"lineOrder", b"\0") + attribute(b"pixelAspectRatio", b"float", b"\0\0\x80\x3f")
    header += attribute(b"screenWindowCenter", b"v2f", bytes(8))
    header += attribute(b"screenWindowWidth", b"float", b"\0\0\x80\x3f") + b"\0"
    lines = []
    for y in range(4):
        pixels = b"".join(b"\0\0\x80\x3f" * (8 // n) for n in steps.values() if y % n == 0)
        lines.append(struct.pack("<2i", y, len(pixels)) + pixels)
    starts = np.cumsum([len(header) + 32, *map(len, lines[:-1])]).astype("<u8")
    path.write_bytes(header + starts.tobytes() + b"".join(lines))
    return path


@pytest.mark.parametrize(
    ("steps", "message"),
    [
        ({"Y": 1, "RY": 2, "BY": 2}, r"holds luminance and chroma \(Y, RY, BY\), not R, G, B; convert it to R, G, B"),
        ({"R": 1, "G": 1, "B": 2}, r"holds channels of fewer pixels than the others \(B\); convert it to R, G, B"),
    ],
)
def test_subsampled_channels_are_one_clear_line(tmp_path, capfd, steps, message):
    path = subsampled(tmp_path / "a.exr", steps)

    with pytest.raises(InputError, match=message) as raised:
        read_image(path)

    assert "\n" not in str(raised.value)
    assert capfd.readouterr() == ("", "")


def test_the_hand_made_image_is_sound_without_subsampling(tmp_path):
    """Twin of the above."""
    assert colour_of(subsampled(tmp_path / "a.exr", {"R": 1, "G": 1, "B": 1})) == (1, 1, 1)


def test_a_deep_image_is_one_clear_line(tmp_path):
    samples = np.empty(SHAPE, dtype=object)
    for place in np.ndindex(SHAPE):
        samples[place] = np.ones(2, np.float32)
    path = tmp_path / "a.exr"
    header = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
    OpenEXR.File(header, dict.fromkeys("RGBAZ", samples)).write(str(path))

    with pytest.raises(InputError, match="a deep image has no single radiance per pixel; flatten it first"):
        read_image(path)


def test_a_picture_without_any_of_the_pixels_is_refused(tmp_path):
    apart = {"dataWindow": window(0, 0, 8, 4), "displayWindow": window(100, 0, 8, 4)}
    path = write(tmp_path / "a.exr", planes(rgb()), **apart)

    with pytest.raises(InputError, match=r"no pixel is within the picture: its data window is 8 x 4 at \(0, 0\)"):
        read_image(path)


def test_a_display_window_that_claims_too_much_is_refused_before_it_takes_memory(tmp_path):
    path = write(tmp_path / "a.exr", planes(rgb()), displayWindow=window(0, 0, 60000, 60000))

    with pytest.raises(InputError, match="at most 268435456 pixels, its header claims 60000 x 60000"):
        read_image(path)
