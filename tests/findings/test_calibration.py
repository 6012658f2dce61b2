"""Whether the noise of verdicts is honest: simulated comparisons, and sampled references against a sum."""

from functools import cache
from math import sqrt
from typing import NamedTuple

import numpy as np
import pytest
import torch
from torch import Tensor

from glossbench.brdf.ggx import GGX
from glossbench.envmap.lights.light import LIGHTS
from glossbench.findings.comparisons import EQUAL, FAILS, HOLDS, Side, judge_lower
from glossbench.findings.comparisons import NOISE as UNRESOLVED
from glossbench.findings.estimates import Estimate, Sample, estimate
from glossbench.metrics import METRICS
from glossbench.scene.points import image_of
from glossbench.scene.sphere import Sphere
from glossbench.shading.image import shade
from glossbench.shading.method import METHODS
from glossbench.study.claims import LowerClaim
from glossbench.truth.reference import Reference, compute_reference
from glossbench.truth.sampling import N_REPLICATES

RMS = METRICS.create("rms", {})
CLAIM = LowerClaim(text="a is better", lower="a", than="b", metric="rms")


class Seen(NamedTuple):
    """An image."""

    radiance: Tensor
    mask: Tensor


def values(image, truth: Reference) -> list[float]:
    """The metric against the reference, and against it without each group."""
    return [RMS(image, each) for each in (truth, *truth.left_out(RMS.n_groups))]


def too_sure(found: list[float]) -> list[float]:
    """The planted fault: half of the noise."""
    return [found[0], *((found[0] + each) / 2 for each in found[1:])]


# Simulated: white images with errors of 30 %, against references whose noise is half of that. A half of its variance
# is each pixel's own, the other half waves that all pixels share, as those of shared sample points are.

SIZE, ERROR, NOISE = 16, 0.3, 0.15
AT = torch.linspace(-1, 1, SIZE, dtype=torch.float64)
MASK = AT[None] ** 2 + AT[:, None] ** 2 < 1
WAVES = torch.stack(
    [wave.expand(SIZE, SIZE)[MASK] for k in (2, 4, 6) for wave in (torch.cos(k * AT)[None], torch.sin(k * AT)[:, None])]
)


@cache
def simulated(n: int, factor: float = 1.0) -> list[tuple[list[float], list[float]]]:
    """The metrics of n pairs of images; the errors of the second mirror those of the first times 1 / factor."""
    generator = torch.Generator().manual_seed(5)
    found = []
    for _ in range(n):
        errors = ERROR * torch.randn(SIZE, SIZE, 3, generator=generator, dtype=torch.float64)
        own = torch.randn(N_REPLICATES, len(WAVES[0]), 3, generator=generator, dtype=torch.float64)
        shared = torch.randn(N_REPLICATES, len(WAVES), generator=generator, dtype=torch.float64) @ WAVES / sqrt(3)
        noise = NOISE * sqrt(N_REPLICATES) * (own + shared[..., None]) / sqrt(2)
        truth = Reference.of(1 + noise, MASK, 1)
        images = [1 + factor * errors[MASK], 1 + errors.flip(1)[MASK]]
        first, second = (values(Seen(image_of(MASK, image), MASK), truth) for image in images)
        found.append((first, second))
    return found


def verdicts(pairs, spoilt=list) -> list[str]:
    return [
        judge_lower(CLAIM, *(Side(found[0], [Sample(spoilt(found), "of both")]) for found in pair), "").verdict
        for pair in pairs
    ]


def n_false(pairs, spoilt=list) -> int:
    """Of comparisons of equal methods, how many say that one is better."""
    return sum(verdict in (HOLDS, FAILS) for verdict in verdicts(pairs, spoilt))


def test_of_200_comparisons_of_equal_methods_at_most_5_percent_are_false():
    assert n_false(simulated(200)) <= 10  # measured of 2000: 3.4 %


def test_a_noise_twice_too_small_makes_too_many_false():
    assert n_false(simulated(200), too_sure) > 10  # measured of 2000: 13.5 %


