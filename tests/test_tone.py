"""Tone curves, against their formulas in plain numbers."""

import numpy as np
import pytest
import torch

from glossbench.tone import aces, invert_aces, reinhard


def test_aces_is_the_fit_of_narkowicz_of_radiance_times_its_pre_exposure():
    x = np.array([0.0, 0.18, 1.0, 5.0])
    v = 0.6 * x

    expected = np.clip(v * (2.51 * v + 0.03) / (v * (2.43 * v + 0.59) + 0.14), 0, 1)

    np.testing.assert_allclose(aces(x), expected, rtol=1e-12)


def test_the_inverse_of_aces_is_its_inverse():
    assert aces(np.array(invert_aces(0.85))) == pytest.approx(0.85, rel=1e-12)


def test_reinhard_divides_by_one_plus_the_luminance():
    radiance = torch.tensor([[1.0, 0.5, 0.25], [100.0, 0.0, 0.0]], dtype=torch.float64)
    luminance = 0.2126 * 1.0 + 0.7152 * 0.5 + 0.0722 * 0.25

    mapped = reinhard(radiance)

    # Measured 1e-8: the weights are rounded to single precision.
    np.testing.assert_allclose(mapped[0], radiance[0] / (1 + luminance), rtol=1e-7)
    assert mapped[1].tolist() == [1.0, 0.0, 0.0]
