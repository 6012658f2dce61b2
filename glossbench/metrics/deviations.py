"""Mean absolute and mean relative errors, as papers tabulate them."""

import numpy as np

from glossbench.metrics.metric import METRICS, Metric
from glossbench.shapes import Colours, ErrorMap, Masked


@METRICS.register("mean_absolute_error")
class MeanAbsoluteError(Metric):
    """Mean of the absolute error."""

    formula = "mean(|x - y|)"
    unit = "radiance"
    map_formula = formula

    def errors(self, x: Colours, y: Colours, mask: Masked) -> ErrorMap:
        """Absolute error, the mean over the channels."""
        return np.mean(np.abs(x - y), axis=2)


@METRICS.register("mean_relative_error")
class MeanRelativeError(Metric):
    """Mean of the absolute error divided by the reference at the same pixel and channel; 0 where the reference is 0.

    The darkest values that are not black decide it.
    """

    formula = "mean(|x - y| / y), 0 where y = 0"
    unit = "1"
    map_formula = formula

    def errors(self, x: Colours, y: Colours, mask: Masked) -> ErrorMap:
        """Relative error, the mean over the channels."""
        return np.mean(np.where(y > 0, np.abs(x - y) / np.where(y > 0, y, 1), 0.0), axis=2)
