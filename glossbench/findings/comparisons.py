"""Comparisons: two numbers, or one and its bounds, with the noise of the reference between them."""

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from glossbench.metrics import METRICS
from glossbench.study.claims import Bounds, RatioClaim, ValueClaim

HOLDS, FAILS, NOISE, UNTESTED = "holds", "does not hold", "within noise", "not tested"
Row = dict[str, Any]


class Case(NamedTuple):
    """One comparison of a claim; `shown` is the number that the summary tells about."""

    where: str
    a: float
    b: float | None
    bound: Any
    noise: float
    verdict: str
    shown: float


def finite(value: Any) -> float | None:
    """The value where it is a finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(value):
        return None
    return float(value)


def noise_of(a: Mapping[str, Any], b: Mapping[str, Any], column: str) -> float:
    """RMS of the reference's standard error in the unit of a column; zero where it does not enter."""
    # The largest of many errors moves with the largest standard error, not with their mean.
    source = "reference_peak_noise" if column == "max_error" else "reference_noise"
    relative = column.startswith("relative_")
    if not relative and not (column in METRICS.names() and METRICS.get(column).unit == "radiance"):
        return 0.0
    noises = []
    for row in (a, b):
        noise = finite(row.get(source, row.get("reference_noise"))) or 0.0
        mean = finite(row.get("reference_mean")) or 0.0
        noises.append(noise if not relative else noise / mean if mean > 0 else 0.0)
    return max(noises)


def verdict_on(holds: bool, distances: Iterable[float], noise: float) -> str:
    """The verdict on one comparison; within noise where a distance to a bound is below twice the noise."""
    if any(abs(distance) < 2 * noise for distance in distances):
        return NOISE
    return HOLDS if holds else FAILS


def inside(value: float, bounds: Bounds) -> bool:
    """Whether a number lies within bounds."""
    low, high = bounds
    return (low is None or value >= low) and (high is None or value <= high)


def _edges(bounds: Bounds, column: str) -> list[float]:
    """The bounds that noise may carry a number across: no error but the signed one goes below zero."""
    return [bound for bound in bounds if bound is not None and (bound != 0 or column == "mean_error")]


def lower_case(a: float, b: float, noise: float, where: str) -> Case:
    """a < b"""
    return Case(where, a, b, None, noise, verdict_on(a < b, [a - b], noise), a / b if b else math.inf)


def ratio_case(claim: RatioClaim, a: float, b: float, noise: float, where: str) -> Case:
    """a / b within the claim's bounds."""
    edges = [a - edge * b for edge in _edges(claim.between, claim.of)]
    verdict = verdict_on(inside(a / b, claim.between), edges, noise)
    return Case(where, a, b, list(claim.between), noise, verdict, a / b)


def value_case(claim: ValueClaim, a: float, noise: float, where: str) -> Case:
    """a within the claim's bounds, or equal to its number."""
    if claim.between is None:
        assert claim.equals is not None
        verdict = verdict_on(math.isclose(a, claim.equals), [a - claim.equals], noise)
        return Case(where, a, None, claim.equals, noise, verdict, a)
    verdict = verdict_on(inside(a, claim.between), [a - edge for edge in _edges(claim.between, claim.of)], noise)
    return Case(where, a, None, list(claim.between), noise, verdict, a)
