"""Tuning: find the value of one option at which a metric is lowest, as the papers tune their MIP bias."""

import math
from collections.abc import Callable

import numpy as np
import scipy

from glossbench.study.cells import Tuning


def tune_option(tune: Tuning, error: Callable[[float], float]) -> float:
    """The value of an option in [low, high] at which |metric| is lowest, to 1/400 of the range.

    Nine values over the range bracket the minimum, and Brent's bounded search finds it.
    """
    grid = np.linspace(tune.low, tune.high, 9)
    errors = [abs(error(float(x))) for x in grid]
    best = int(np.argmin(errors))
    if not math.isfinite(errors[best]):
        return float(grid[best])
    found = scipy.optimize.minimize_scalar(
        lambda x: abs(error(float(x))), bounds=(grid[max(best - 1, 0)], grid[min(best + 1, 8)]),
        method="bounded", options={"xatol": (tune.high - tune.low) / 400},
    )  # fmt: skip
    # The search never tries the ends of its interval, which may be the ends of the range.
    x = float(found.x if found.fun < errors[best] else grid[best])
    return min(max(round(x, 4 - math.floor(math.log10(tune.high - tune.low))), tune.low), tune.high)
