"""Comparisons: of two numbers, or of a number and its bounds, under the noise of the reference."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from glossbench.findings.columns import make_metric_column
from glossbench.findings.estimates import Estimate, Floats, Sample, estimate
from glossbench.study.claims import Bounds, LowerClaim, RatioClaim, SlopeClaim, ValueClaim

HOLDS, FAILS, EQUAL, NOISE, UNTESTED = "holds", "does not hold", "equal", "within noise", "not tested"
Row = dict[str, Any]


class Side(NamedTuple):
    """What is compared: one cell, or several cells that differ only in the seed of their random points.

    Attributes:
        value: the column of the cell, or its mean over the seeds.
        samples: for each cell, the value and its changes by the noise of the reference.
    """

    value: float
    samples: Sequence[Sample]

    @property
    def n_seeds(self) -> int:
        """Number of seeds; 0 if no points are random."""
        return len(self.samples) if self.samples[0].seed is not None else 0


class Case(NamedTuple):
    """One comparison of a claim.

    Attributes:
        where: what is compared, in words.
        a: the column of the first side, or the slope.
        b: the column of the second side.
        bound: the bound with which the number is compared.
        found: the number that decides: a ratio, a slope or a value.
        seeds: number of seeds of random points on each side; 0 if none are random.
        reading: the values of the claim's options `by`, each with its name, in words.
    """

    where: str
    a: float
    b: float | None
    bound: Any
    found: Estimate
    verdict: str
    seeds: tuple[int, ...]
    reading: tuple[str, ...] = ()

    def as_numbers(self) -> dict[str, Any]:
        """The case as JSON types; `low` and `high` are the 95 % interval of `value`."""
        low, high = self.found.interval
        numbers = {"value": self.found.value, "low": low, "high": high}
        told = {"where": self.where, "a": self.a, "b": self.b, "bound": self.bound, "verdict": self.verdict}
        return {**told, **{name: keep_finite(x) for name, x in numbers.items()}, "seeds": list(self.seeds)}


def keep_finite(value: Any) -> float | None:
    """The value if it is a finite number, else None."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(value):
        return None
    return float(value)


def is_inside(value: float, bounds: Bounds) -> bool:
    """Whether a number lies within bounds."""
    low, high = bounds
    return (low is None or value >= low) and (high is None or value <= high)


def judge_lower(claim: LowerClaim, a: Side, b: Side, where: str) -> Case:
    """|a| < |b|: within noise if the interval of |a| / |b| contains an end of the margin; equal inside the margin."""
    found = estimate(_divide_sizes, (a.samples, b.samples))
    if any(found.is_unresolved(1 + margin) for margin in (-claim.margin, claim.margin)):
        verdict = NOISE
    elif abs(found.value - 1) <= claim.margin:
        verdict = EQUAL
    else:
        verdict = HOLDS if found.value < 1 else FAILS
    return Case(where, abs(a.value), abs(b.value), None, found, verdict, (a.n_seeds, b.n_seeds))


def judge_ratio(claim: RatioClaim, a: Side, b: Side, where: str) -> Case:
    """a / b lies within the claim's bounds."""
    found = estimate(lambda sides: _divide(sides[0].mean(), sides[1].mean()), (a.samples, b.samples))
    verdict = _judge_bounds(found, claim.between, _find_edges(claim.between, claim.of, (*a.samples, *b.samples)))
    return Case(where, a.value, b.value, list(claim.between), found, verdict, (a.n_seeds, b.n_seeds))


def judge_value(claim: ValueClaim, a: Side, where: str) -> Case:
    """a lies within the claim's bounds, or equals its number."""
    found = estimate(lambda sides: float(sides[0].mean()), [a.samples])
    if claim.equals is not None:
        is_equal = math.isclose(found.value, claim.equals)
        verdict = NOISE if found.is_unresolved(claim.equals) else HOLDS if is_equal else FAILS
        return Case(where, a.value, None, claim.equals, found, verdict, (a.n_seeds,))
    assert claim.between is not None
    verdict = _judge_bounds(found, claim.between, _find_edges(claim.between, claim.of, a.samples))
    return Case(where, a.value, None, list(claim.between), found, verdict, (a.n_seeds,))


def judge_slope(claim: SlopeClaim, over: Sequence[float], points: Sequence[Side], where: str) -> Case:
    """The least-squares slope of log(point) over log(option) lies within the claim's bounds."""
    x = np.log(over) - np.log(over).mean()

    def fit_slope(sides: Sequence[Floats]) -> float:
        sizes = np.array([np.abs(side).mean() for side in sides])
        return float(x @ np.log(sizes) / (x @ x)) if (sizes > 0).all() else math.nan

    found = estimate(fit_slope, [point.samples for point in points])
    verdict = _judge_bounds(found, claim.between, [bound for bound in claim.between if bound is not None])
    seeds = min(point.n_seeds for point in points)
    return Case(where, found.value, None, list(claim.between), found, verdict, (seeds,))


def _divide_sizes(sides: Sequence[Floats]) -> float:
    return _divide(np.abs(sides[0]).mean(), np.abs(sides[1]).mean())


def _divide(a: float, b: float) -> float:
    """a / b; 0 / 0 is 1, because the two are equal."""
    return float(a / b) if b else 1.0 if a == 0 else math.copysign(math.inf, a)


def _judge_bounds(found: Estimate, bounds: Bounds, edges: Sequence[float]) -> str:
    """The verdict on a number between bounds; within noise if its interval contains one of them."""
    if any(found.is_unresolved(edge) for edge in edges):
        return NOISE
    return HOLDS if is_inside(found.value, bounds) else FAILS


def _find_edges(bounds: Bounds, column: str, samples: Sequence[Sample]) -> list[float]:
    """The bounds that noise may carry a number across. A column that is never negative cannot cross the bound 0."""
    may_be_negative = make_metric_column(column).signed or min(min(sample.values) for sample in samples) < 0
    return [bound for bound in bounds if bound is not None and (bound != 0 or may_be_negative)]
