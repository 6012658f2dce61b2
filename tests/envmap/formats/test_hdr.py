"""Radiance pictures as other programs write them: right values from bytes made by hand."""

import numpy as np
import pytest

from glossbench.envmap.formats import rgbe
from glossbench.envmap.formats.files import read_file
from glossbench.errors import InputError

LINES = (b"#?RADIANCE", b"FORMAT=32-bit_rle_rgbe", b"", b"-Y 3 +X 8")
# Mantissas of three scanlines of eight pixels; with exponent 136 each value is its mantissa.
PIXELS = np.random.default_rng(4).integers(128, 256, (3, 8, 3), np.uint8)
RGBE = np.concatenate([PIXELS, np.full((3, 8, 1), 136, np.uint8)], axis=2)


def flat(line):
    return line.tobytes()


def coded(line):
    """The new way: two runs of four pixels' bytes as they are, and the exponent as a run of eight."""
    planes = [bytes([4, *c[:4], 4, *c[4:]]) for c in line.T[:3]]
    return bytes([2, 2, 0, len(line)]) + b"".join(planes) + bytes([128 + len(line), line[0, 3]])


def old(line):
    """The old way: the last pixel written twice, the second time as a run of one."""
    assert (line[-1] == line[-2]).all()
    return line[:-1].tobytes() + b"\1\1\1\1"


def picture(path, codings=(coded,) * 3, lines=LINES, end=b"\n", pixels=RGBE):
    body = b"".join(coding(line) for coding, line in zip(codings, pixels, strict=True))
    path.write_bytes(end.join([*lines, b""]) + body)
    return path


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
@pytest.mark.parametrize("codings", [(flat, coded, coded), (coded, flat, coded), (coded, coded, flat), (coded,) * 3,
                                     (flat,) * 3, (old, coded, flat)])  # fmt: skip
def test_each_scanline_is_read_as_its_own_first_bytes_say(tmp_path, codings, end):
    pixels = RGBE.copy()
    pixels[:, -2] = pixels[:, -1]

    image = read_file(picture(tmp_path / "a.hdr", codings, end=end, pixels=pixels)).image

    assert np.array_equal(image, pixels[..., :3])


def test_the_check_of_mixed_scanlines_notices_a_reader_that_goes_by_the_first(tmp_path, monkeypatch):
    path = picture(tmp_path / "a.hdr", (flat, coded, coded))
    flat_only = rgbe._decode_records
    monkeypatch.setattr(
        rgbe, "_decode_scanlines", lambda path, kind, data, h, w, _: flat_only(path, kind, data, 0, h * w, 1)[0]
    )

    try:
        same = np.array_equal(read_file(path).image, PIXELS)
    except InputError:
        same = False

    assert not same


@pytest.mark.parametrize("coding", [flat, coded])
@pytest.mark.parametrize("order", ["-Y 3 +X 8", "-Y 3 -X 8", "+Y 3 +X 8", "+Y 3 -X 8", "+X 3 -Y 8", "-X 3 +Y 8"])
def test_all_scan_orders_are_undone_in_either_coding(tmp_path, coding, order):
    path = picture(tmp_path / "a.hdr", (coding,) * 3, (*LINES[:3], order.encode()))

    image = read_file(path).image

    first, _, second, _ = order.split()
    wanted = PIXELS if first in ("-Y", "+X") else PIXELS[::-1]
    wanted = wanted if second in ("-Y", "+X") else wanted[:, ::-1]
    assert np.array_equal(image, wanted if first[1] == "Y" else wanted.swapaxes(0, 1))


@pytest.mark.parametrize(
    ("lines", "factor", "note"),
    [
        ([b"EXPOSURE=0"], 1, "EXPOSURE=0 is not a factor and counts as 1"),
        ([b"EXPOSURE=0.0", b"EXPOSURE=4"], 1 / 4, "EXPOSURE=0 is not a factor"),
        ([b"EXPOSURE="], 1, "EXPOSURE= is not a factor"),
        ([b"GAMMA=0"], 1, "GAMMA=0 is not a factor"),
        ([b"COLORCORR=0 0 0"], 1, "COLORCORR=0 0 0 is not a factor"),
        ([b"EXPOSURE\t=\t4.0 "], 1 / 4, None),
        ([b" EXPOSURE = 2", b"exposure=2"], 1 / 4, None),
        ([b"#EXPOSURE=7", b"#", b"# EXPOSURE=7"], 1, None),
        ([b"pfilt -e EXPOSURE"], 1, None),
        ([b"PIXASPECT=0.5"], 1, "PIXASPECT is ignored"),
        ([b"PIXASPECT=1"], 1, None),
        ([b"PRIMARIES=0.64 0.33 0.3 0.6 0.15 0.06 0.3127 0.329"], 1, None),
        ([b"PRIMARIES=0.640 0.330 0.290 0.600 0.150 0.060 0.333 0.333"], 1, None),
        ([b"PRIMARIES=0 0 0 0 0 0 0 0"], 1, None),
        ([b"", b"EXPOSURE=2"], 1 / 2, None),
    ],
)
def test_a_line_of_the_header_means_its_factor(tmp_path, lines, factor, note):
    decoded = read_file(picture(tmp_path / "a.hdr", lines=(*LINES[:2], *lines, *LINES[2:])))

    assert np.array_equal(decoded.image, PIXELS * np.float32(factor))
    assert [note in each for each in decoded.notes] == [True] if note else decoded.notes == ()


