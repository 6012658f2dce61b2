"""Estimates: a number computed from cells, with its 95 % interval.

The jackknife (truth/jackknife.py) states by how much the noise of a reference changes the number f: in 95 of 100 cases
f - bias is within t(97.5 %, G - 1) standard errors of its limit, where t is Student's and G the number of groups. Cells
of one reference lose the same group at the same time, so that the noise that they share cancels in their ratio.
References are independent of each other, and so is the choice of random points: their variances v are added, and the
degrees of freedom are (sum of v)^2 / sum of (v^2 / (G - 1)).

The bias is the first order of what noise does to a number. At the noise floor it may be several times the number, and a
ratio of two RMS errors without it would be negative. A comparison whose bias is more than half of it is not resolved.

Source: Welch 1947 and Satterthwaite 1946 (degrees).
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from glossbench.truth.jackknife import jackknife, remove_bias

CONFIDENCE = 0.95
Floats = NDArray[np.float64]


class Estimate(NamedTuple):
    """A number with its uncertainty.

    Attributes:
        value: the number, without the bias that noise causes.
        standard_error: 0 if no noise is known; infinite if the number cannot be computed without some group.
        degrees: degrees of freedom of the standard error.
    """

    value: float
    standard_error: float = 0.0
    degrees: float = math.inf

    @property
    def half_width(self) -> float:
        """Half the width of the 95 % interval, from Student's t."""
        if self.standard_error in (0.0, math.inf):
            return self.standard_error
        return float(scipy.special.stdtrit(self.degrees, 0.5 + CONFIDENCE / 2)) * self.standard_error

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval, [low, high]."""
        return self.value - self.half_width, self.value + self.half_width

    def is_unresolved(self, bound: float) -> bool:
        """Whether noise may carry the number across a bound: the interval contains it."""
        low, high = self.interval
        return self.standard_error == math.inf or (self.standard_error > 0 and low <= bound <= high)


class Sample(NamedTuple):
    """A number of one cell.

    Attributes:
        values: the number against the whole reference, then against the reference without each group; only the first
            if no noise is known.
        reference: the key of its reference.
        seed: seed of its random points; None if it has none.
    """

    values: Sequence[float]
    reference: str = ""
    seed: int | None = None


Sides = Sequence[Sequence[Sample]]  # each side of a comparison is one cell, or one for each of several seeds
Statistic = Callable[[Sequence[Floats]], float]  # takes the values of each side


def estimate(statistic: Statistic, sides: Sides, is_log: bool = False) -> Estimate:
    """A number computed from cells, with the noise of their references and the spread over their seeds.

    Args:
        is_log: the number is the logarithm of a ratio.
    """
    value = statistic([np.array([sample.values[0] for sample in side]) for side in sides])
    of_groups, of_seeds = _without_groups(statistic, sides), _without_seeds(statistic, sides)
    moved = [again for again in (*of_groups, *of_seeds) if set(again) != {value}]
    if not np.isfinite([value, *chain(*moved)]).all():
        return Estimate(value, math.inf if moved else 0.0)
    # Fewer seeds do not bias a mean, so that the bias comes only from the groups of references.
    bias = sum(jackknife(value, again)[0] for again in of_groups if again in moved)
    is_positive = min(value, *chain(*of_groups)) >= 0 if of_groups else False
    if len(sides) > 1 and (is_log or is_positive) and is_too_large(bias, value, is_log):
        return Estimate(value, math.inf)
    parts = [(jackknife(value, again)[1], len(again) - 1) for again in moved]
    total = sum(variance for variance, _ in parts)
    if total == 0:
        return Estimate(value - bias)
    degrees = total**2 / sum(variance**2 / n for variance, n in parts)
    return Estimate(value - bias, math.sqrt(total), degrees)


def is_too_large(bias: float, value: float, is_log: bool) -> bool:
    """Whether a bias is more than half of a ratio; of a logarithm, more than log 2."""
    return abs(bias) > (math.log(2) if is_log else value / 2)


def estimate_metric(row: Mapping[str, Any], metric: str) -> Estimate:
    """A metric of one cell, from its row of the results; without a standard error if the row has no groups."""
    stored = row.get("left_out") or {}
    values = (json.loads(stored) if isinstance(stored, str) else stored).get(metric)
    if values is None:
        return Estimate(float(row[metric]))
    found = estimate(lambda sides: float(sides[0][0]), [[Sample(values)]])
    return found._replace(value=remove_bias(values))


def _without_groups(statistic: Statistic, sides: Sides) -> list[list[float]]:
    """For each reference, the numbers without each of its groups; the other references are whole."""
    counts = {s.reference: len(s.values) - 1 for side in sides for s in side if len(s.values) > 1}

    def value_of(sample: Sample, of: str, i: int) -> float:
        return sample.values[i if sample.reference == of and i < len(sample.values) else 0]

    return [
        [statistic([np.array([value_of(s, of, i) for s in side]) for side in sides]) for i in range(1, n + 1)]
        for of, n in counts.items()
    ]


def _without_seeds(statistic: Statistic, sides: Sides) -> list[list[float]]:
    """For each set of several seeds, the numbers without each seed; sides with the same seeds lose one together."""
    seeds = [tuple(sample.seed for sample in side) for side in sides]
    return [
        [
            statistic([np.array([s.values[0] for s in side if own != each or s.seed != seed])
                       for side, own in zip(sides, seeds, strict=True)])
            for seed in each
        ]
        for each in dict.fromkeys(seeds)
        if len(each) > 1
    ]  # fmt: skip
