"""Ranks of configurations over conditions, with intervals by a bootstrap over lights, materials and views.

Under one condition the rank is 1 + the number of configurations with a lower error + half the number of those whose
order noise leaves open. Conditions share lights, materials and views, so they are not independent: to draw single
conditions would give intervals that are far too narrow (with 9 lights and 8 materials whose own effects are as large as
the rest, 66 % of these hold the true mean instead of 95 %, against 94 % of ours). Each draw therefore takes lights,
materials and views with replacement, independently of each other, and a condition counts by the product of how often
its three were drawn. With three or fewer of each, 53 to 98 % hold it: such intervals are only a hint.

Source: Owen 2007, "The pigeonhole bootstrap".
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glossbench.findings.estimates import CONFIDENCE
from glossbench.findings.trials import Condition, Floats, Order

DRAWS, SEED_OF_DRAWS = 2000, 1


class Mean(NamedTuple):
    """A mean over conditions with the ends of its 95 % interval."""

    value: float
    low: float
    high: float


def rank(orders: Sequence[Order], members: Sequence[int]) -> Floats:
    """(i, n): the rank of the i-th member under condition n among all members, which have an error there."""
    found = []
    for order in orders:
        lower = order.lower[np.ix_(members, members)]
        open_ = ~lower & ~lower.T
        found.append(1 + lower.sum(axis=0) + (open_.sum(axis=0) - 1) / 2)
    return np.array(found).T


def draw_weights(conditions: Sequence[Condition]) -> Floats:
    """(draw, condition): how often each condition counts; draws in which none counts are left out."""
    rng = np.random.default_rng(SEED_OF_DRAWS)
    weights: NDArray[np.int64] = np.ones((DRAWS, len(conditions)), int)
    for column in zip(*(each.keys for each in conditions), strict=True):
        known = {key: i for i, key in enumerate(dict.fromkeys(column))}
        counts = rng.multinomial(len(known), [1 / len(known)] * len(known), DRAWS)
        weights *= counts[:, [known[key] for key in column]]
    return weights[weights.any(axis=1)].astype(float)


def average(values: Floats, weights: Floats) -> list[Mean]:
    """The mean of each row over its columns, which are conditions."""
    drawn = values @ weights.T / weights.sum(axis=1)
    low, high = np.quantile(drawn, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], axis=1)
    return [Mean(*map(float, ends)) for ends in zip(values.mean(axis=1), low, high, strict=True)]