@pytest.mark.parametrize(
    "lines",
    [
        (b"#?RGBE", *LINES[1:]),
        (b"#?AUTOPANO", *LINES[1:]),
        (b"#?RADIANCE", *LINES[2:]),
        (b"#?RADIANCE", b"FORMAT = 32-bit_rle_rgbe ", b" \t", b"  -Y  3\t+X 8  "),
        (b"#?RADIANCE", b"# a comment", b"", b"", b"-Y 3 +X 8"),
        (b"#?RADIANCE", b"FORMAT=32-bit_rle_rgbe", b"-Y 3 +X 8"),
    ],
)
def test_headers_are_taken_as_programs_write_them(tmp_path, lines):
    assert np.array_equal(read_file(picture(tmp_path / "a.hdr", lines=lines)).image, PIXELS)


def test_cie_xyz_and_other_primaries_are_converted(tmp_path):
    white = np.full((3, 8, 4), 136, np.uint8)
    white[..., :3] = (190, 200, 218)  # D65 within 0.1 %
    xyz = picture(tmp_path / "a.hdr", lines=(LINES[0], b"FORMAT=32-bit_rle_xyze", *LINES[2:]), pixels=white)
    stated = b"PRIMARIES=0.708 0.292 0.170 0.797 0.131 0.046 0.3127 0.3290"
    wide = picture(tmp_path / "b.hdr", lines=(*LINES[:2], stated, *LINES[2:]), pixels=white)

    xyz, wide = read_file(xyz), read_file(wide)

    assert xyz.image[0, 0] == pytest.approx([200, 200, 200], rel=2e-3)
    # ITU-R BT.2407: from Rec. 2020 to Rec. 709.
    matrix = np.array([[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]])
    assert wide.image[0, 0] == pytest.approx(matrix @ (190, 200, 218), rel=1e-3)
    assert xyz.notes == ("converted from CIE XYZ to linear Rec. 709",)
    assert "converted from its PRIMARIES 0.708 0.292" in wide.notes[0]


def test_a_colour_beyond_rec_709_is_cut_at_zero_and_counted(tmp_path):
    green = np.full((3, 8, 4), 136, np.uint8)
    green[..., :3] = (0, 200, 0)
    stated = b"PRIMARIES=0.708 0.292 0.170 0.797 0.131 0.046 0.3127 0.3290"

    decoded = read_file(picture(tmp_path / "a.hdr", lines=(*LINES[:2], stated, *LINES[2:]), pixels=green))

    assert decoded.image[0, 0] == pytest.approx([0, 226.58, 0], rel=1e-3)  # ITU-R BT.2407
    assert decoded.notes[0].endswith("; 24 pixels have colours beyond Rec. 709, their negative channels are 0")


def test_primaries_that_are_not_a_triangle_leave_the_colour_with_a_note(tmp_path):
    stated = b"PRIMARIES=" + b" 0.1" * 8

    decoded = read_file(picture(tmp_path / "a.hdr", lines=(*LINES[:2], stated, *LINES[2:])))

    assert (decoded.image == PIXELS).all()
    assert decoded.notes[0].startswith("taken as linear Rec. 709, for its chromaticities must be a triangle")


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (b"\2\2\0\7" + b"\x87\x80" * 12, "a scanline states 7 pixels, its header 8"),
        (coded(RGBE[0]) + b"\2\2\0\7" + b"\x87\x80" * 8, "scanline 1 does not state its 8 pixels"),
        (coded(RGBE[0]) + b"\2\2\0\x08" + b"\x89\x80" * 12, "its runs make 9 of 8 pixels of scanline 1"),
        (coded(RGBE[0]) + b"\2\2\0\x08" + b"\0\0" * 12, "its runs make 0 of 8 pixels of scanline 1"),
        (coded(RGBE[0]) + coded(RGBE[1]) + b"\1\1\1\1" * 8, "a repetition, before any pixel"),
        (coded(RGBE[0])[:-1], "its runs make 0 of 8 pixels of scanline 0"),
        (b"abc", "too few bytes for the 3 x 8 pixels that its header claims: 3"),
    ],
)
def test_scanlines_that_do_not_add_up_are_one_line(tmp_path, body, message):
    (tmp_path / "a.hdr").write_bytes(b"\n".join([*LINES, b""]) + body)

    with pytest.raises(InputError, match=f"a.hdr: is truncated or damaged as a Radiance HDR image: .*{message}"):
        read_file(tmp_path / "a.hdr")


def test_lines_of_7_and_of_32768_pixels_are_never_of_the_new_coding(tmp_path):
    for n in (7, 32768):
        pixels = np.full((1, n, 4), (2, 2, 0, 136), np.uint8)
        lines = (*LINES[:3], b"-Y 1 +X %d" % n)

        image = read_file(picture(tmp_path / "a.hdr", (flat,), lines, pixels=pixels)).image

        assert (image == (2, 2, 0)).all()
        assert image.shape == (1, n, 3)
