"""Primaries to Rec. 709: published matrices, white stays white, and nonsense is one clear line."""

import numpy as np
import pytest

from glossbench.envmap.formats.chromaticities import REC_709, build_matrix_to_rec709, to_rec709
from glossbench.errors import InputError

D65, D60 = (0.3127, 0.3290), (0.32168, 0.33767)
REC_2020 = ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), D65)
AP0 = ((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.0770), D60)
AP1 = ((0.713, 0.293), (0.165, 0.830), (0.128, 0.044), D60)
P3 = ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), D65)
XYZ = ((1.0, 0.0), (0.0, 1.0), (0.0, 0.0), (1 / 3, 1 / 3))

# ITU-R BT.2087; OpenColorIO's matrices of ACES to sRGB; SMPTE EG 432-1; IEC 61966-2-1.
PUBLISHED = {
    "Rec. 2020": (REC_2020, [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]]),
    "ACES AP0": (AP0, [[2.5217, -1.1341, -0.3876], [-0.2765, 1.3727, -0.0962], [-0.0154, -0.1530, 1.1684]]),
    "ACES AP1": (AP1, [[1.7051, -0.6218, -0.0833], [-0.1303, 1.1408, -0.0105], [-0.0240, -0.1290, 1.1530]]),
    "P3 D65": (P3, [[1.2249, -0.2249, 0.0], [-0.0421, 1.0421, 0.0], [-0.0196, -0.0786, 1.0983]]),
    "CIE XYZ": (XYZ, [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]),
}  # fmt: skip


@pytest.mark.parametrize("primaries", PUBLISHED)
def test_the_matrix_is_the_published_one(primaries):
    chromaticities, published = PUBLISHED[primaries]

    matrix = build_matrix_to_rec709(chromaticities)

    # Four decimals are published; those of IEC 61966-2-1 come of rounded ones, 4e-4 off.
    assert matrix == pytest.approx(np.array(published), abs=6e-4 if primaries == "CIE XYZ" else 1.5e-4)


def test_without_the_adaptation_the_matrix_of_aces_is_another():
    """Twin of the above: AP0 with the white of Rec. 709 needs no adaptation."""
    matrix = build_matrix_to_rec709((*AP0[:3], D65))

    assert np.abs(matrix - np.array(PUBLISHED["ACES AP0"][1])).max() > 0.01


@pytest.mark.parametrize("chromaticities", [REC_2020, AP0, AP1, P3])
def test_white_stays_white(chromaticities):
    assert to_rec709(np.full((2, 3, 3), 7.0), chromaticities) == pytest.approx(np.full((2, 3, 3), 7.0), rel=1e-12)


def test_radiance_of_rec_2020_is_that_of_rec_709_by_hand():
    pixels = to_rec709(np.array([[[0.5, 0.4, 0.3]]], np.float32), REC_2020)

    assert pixels.dtype == np.float32
    assert pixels[0, 0] == pytest.approx([0.57337, 0.38837, 0.28627], abs=1e-4)


@pytest.mark.parametrize("white", [(0.3127, 0.3290), (0.313, 0.329), (0.31271, 0.32902)])
def test_rec_709_itself_is_left_as_it_is(white):
    pixels = np.ones((2, 3, 3), np.float32)

    assert to_rec709(pixels, (*REC_709[:3], white)) is pixels


@pytest.mark.parametrize(
    ("chromaticities", "message"),
    [
        (((0.0, 0.0),) * 4, r"a triangle with the white in it, got \(0, 0\) \(0, 0\) \(0, 0\) \(0, 0\)"),
        (((0.64, 0.33), (0.3, 0.6), (0.15, 0.06), (0.3127, 0.0)), "a triangle with the white in it"),
        (((0.64, 0.33), (0.3, 0.6), (0.47, 0.465), (0.3, 0.3)), "a triangle with the white in it"),
        (((0.64, 0.33), (0.3, 0.6), (0.15, 0.06), (0.7, 0.3)), "a triangle with the white in it"),
        (((0.64, 0.33), (0.3, 0.6), (0.15, 0.06)), "must be four pairs"),
        (((0.64, 0.33), (0.3, 0.6), (0.15, float("nan")), (0.3, 0.3)), "must be four pairs"),
        (((0.64, 0.33), (0.3, 0.6), (0.15, 1e300), (0.3, 0.3)), "must be four pairs"),
    ],
)
def test_invalid_chromaticities_are_one_clear_line(chromaticities, message):
    with pytest.raises(InputError, match=message):
        to_rec709(np.ones((1, 1, 3)), chromaticities)
