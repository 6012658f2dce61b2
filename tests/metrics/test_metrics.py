"""Metrics: numbers worked out by hand, closed forms and scalar transcriptions, over masked pixels only."""

import math
from math import inf, sqrt
from statistics import median
from types import SimpleNamespace

import flip_evaluator
import numpy as np
import pytest
import torch

import glossbench as gb
from glossbench.errors import InputError
from glossbench.metrics import METRICS, perceptual, pixelwise
from glossbench.metrics.perceptual import choose_exposures

# x - y = (1, 0, -2), (0, 2, 0): squares sum to 9 over 6 numbers, y sums to 12.
TRUTH = [[1.0, 2.0, 3.0], [4.0, 0.0, 2.0]]
IMAGE = [[2.0, 2.0, 1.0], [4.0, 2.0, 2.0]]
BY_HAND = {
    "rms": sqrt(1.5),
    "relative_rms": sqrt(1.5) / 2,
    "relative_l1": 5 / 12,
    "mean_error": 1 / 6,
    "mean_absolute_error": 5 / 6,
    "mean_relative_error": (1 / 1 + 2 / 3) / 6,
    "median_absolute_error": (3 / 3 + 2 / 3) / 2,  # of the two pixels
    "median_relative_error": (1 / 1 + 2 / 3) / 6,
    "max_error": 2.0,
    "mrse": (1 / 1.01 + 4 / 9.01 + 4 / 0.01) / 6,
    "mrse_trimmed": (1 / 1.01 + 4 / 9.01 + 4 / 0.01) / 6,  # a thousandth of two pixels is zero pixels
    "smape": (2 / 3 + 4 / 4 + 4 / 2) / 6,
    "shape_error": 70 / 13 / 12,  # x sums to 13: |12 / 13 x - y| = (11, 2, 27), (4, 24, 2), over 13
}
ON_A_DISPLAY = {"flip", "ssim"}
EVERY = sorted({*BY_HAND, *ON_A_DISPLAY})


def image(pixels, outside=0.0):
    """Two pixels of the surface in the corners of a 2 x 2 image."""
    radiance = torch.full((2, 2, 3), outside)
    radiance[0, 0], radiance[1, 1] = torch.tensor(pixels)
    return SimpleNamespace(radiance=radiance, mask=torch.eye(2).bool())


def full(radiance):
    """An image whose every pixel shows the surface."""
    return SimpleNamespace(radiance=torch.as_tensor(radiance), mask=torch.ones(np.shape(radiance)[:2]).bool())


def uniform(colour, size=24):
    return full(np.broadcast_to(np.array(colour, np.float32), (size, size, 3)).copy())


