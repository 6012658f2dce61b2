"""Metrics: numbers worked out by hand, over masked pixels only."""

from math import inf, sqrt
from types import SimpleNamespace

import pytest
import torch

import glossbench as gb
from glossbench.errors import InputError
from glossbench.metrics import METRICS

# x - y = (1, 0, -2), (0, 2, 0): squares sum to 9 over 6 numbers, y sums to 12.
TRUTH = [[1.0, 2.0, 3.0], [4.0, 0.0, 2.0]]
IMAGE = [[2.0, 2.0, 1.0], [4.0, 2.0, 2.0]]
BY_HAND = {"rms": sqrt(1.5), "relative_rms": sqrt(1.5) / 2, "mean_error": 1 / 6, "max_error": 2.0}


def image(pixels, outside=0.0):
    """Two pixels of the surface in the corners of a 2 x 2 image."""
    radiance = torch.full((2, 2, 3), outside)
    radiance[0, 0], radiance[1, 1] = torch.tensor(pixels)
    return SimpleNamespace(radiance=radiance, mask=torch.eye(2).bool())


def test_every_metric_has_its_number_here():
    assert set(METRICS.names()) == set(BY_HAND)


@pytest.mark.parametrize("name", BY_HAND)
def test_a_metric_is_the_number_worked_out_by_hand(name):
    value = gb.metric(name)(image(IMAGE), image(TRUTH))

    assert value == pytest.approx(BY_HAND[name], rel=1e-14)


@pytest.mark.parametrize("name", BY_HAND)
@pytest.mark.parametrize("outside", [1e6, float("nan")])
def test_pixels_outside_the_mask_do_not_count(name, outside):
    value = gb.metric(name)(image(IMAGE, outside), image(TRUTH))

    assert value == pytest.approx(BY_HAND[name], rel=1e-14)


@pytest.mark.parametrize("name", BY_HAND)
def test_the_numbers_notice_a_mask_that_is_ignored(name):
    picture, truth = image(IMAGE, 3.0), image(TRUTH)
    truth.mask = torch.ones(2, 2).bool()

    value = gb.metric(name)(picture, truth)

    assert value != pytest.approx(BY_HAND[name], rel=1e-3)


@pytest.mark.parametrize("name", BY_HAND)
def test_the_truth_against_itself_is_zero(name):
    assert gb.metric(name)(image(TRUTH), image(TRUTH)) == 0


def test_errors_are_summed_in_double_precision():
    truth, picture = image([[1e4] * 3] * 2), image([[1e4 + 1 / 1024] * 3] * 2)

    value = gb.metric("rms")(picture, truth)

    assert value == pytest.approx(1 / 1024, rel=1e-12)


def test_a_black_truth_has_no_relative_error():
    black, lit = image([[0.0] * 3] * 2), image(IMAGE)

    assert gb.metric("relative_rms")(black, black) == 0
    assert gb.metric("relative_rms")(lit, black) == inf


def test_lost_energy_is_a_negative_mean_error():
    value = gb.metric("mean_error")(image([[0.0] * 3] * 2), image(TRUTH))

    assert value == -2


def test_every_metric_says_its_formula_and_unit():
    for name in METRICS.names():
        metric = METRICS.get(name)
        assert metric.formula
        assert metric.unit
        assert isinstance(metric.lower_is_better, bool)


def test_an_unknown_metric_offers_the_nearest():
    with pytest.raises(InputError, match=r"^unknown metric 'rmse'; did you mean 'rms'\?$"):
        gb.metric("rmse")
