"""Two programs' images of one scene: the lights that both are given, and whether their radiance agrees."""

from functools import cache
from math import sqrt

import numpy as np
from scipy.stats import chi2, norm
from scipy.stats import t as student

import glossbench as gb
from glossbench.truth.sampling import N_REPLICATES
from oracles.mitsuba_side import (
    N_RENDERS,
    emitter,
    interpolant,
)

LIGHTS = {
    "gradient": lambda: gb.light("gradient", resolution=32),
    "spots": lambda: gb.light("spots", seed=2, n_spots=12, contrast=3000, resolution=64),
    "orientation": lambda: gb.light("orientation", resolution=16),
    "grace": lambda: gb.light("grace_cross.hdr", resolution=32),
}


@cache
def light_of(name):
    return LIGHTS[name]()


@cache
def their_light(name):
    return emitter(interpolant(light_of(name).faces.double().numpy()))


def scores(a, error_a, b, error_b):
    """Standard normal scores of a - b by Welch's test: Student's t of n - 1 degrees has tails that are not normal's."""
    square_a, square_b = error_a**2, error_b**2
    degrees = (square_a + square_b) ** 2 / (square_a**2 / (N_REPLICATES - 1) + square_b**2 / (N_RENDERS - 1))
    return norm.isf(student.sf(np.abs(a - b) / np.sqrt(square_a + square_b), degrees))


def check_agreement(radiance, standard_error, renders, n_cases):
    """Three tests, each passed with 99 % by all cases together (Sidak) if the two images are of the same thing."""
    p = 1 - 0.99 ** (1 / n_cases)

    z = scores(radiance, standard_error, renders.mean(0), renders.std(0, ddof=1) / sqrt(N_RENDERS))
    assert np.abs(z).max() < norm.isf((1 - (1 - p) ** (1 / z.size)) / 2)

    # Mitsuba's pixels are independent of each other, its channels are not.
    squares = (z**2).sum(0)
    assert (squares < chi2.isf(p / 6, len(z))).all()
    assert (squares > chi2.ppf(p / 6, len(z))).all()

    # Our pixels share their samples: the error of their mean is at most the mean of their errors.
    means = renders.mean(1)
    mean_z = scores(radiance.mean(0), standard_error.mean(0), means.mean(0), means.std(0, ddof=1) / sqrt(N_RENDERS))
    assert np.abs(mean_z).max() < norm.isf(p / 6)