def test_equal_methods_are_rarely_equal_for_certain_under_such_noise():
    """The margin of 1 % is less than the interval: no verdict is reached that the reference cannot support."""
    assert verdicts(simulated(200)).count(EQUAL) == 0


@pytest.mark.parametrize(("factor", "least"), [(0.9, 0.9), (0.95, 0.3)])
def test_the_power_to_see_a_difference(factor, least):
    """Measured of 500: 96 % of differences of 10 %, 43 % of 5 %."""
    found = verdicts(simulated(40, factor))

    assert found.count(HOLDS) >= least * 40
    assert found.count(FAILS) == 0


# Real: importance sampling of a small bright light, whose RMS error is 2.5 times the noise of a coarse reference.

N_SEEDS = 32


@cache
def against_samples_and_sum() -> tuple[list[list[float]], float]:
    """The metrics against sampled references of some seeds, and the metric against the sum."""
    light, material, view = LIGHTS.create("spots", {"resolution": 32}).cubemap(), GGX(alpha=0.3), Sphere(resolution=8)
    image = shade(METHODS.create("importance_sampling", {"samples": 1024}), light, material, view)
    coarse = [compute_reference(light, material, view, 1e-9, 1024, seed, method="sampling") for seed in range(N_SEEDS)]
    return [values(image, each) for each in coarse], RMS(
        image, compute_reference(light, material, view, 1e-5, method="summation")
    )


def estimated(found: list[float]) -> Estimate:
    return estimate(lambda sides: float(sides[0][0]), [[Sample(found)]])


def covered(spoilt=list) -> int:
    """How many intervals contain the metric against the sum."""
    found, right = against_samples_and_sum()
    return sum(estimated(spoilt(each)).is_unresolved(right) for each in found)


def standard_errors_off(numbers) -> float:
    """By how many standard errors of their mean numbers are off the metric against the sum."""
    off = np.array(numbers) - against_samples_and_sum()[1]
    return float(off.mean() / (off.std(ddof=1) / sqrt(N_SEEDS)))


def test_intervals_against_sampled_references_contain_the_metric_against_the_sum():
    """Of 160 seeds, 153 did (95.6 %)."""
    assert covered() >= 29


def test_intervals_of_half_the_noise_do_not():
    """Of 160 seeds, 122 did (76 %)."""
    assert covered(too_sure) < 29


def test_a_metric_without_its_bias_is_that_against_the_sum():
    """Of 160 seeds: 0.4 standard errors off."""
    assert abs(standard_errors_off([estimated(each).value for each in against_samples_and_sum()[0]])) < 2.5


def test_a_metric_with_its_bias_is_too_large():
    assert standard_errors_off([each[0] for each in against_samples_and_sum()[0]]) > 3.5


# At the noise floor: the values of two cells under constant light, whose errors are 0.01 and 0.25 of the stated error.

AT_FLOOR = [5.6e-5, *[2.82e-3] * 4, *[2.84e-3] * 4], [1.27e-3, *[3.30e-3] * 4, *[2.90e-3] * 4]


def test_a_ratio_at_the_noise_floor_is_not_resolved():
    """Without its bias this ratio would be -6, and 'holds' the verdict."""
    found = [estimate(lambda sides: float(sides[0][0] / sides[1][0]), [[Sample(side, "r")] for side in pair])
             for pair in (AT_FLOOR, AT_FLOOR[::-1])]  # fmt: skip

    assert [each.is_unresolved(1) for each in found] == [True, True]
    assert verdicts([AT_FLOOR, AT_FLOOR[::-1]]) == [UNRESOLVED, UNRESOLVED]


def test_a_reference_with_a_hundredth_of_the_noise_resolves_it():
    """Noise lifts an RMS by its square."""
    pair = tuple([found[0], *(found[0] + (each - found[0]) / 100**2 for each in found[1:])] for found in AT_FLOOR)

    assert verdicts([pair, pair[::-1]]) == [HOLDS, FAILS]
