"""The curve of sRGB against published values."""

import numpy as np
import pytest

from glossbench.srgb import decode, encode

# IEC 61966-2-1: black, the end of the straight part, white; and 0.18 from the manual of colour-science.
PUBLISHED = [(0.0, 0.0), (0.0031308, 0.04045), (0.18, 0.4613561), (1.0, 1.0)]
LINEAR, CODED = np.array(PUBLISHED).T


def check_encoded(curve):
    # Measured 6.4e-8, at the end of the straight part: its digits as published.
    np.testing.assert_allclose(curve(LINEAR), CODED, rtol=0, atol=2e-7)


def test_light_is_encoded_to_the_published_values():
    check_encoded(encode)


def test_codes_are_decoded_to_the_published_values():
    # Measured 2.5e-8 at 0.18.
    np.testing.assert_allclose(decode(CODED), LINEAR, rtol=0, atol=1e-7)


@pytest.mark.parametrize("fault", [lambda x: x ** (1 / 2.2), lambda x: 1.055 * x ** (1 / 2.4) - 0.055, decode])
def test_the_published_values_notice(fault):
    with pytest.raises(AssertionError):
        check_encoded(fault)


def test_all_codes_of_8_bits_come_back():
    codes = np.arange(256)

    back = np.round(255 * encode(decode(codes / 255)))

    np.testing.assert_array_equal(back, codes)
