"""Pareto fronts beyond noise: which configurations no other one beats in error and cost.

Under one condition A dominates B if the error of A is lower beyond noise and its cost is not higher; or if the errors
are equal (identical images, or both below what the reference resolves) and A costs less. Times within the factor
`SPREAD` are equal. If noise leaves the order of two errors open, neither dominates.
"""

from collections.abc import Sequence

import numpy as np

from glossbench.findings.trials import Floats, Mask, Order, Trials, find_factor


def find_dominating(orders: Sequence[Order], cost: Floats, factor: float) -> Mask:
    """(n, i, j): under condition n configuration i dominates j; costs within a factor are equal."""
    found = []
    for n, order in enumerate(orders):
        own, others = cost[:, n][:, None], cost[:, n][None, :]
        found.append((order.lower & (own <= factor * others)) | (order.equal & (factor * own < others)))
    return np.array(found, bool)


def find_fronts(trials: Trials, cost: str) -> Mask:
    """(i, n): configuration i has an error and a cost under condition n, and no other one dominates it there."""
    costs = trials.cost(cost)
    return ~np.isnan(costs) & ~find_dominating(trials.orders, costs, find_factor(cost)).any(axis=1).T