def noisy_pair(seed=0, size=32, spread=0.3):
    """A disc of a reference over two decades of radiance, and an image with relative errors and one firefly."""
    rng = np.random.default_rng(seed)
    y = 10 ** rng.uniform(-1, 1, (size, size, 3))
    x = y * (1 + spread * rng.standard_normal(y.shape))
    x[size // 2, size // 2] *= 50
    centre = np.arange(size) - (size - 1) / 2
    mask = torch.from_numpy(np.hypot(centre[:, None], centre) < 0.45 * size)
    return [SimpleNamespace(radiance=torch.from_numpy(a) * mask[..., None], mask=mask) for a in (x, y)]


def test_every_metric_is_tested_here():
    assert METRICS.names() == EVERY


@pytest.mark.parametrize("name", BY_HAND)
def test_a_metric_is_the_number_worked_out_by_hand(name):
    value = gb.metric(name)(image(IMAGE), image(TRUTH))

    assert value == pytest.approx(BY_HAND[name], rel=1e-15, abs=0)  # measured 1.3e-16


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("outside", [1e6, float("nan")])
def test_pixels_outside_the_mask_do_not_count(name, outside):
    metric = gb.metric(name)

    value = metric(image(IMAGE, outside), image(TRUTH, outside))

    assert value == metric(image(IMAGE), image(TRUTH))


@pytest.mark.parametrize("name", BY_HAND)
def test_the_numbers_notice_a_mask_that_is_ignored(name):
    picture, truth = image(IMAGE, 3.0), image(TRUTH)
    picture.mask = truth.mask = torch.ones(2, 2).bool()

    value = gb.metric(name)(picture, truth)

    assert value != pytest.approx(BY_HAND[name], rel=1e-3)


@pytest.mark.parametrize("name", EVERY)
def test_the_truth_against_itself_is_perfect(name):
    _, truth = noisy_pair()
    metric = gb.metric(name)

    value, errors = metric(truth, truth), metric.error_map(truth, truth)

    assert value == (0 if metric.lower_is_better else 1)
    assert not errors.any()


def test_errors_are_summed_in_double_precision():
    truth, picture = image([[1e4] * 3] * 2), image([[1e4 + 1 / 1024] * 3] * 2)

    value = gb.metric("rms")(picture, truth)

    assert value == pytest.approx(1 / 1024, rel=1e-15, abs=0)  # measured 0


def test_a_black_truth_has_no_relative_error():
    black, lit = image([[0.0] * 3] * 2), image(IMAGE)

    for name in ("relative_rms", "relative_l1", "shape_error"):
        assert gb.metric(name)(black, black) == 0
        assert gb.metric(name)(lit, black) == inf


@pytest.mark.parametrize("power", [1, 2, 3])
def test_the_error_of_a_shape_does_not_depend_on_the_energy(power):
    """Two lobes cos^4 and cos^8 as numbers: the sum by hand; twice as much light changes nothing."""
    cosines = np.linspace(0.01, 1, 300).reshape(10, 10, 3)
    wide, narrow, bright = (full(a) for a in (cosines**4, cosines**8, 2 * cosines**4))
    metric = gb.metric("shape_error", power=power)

    value = metric(wide, narrow)

    numbers = list(zip((cosines**4).ravel(), (cosines**8).ravel(), strict=True))
    assert value == pytest.approx(shape_error(numbers, power), rel=1e-13)
    assert metric(bright, narrow) == pytest.approx(value, rel=1e-13)
    assert metric(bright, wide) < 1e-15


def test_a_black_image_has_all_of_the_shape_wrong():
    assert gb.metric("shape_error")(image([[0.0] * 3] * 2), image(TRUTH)) == 1


def test_lost_energy_is_a_negative_mean_error():
    value = gb.metric("mean_error")(image([[0.0] * 3] * 2), image(TRUTH))

    assert value == -2


# Closed forms and scalar transcriptions of pixel metrics.


@pytest.mark.parametrize("e", [-1.0, -0.2, 0.1, 3.0])
def test_a_constant_relative_error_has_closed_forms(e):
    _, truth = noisy_pair()
    picture = SimpleNamespace(radiance=(1 + e) * truth.radiance, mask=truth.mask)

    # Measured 1.1e-13, 2.0e-13 and 8.7e-16.
    assert gb.metric("mrse", epsilon=1e-14)(picture, truth) == pytest.approx(e * e, rel=5e-13, abs=0)
    assert gb.metric("mrse_trimmed", epsilon=1e-14, fraction=0.5)(picture, truth) == pytest.approx(
        e * e, rel=1e-12, abs=0
    )
    assert gb.metric("smape")(picture, truth) == pytest.approx(2 * abs(e) / (2 + e), rel=4e-15, abs=0)


def test_smape_of_black_against_black_is_zero_and_against_light_is_two():
    black, lit = image([[0.0] * 3] * 2), image([[1e-3] * 3] * 2)

    assert gb.metric("smape")(black, black) == 0
    assert gb.metric("smape")(lit, black) == gb.metric("smape")(black, lit) == 2


def shape_error(numbers, p):
    """The part of the volume in a wrong place, counted twice."""
    volumes = [sum(pair[i] ** p for pair in numbers) for i in (0, 1)]
    return sum(abs(x**p / volumes[0] - y**p / volumes[1]) for x, y in numbers)


def scalar(name, picture, truth):
    """Metrics in plain loops over numbers."""
    pixels = [
        list(zip(x, y, strict=True))
        for x_row, y_row, m_row in zip(picture.radiance.tolist(), truth.radiance.tolist(), truth.mask, strict=True)
        for x, y, m in zip(x_row, y_row, m_row, strict=True)
        if m
    ]
    numbers = [pair for pixel in pixels for pair in pixel]
    n = len(numbers)
    squared = sum((x - y) ** 2 for x, y in numbers) / n
    relative = sorted(sum((x - y) ** 2 / (y * y + 0.01) for x, y in pixel) / 3 for pixel in pixels)
    return {
        "rms": sqrt(squared),
        "relative_rms": sqrt(squared) / (sum(y for _, y in numbers) / n),
        "relative_l1": sum(abs(x - y) for x, y in numbers) / sum(y for _, y in numbers),
        "mean_error": sum(x - y for x, y in numbers) / n,
        "mean_absolute_error": sum(abs(x - y) for x, y in numbers) / n,
        "mean_relative_error": sum(abs(x - y) / y for x, y in numbers if y > 0) / n,
        "median_absolute_error": median(sum(abs(x - y) for x, y in pixel) / 3 for pixel in pixels),
        "median_relative_error": median(sum(abs(x - y) / y for x, y in pixel if y > 0) / 3 for pixel in pixels),
        "max_error": max(abs(x - y) for x, y in numbers),
        "mrse": sum(relative) / len(relative),
        "mrse_trimmed": sum(relative[: len(relative) - len(relative) // 1000])
        / (len(relative) - len(relative) // 1000),
        "smape": sum(2 * abs(x - y) / (abs(x) + abs(y)) for x, y in numbers) / n,
        "shape_error": shape_error(numbers, 1),
    }[name]


@pytest.mark.parametrize("name", BY_HAND)
def test_a_metric_agrees_with_plain_loops(name):
    check_loops(gb.metric(name))


class OverTheImage(pixelwise.MRSE):
    """Planted: divides by the image, as Lehtinen et al. do for training."""

    name = "mrse"

    def errors(self, x, y, mask):
        return super().errors(y, x, mask)


class Halved(pixelwise.SMAPE):
    """Planted: the factor 2 left out."""

    name = "smape"

    def errors(self, x, y, mask):
        return super().errors(x, y, mask) / 2


class TrimmedOfItsBest(pixelwise.TrimmedMRSE):
    """Planted: the wrong end is cut."""

    name = "mrse_trimmed"

    def pooled(self, errors):
        return -super().pooled(-errors)


class Unpooled(pixelwise.RMS):
    """Planted: the mean of the roots."""

    name = "rms"

    def pooled(self, errors):
        return float(errors.mean())


@pytest.mark.parametrize("fault", [OverTheImage, Halved, TrimmedOfItsBest, Unpooled])
def test_the_loops_notice(fault):
    with pytest.raises(AssertionError):
        check_loops(fault())


def check_loops(metric):
    picture, truth = noisy_pair(size=48)  # 1468 pixels: one is trimmed

    value = metric(picture, truth)

    # Measured 1.1e-15, the order of the sums.
    assert value == pytest.approx(scalar(metric.name, picture, truth), rel=5e-15, abs=0)


def test_trimming_drops_the_firefly_and_no_more_than_its_fraction():
    picture, truth = noisy_pair(size=48)
    n = int(truth.mask.sum())

    whole, trimmed = gb.metric("mrse")(picture, truth), gb.metric("mrse_trimmed")(picture, truth)

    errors = np.sort(gb.metric("mrse").error_map(picture, truth)[truth.mask])
    assert n // 1000 == 1
    assert whole * n - trimmed * (n - 1) == pytest.approx(errors[-1], rel=1e-15)  # measured 2.1e-16
    assert gb.metric("mrse_trimmed", fraction=0.0)(picture, truth) == pytest.approx(
        whole, rel=1e-15, abs=0
    )  # measured 1.4e-16


# Spaces.

SEEN = {  # by hand, of a number
    "linear": lambda v: v,
    "clamped": lambda v: min(max(v, 0.0), 1.0),
    "srgb8": lambda v: round(255 * display_value(min(max(v, 0.0), 1.0))) / 255,
    "log": lambda v: math.log(1 + max(v, 0.0)),
}


def display_value(v):
    """IEC 61966-2-1."""
    return 12.92 * v if v <= 0.0031308 else 1.055 * v ** (1 / 2.4) - 0.055


def in_space(name, picture):
    seen = [[[SEEN[name](v) for v in pixel] for pixel in row] for row in picture.radiance.tolist()]
    return SimpleNamespace(radiance=torch.tensor(seen, dtype=torch.float64), mask=picture.mask)


@pytest.mark.parametrize("metric", ["rms", "mean_error", "median_absolute_error", "smape"])
@pytest.mark.parametrize("space", SEEN)
def test_a_space_is_that_of_each_number(space, metric):
    picture, truth = noisy_pair()
    picture.radiance[16, 10] = -0.5  # negative radiance is black

    value = gb.metric(metric, space=space)(picture, truth)

    assert value == pytest.approx(gb.metric(metric)(*(in_space(space, p) for p in (picture, truth))), rel=1e-13, abs=0)
    others = [gb.metric(metric)(*(in_space(s, p) for p in (picture, truth))) for s in SEEN if s != space]
    assert all(value != pytest.approx(other, rel=1e-4) for other in others)


def test_an_error_above_white_is_not_seen_when_clamped():
    white, whiter = image([[2.0] * 3] * 2), image([[3.0] * 3] * 2)

    assert gb.metric("rms", space="clamped")(white, whiter) == gb.metric("rms", space="srgb8")(white, whiter) == 0
    assert gb.metric("rms", space="log")(white, whiter) == pytest.approx(math.log(4 / 3))


# Maps.

FROM_MAP = {
    "rms": lambda e: sqrt((e**2).mean()),
    "relative_rms": lambda e: sqrt((e**2).mean()),
    "relative_l1": lambda e: e.mean(),
    "mean_error": lambda e: e.mean(),
    "max_error": lambda e: e.max(),
    "mrse": lambda e: e.mean(),
    "mrse_trimmed": lambda e: np.sort(e)[: e.size - e.size // 1000].mean(),
    "smape": lambda e: e.mean(),
    "shape_error": lambda e: e.mean(),
    "mean_absolute_error": lambda e: e.mean(),
    "mean_relative_error": lambda e: e.mean(),
    "median_absolute_error": np.median,
    "median_relative_error": np.median,
    "ssim": lambda e: 1 - e.mean(),
    "flip": lambda e: e.mean(),
}


@pytest.mark.parametrize("name", EVERY)
def test_the_map_determines_the_number(name):
    picture, truth = noisy_pair()
    metric = gb.metric(name)

    errors = metric.error_map(picture, truth)

    inside = errors[truth.mask]
    assert metric(picture, truth) == pytest.approx(FROM_MAP[name](inside), rel=1.5e-15, abs=0)  # measured 2.7e-16
    assert errors.shape == truth.mask.shape
    assert not errors[~truth.mask].any()
    assert (inside.min() < 0) == metric.signed
    assert inside.std() > 0


@pytest.mark.parametrize(
    ("name", "expected"),
    [("rms", sqrt(5 / 3)), ("mean_error", -1 / 3), ("max_error", 2.0), ("smape", (2 / 3 + 1) / 3),
     ("relative_rms", sqrt(5 / 3) / 2), ("relative_l1", 1 / 2), ("mrse", (1 / 1.01 + 4 / 9.01) / 3)],
)  # fmt: skip
def test_a_map_holds_the_error_of_each_pixel(name, expected):
    errors = gb.metric(name).error_map(image(IMAGE), image(TRUTH))

    assert errors[0, 0] == pytest.approx(expected, rel=1e-15, abs=0)  # measured 0


# What cannot be compared.


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("ask", ["__call__", "error_map"])
def test_what_cannot_be_compared_is_one_clear_line(name, ask):
    compare, lit = getattr(gb.metric(name), ask), image(IMAGE)
    larger = full(torch.ones(4, 3, 3))
    elsewhere = SimpleNamespace(radiance=lit.radiance, mask=~lit.mask)
    hidden = SimpleNamespace(radiance=lit.radiance, mask=torch.zeros(2, 2).bool())
    grey = SimpleNamespace(radiance=torch.ones(2, 2), mask=lit.mask)

    for picture, truth, line in (
        (larger, lit, "image and reference must be of one view, got 3 x 4 and 2 x 2 pixels"),
        (elsewhere, lit, "image and reference must be of one view, but 4 pixels are in one mask only"),
        (hidden, hidden, "the mask of the reference is empty: no pixel shows the surface"),
        (lit, image([[1.0, inf, 0.0]] * 2), "radiance of the reference must be finite, but 2 of 2 masked pixels are"),
        (image([[1.0] * 3, [math.nan] * 3]), lit, "radiance of the image must be finite, but 1 of 2 masked pixels"),
        (grey, lit, r"radiance of the image must be (2, 2, 3), as its mask, got (2, 2)"),
    ):
        with pytest.raises(InputError) as caught:
            compare(picture, truth)
        assert str(caught.value).startswith(line)
        assert "\n" not in str(caught.value)


# On a display: exposures.


def aces(x):
    """The curve of Narkowicz 2015, with the pre-exposure of 0.6 taken out as HDR-FLIP does."""
    x = 0.6 * x
    return x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)


def luminance(radiance):
    return radiance[..., 0] * 0.2126 + radiance[..., 1] * 0.7152 + radiance[..., 2] * 0.0722


def arrays(picture):
    return picture.radiance.double().numpy(), picture.mask.numpy()


def test_exposures_bring_the_brightest_and_the_median_to_85_percent():
    y, mask = arrays(noisy_pair()[1])

    start, stop, n_steps = choose_exposures(y, mask)

    # Measured 2.6e-16 and 1.3e-16.
    assert aces(luminance(y[mask]).max() * 2**start) == pytest.approx(0.85, rel=1.3e-15, abs=0)
    assert aces(np.median(luminance(y[mask])) * 2**stop) == pytest.approx(0.85, rel=1.3e-15, abs=0)
    assert n_steps == max(2, math.ceil(stop - start))


@pytest.mark.parametrize("seed", range(5))
def test_exposures_are_those_of_the_authors_where_all_pixels_show_the_surface(seed):
    y = np.random.default_rng(seed).lognormal(0, 1 + seed, (16, 16, 3)).astype(np.float32)

    start, stop, n_steps = choose_exposures(y.astype(np.float64), np.ones((16, 16), bool))

    *_, theirs = flip_evaluator.evaluate(y, y, "HDR", applyMagma=False)
    # Measured 1.1e-6: theirs is single precision; and their median is the upper of the middle two.
    assert start == pytest.approx(theirs["startExposure"], abs=2e-6)
    upper = np.sort(luminance(y).ravel())[128]
    shift = math.log2(upper / np.median(luminance(y)))
    assert stop - shift == pytest.approx(theirs["stopExposure"], abs=2e-6)  # measured 7.4e-7
    assert n_steps == theirs["numExposures"]


def test_a_black_background_does_not_move_the_exposures():
    y, mask = arrays(noisy_pair()[1])

    with_border = choose_exposures(np.pad(y, ((40, 40), (40, 40), (0, 0))), np.pad(mask, 40))

    assert with_border == choose_exposures(y, mask)


def test_exposures_of_dark_references_are_finite():
    y, mask = np.zeros((4, 4, 3)), np.ones((4, 4), bool)
    one = y.copy()
    one[0, 0], one[1:] = 8.0, -1e-3

    assert choose_exposures(y, mask) == (0, 0, 2)
    start, stop, n_steps = choose_exposures(one, mask)
    assert start == stop
    assert n_steps == 2


# On a display: FLIP.


def uniform_flip(x, y):
    """FLIP of two uniform images under their one exposure, a colour at a time: no edge, and every filter is one.

    Andersson et al. 2020 sections 4.1 and 5, with the matrix and the white of IEC 61966-2-1.
    """
    to_xyz = ((0.4124564, 0.3575761, 0.1804375), (0.2126729, 0.7151522, 0.0721750), (0.0193339, 0.1191920, 0.9503041))

    def hunt_lab(rgb):
        xyz = [sum(m * c for m, c in zip(row, rgb, strict=True)) / sum(row) for row in to_xyz]
        f = [t ** (1 / 3) if t > (6 / 29) ** 3 else t / (3 * (6 / 29) ** 2) + 4 / 29 for t in xyz]
        lightness = 116 * f[1] - 16
        return lightness, 0.01 * lightness * 500 * (f[0] - f[1]), 0.01 * lightness * 200 * (f[1] - f[2])

    def hyab(p, q):
        return abs(p[0] - q[0]) + math.hypot(p[1] - q[1], p[2] - q[2])

    def white_at_85_percent():
        low, high = 0.0, 10.0
        for _ in range(100):
            middle = (low + high) / 2
            low, high = (middle, high) if aces(middle) < 0.85 else (low, middle)
        return low

    exposure = white_at_85_percent() / luminance(np.array(y))
    shown = [hunt_lab([min(aces(c * exposure), 1) for c in colour]) for colour in (x, y)]
    largest = hyab(hunt_lab((0, 1, 0)), hunt_lab((0, 0, 1))) ** 0.7
    error, bend = hyab(*shown) ** 0.7, 0.4 * largest
    return error / bend * 0.95 if error < bend else 0.95 + (error - bend) / (largest - bend) * 0.05


PAIRS = [
    ((0.5, 0.5, 0.5), (0.6, 0.6, 0.6)),
    ((30.0, 20.0, 10.0), (20.0, 20.0, 20.0)),
    ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
    ((0.1, 0.9, 0.1), (0.9, 0.1, 0.9)),
    ((1e-3, 1.1e-3, 1e-3), (1e-3, 1e-3, 1e-3)),
]


@pytest.mark.parametrize(("x", "y"), PAIRS)
def test_flip_of_uniform_images_is_the_colour_difference_of_its_paper(x, y):
    check_uniform_flip(x, y)


@pytest.mark.parametrize("planted", [lambda e: (e[0] + 1, e[1] + 1, 2), lambda e: (e[0] - 1, e[1], 2)])
def test_the_colour_difference_notices_another_exposure(planted, monkeypatch):
    monkeypatch.setattr(perceptual, "choose_exposures", lambda y, mask: planted(choose_exposures(y, mask)))

    with pytest.raises(AssertionError):
        check_uniform_flip(*PAIRS[0])


def check_uniform_flip(x, y):
    value = gb.metric("flip")(uniform(x), uniform(y))

    # Measured 5.5e-4, of the rounded matrix and white.
    assert value == pytest.approx(uniform_flip(x, y), rel=1e-3)


def test_flip_grows_with_the_error_and_stays_within_its_range():
    values, (_, truth) = [], noisy_pair()
    for spread in (0.0, 0.01, 0.03, 0.1, 0.3, 1.0):
        picture = SimpleNamespace(radiance=truth.radiance * (1 + spread), mask=truth.mask)
        values.append(gb.metric("flip")(picture, truth))

    assert values[0] == 0
    assert values == sorted(set(values))
    assert values[-1] < 1


@pytest.mark.parametrize("name", sorted(ON_A_DISPLAY))
@pytest.mark.parametrize("scale", [2.0**-60, 0.3, 7e11])
def test_what_is_seen_does_not_depend_on_the_unit_of_radiance(name, scale):
    picture, truth = noisy_pair()
    scaled = [SimpleNamespace(radiance=scale * each.radiance, mask=each.mask) for each in (picture, truth)]

    value = gb.metric(name)(*scaled)

    # Measured 0: of powers of two exactly so, of others because exposures begin at 0.
    assert value == pytest.approx(gb.metric(name)(picture, truth), rel=1e-7)


def test_all_images_of_a_reference_are_looked_at_under_the_same_exposures(monkeypatch):
    (picture, truth), asked = noisy_pair(), []
    bright = SimpleNamespace(radiance=100 * picture.radiance, mask=truth.mask)
    evaluate = flip_evaluator.evaluate

    def recording(*images, parameters, **options):
        *result, used = evaluate(*images, parameters=parameters, **options)
        asked.append(used)
        return *result, used

    monkeypatch.setattr(flip_evaluator, "evaluate", recording)
    for each in (picture, bright, truth):
        gb.metric("flip")(each, truth)

    start, stop, n_steps = choose_exposures(*arrays(truth))
    assert asked[0] == asked[1] == asked[2]
    assert asked[0]["stopExposure"] - asked[0]["startExposure"] == pytest.approx(
        stop - start, abs=6e-7
    )  # measured 1.2e-7
    assert asked[0]["numExposures"] == n_steps
    assert asked[0]["ppd"] == 67


@pytest.mark.parametrize("name", sorted(ON_A_DISPLAY))
@pytest.mark.parametrize(
    ("x", "y"),
    [(0.0, 0.0), (1.0, 0.0), (-1.0, 1.0), (1e30, 1e-30), (1e-30, 1e30), (3e38, 3e38)],
)
def test_extreme_radiance_is_seen_without_a_word(name, x, y, capfd):
    picture, truth = uniform([x] * 3, size=3), uniform([y] * 3, size=3)

    value = gb.metric(name)(picture, truth)

    assert 0 <= value <= 1
    assert (value == (0 if name == "flip" else 1)) == (x == y)
    assert capfd.readouterr() == ("", "")


def test_negative_radiance_is_seen_as_black():
    truth = uniform([1.0] * 3)

    for name in ON_A_DISPLAY:
        metric = gb.metric(name)
        assert metric(uniform([-2.0] * 3), truth) == metric(uniform([0.0] * 3), truth)


def test_a_viewer_far_away_sees_less_of_fine_noise():
    picture, truth = noisy_pair()

    near, far = (gb.metric("flip", pixels_per_degree=n)(picture, truth) for n in (20.0, 200.0))

    assert far < 0.9 * near


# On a display: SSIM.


def shown(value, stops):
    """A number through the ACES and the sRGB curve."""
    linear = min(max(aces(max(value, 0.0) * 2**stops), 0.0), 1.0)
    return 12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1 / 2.4) - 0.055


def scalar_ssim(picture, truth, row, column):
    """SSIM of the 11 x 11 window around one pixel, in plain loops; black past the edges of image and mask."""
    start, stop, _ = choose_exposures(*arrays(truth))
    height, width = truth.mask.shape
    means = []
    for channel in range(3):
        weights, xs, ys = [], [], []
        for i in range(row - 5, row + 6):
            for j in range(column - 5, column + 6):
                inside = 0 <= i < height and 0 <= j < width and bool(truth.mask[i, j])
                weights.append(math.exp(-((i - row) ** 2 + (j - column) ** 2) / (2 * 1.5**2)))
                for values, of in ((xs, picture), (ys, truth)):
                    value = float(of.radiance[i, j, channel]) if inside else 0.0
                    values.append(shown(value, (start + stop) / 2))
        total = sum(weights)

        def mean(values, weights=weights, total=total):
            return sum(w * v for w, v in zip(weights, values, strict=True)) / total

        mx, my = mean(xs), mean(ys)
        vx, vy = mean([(v - mx) ** 2 for v in xs]), mean([(v - my) ** 2 for v in ys])
        covariance = mean([(a - mx) * (b - my) for a, b in zip(xs, ys, strict=True)])
        c1, c2 = 0.01**2, 0.03**2
        means.append((2 * mx * my + c1) * (2 * covariance + c2) / ((mx**2 + my**2 + c1) * (vx + vy + c2)))
    return sum(means) / 3


def test_ssim_of_a_window_is_that_of_its_paper():
    check_ssim()


@pytest.mark.parametrize(
    "planted", [lambda image, stops: np.clip(image, 0, 1), lambda image, stops: shown_brighter(image, stops)]
)
def test_the_window_notices_another_display(planted, monkeypatch):
    monkeypatch.setattr(perceptual, "display", planted)

    with pytest.raises(AssertionError):
        check_ssim()


def shown_brighter(image, stops, displayed=perceptual.display):
    return displayed(image, stops + 1)


def check_ssim():
    picture, truth = noisy_pair()
    errors = gb.metric("ssim").error_map(picture, truth)

    for row, column in ((16, 16), (10, 20), (16, 2), (5, 8)):  # two inside, two at the silhouette
        assert truth.mask[row, column]
        # Measured 1.2e-15.
        assert 1 - errors[row, column] == pytest.approx(scalar_ssim(picture, truth, row, column), abs=6e-15)


def test_ssim_of_uniform_images_compares_their_means_alone():
    x, y = uniform([0.5] * 3), uniform([1.0] * 3)
    start, stop, _ = choose_exposures(*arrays(y))
    a, b = (shown(value, (start + stop) / 2) for value in (0.5, 1.0))

    errors = gb.metric("ssim").error_map(x, y)

    # Measured 6e-11: the library subtracts squares of means.
    assert errors[12, 12] == pytest.approx(1 - (2 * a * b + 1e-4) / (a * a + b * b + 1e-4), rel=3e-10, abs=0)


# What a metric says of itself.


@pytest.mark.parametrize("name", EVERY)
def test_every_metric_says_what_it_is(name):
    metric = METRICS.get(name)

    assert metric.formula
    assert metric.unit
    assert metric.map_formula
    assert metric.signed == (name == "mean_error")
    assert metric.lower_is_better == (name != "ssim")


def test_an_unknown_metric_offers_the_nearest():
    with pytest.raises(InputError, match=r"^unknown metric 'rmse'; did you mean 'rms'\?$"):
        gb.metric("rmse")


@pytest.mark.parametrize(
    ("name", "options"),
    [("mrse", {"epsilon": 0.0}), ("mrse_trimmed", {"fraction": 1.0}), ("flip", {"pixels_per_degree": 0.0}),
     ("flip", {"pixels_per_degree": inf})],
)  # fmt: skip
def test_an_option_out_of_bounds_is_one_clear_line(name, options):
    with pytest.raises(InputError, match=f"^{name}.{next(iter(options))} must be"):
        gb.metric(name, **options)
