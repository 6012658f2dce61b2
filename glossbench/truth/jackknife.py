"""The jackknife: bias and variance that the noise of the reference causes in a number.

A number f that was computed from G groups of replicates is computed again without each group, f_1 to f_G. Then

    bias = (G - 1) (mean(f_i) - f),    variance = (G - 1) / G sum of (f_i - mean(f_i))^2.

Source: Quenouille 1956 (bias), Tukey 1958 (variance).
"""

from collections.abc import Sequence

import numpy as np


def jackknife(value: float, left_out: Sequence[float]) -> tuple[float, float]:
    """The bias and the variance of a number, from its values without each group."""
    n, found = len(left_out), np.asarray(left_out, float)
    mean = float(found.mean())
    return (n - 1) * (mean - value), (n - 1) / n * float(((found - mean) ** 2).sum())


def remove_bias(values: Sequence[float]) -> float:
    """A metric minus the bias that noise causes, from the full value and the values without each group.

    The result is never below 0 if none of the values is: near 0, a mean square consists only of its bias, and the
    difference may have either sign.
    """
    if len(values) == 1:
        return values[0]
    found = values[0] - jackknife(values[0], values[1:])[0]
    return max(found, 0.0) if min(values) >= 0 else found
