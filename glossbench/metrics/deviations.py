"""Means and medians of absolute and relative errors, which are common in tables of papers."""

import numpy as np

from glossbench.metrics.metric import METRICS
from glossbench.metrics.space import SpaceMetric
from glossbench.shapes import Colours, ErrorMap, Errors, Masked


@METRICS.register("mean_absolute_error")
class MeanAbsoluteError(SpaceMetric):
    """Mean of the absolute error."""

    formula = "mean(|x - y|)"
    unit = "radiance"
    map_formula = formula

    def errors(self, x: Colours, y: Colours, mask: Masked) -> ErrorMap:
        """Absolute error, the mean over the channels."""
        return np.mean(np.abs(x - y), axis=2)


@METRICS.register("mean_relative_error")
class MeanRelativeError(SpaceMetric):
    """Mean of the absolute error divided by the reference, per pixel and channel; 0 where the reference is not above 0.

    The darkest values that are not black decide it.
    """

    formula = "mean(|x - y| / y), 0 where y = 0"
    unit = "1"
    map_formula = formula

    def errors(self, x: Colours, y: Colours, mask: Masked) -> ErrorMap:
        """Relative error, the mean over the channels."""
        return np.mean(np.where(y > 0, np.abs(x - y) / np.where(y > 0, y, 1), 0.0), axis=2)


@METRICS.register("median_absolute_error")
class MedianAbsoluteError(MeanAbsoluteError):
    """Median over the pixels of the mean absolute error of their channels: a few bright pixels do not decide it."""

    formula = "median of mean(|x - y|)"

    def pooled(self, errors: Errors) -> float:
        """The median."""
        return float(np.median(errors))


@METRICS.register("median_relative_error")
class MedianRelativeError(MeanRelativeError):
    """Median over the pixels of the mean relative error of their channels; 0 where the reference is not above 0."""

    formula = "median of mean(|x - y| / y), 0 where y = 0"

    def pooled(self, errors: Errors) -> float:
        """The median."""
        return float(np.median(errors))
