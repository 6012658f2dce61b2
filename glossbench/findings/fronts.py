"""Pareto fronts beyond noise: which configurations no other one beats in error and cost.

Under one condition A dominates B if the error of A is lower beyond noise and its cost is not higher beyond the spread
of its runs; or if the errors are equal (identical images, or both below what the reference resolves) and A costs less
beyond that spread. If noise leaves the order of two errors open, neither dominates.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from glossbench.findings.trials import Ends, Order, Trials

Mask = NDArray[np.bool_]


def find_dominating(orders: Sequence[Order], cost: Ends) -> Mask:
    """(n, i, j): under condition n configuration i dominates j."""
    found = []
    for n, order in enumerate(orders):
        low, high = cost.low[:, n], cost.high[:, n]
        cheaper = high[:, None] < low[None, :]
        known = ~np.isnan(low[:, None]) & ~np.isnan(low[None, :])
        found.append(known & ((order.lower & ~cheaper.T) | (order.equal & cheaper)))
    return np.array(found, bool)


def find_fronts(trials: Trials, cost: str) -> Mask:
    """(i, n): configuration i has an error and a cost under condition n, and no other one dominates it there."""
    ends = trials.cost(cost)
    return trials.done & ~np.isnan(ends.middle) & ~find_dominating(trials.orders, ends).any(axis=1).T
