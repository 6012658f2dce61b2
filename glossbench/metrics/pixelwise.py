"""Metrics of single pixels."""

from typing import Annotated

import numpy as np
from pydantic import Field

from glossbench.metrics.metric import METRICS
from glossbench.metrics.space import SpaceMetric
from glossbench.shapes import Colours, ErrorMap, Errors, Masked


@METRICS.register("rms")
class RMS(SpaceMetric):
    """Root of the mean squared error."""

    formula = "sqrt(mean((x - y)^2))"
    unit = "radiance"
    map_formula = formula

    def errors(self, x: Colours, y: Colours, mask: Masked) -> ErrorMap:
        """Root of the mean squared error over the channels."""
        return np.sqrt(np.mean((x - y) ** 2, axis=2))

    def pooled(self, errors: Errors) -> float:
        """Root of the mean square."""
        return float(np.sqrt(np.mean(errors**2)))


@METRICS.register("relative_rms")
class RelativeRMS(RMS):
    """RMS divided by the mean of the reference: comparable between lights; 0 or infinite for a black reference."""

    formula = "sqrt(mean((x - y)^2)) / mean(y)"
    unit = "1"
    map_formula = "sqrt(mean((x - y)^2)) / mean of all y"

    def errors(self, x: Colours, y: Colours, mask: Masked) -> ErrorMap:
        """Root of the mean squared error over the channels, divided by the mean of the reference."""
        rms, mean = super().errors(x, y, mask), float(y[mask].mean())
        return rms / mean if mean > 0 else np.where(rms == 0, 0.0, np.inf)


@METRICS.register("relative_l1")
class RelativeL1(SpaceMetric):
    """Mean absolute error divided by the mean of the reference; 0 or infinite for a black reference.

    For a sphere under one bright texel it is the difference of two lobes divided by the volume of one lobe, because an
    orthographic view of a sphere shows equal solid angles of mirror directions in equal areas.
    """

    formula = "mean(|x - y|) / mean(y)"
    unit = "1"
    map_formula = "mean(|x - y|) / mean of all y"

    def errors(self, x: Colours, y: Colours, mask: Masked) -> ErrorMap:
        """Mean absolute error over the channels, divided by the mean of the reference."""
        error, mean = np.mean(np.abs(x - y), axis=2), float(y[mask].mean())
        return error / mean if mean > 0 else np.where(error == 0, 0.0, np.inf)


@METRICS.register("mean_error")
class MeanError(SpaceMetric):
    """Mean signed error: energy gained (above 0) or lost."""

    formula = "mean(x - y)"
    unit = "radiance"
    map_formula = formula
    signed = True

    def errors(self, x: Colours, y: Colours, mask: Masked) -> ErrorMap:
        """Mean error over the channels."""
        return np.mean(x - y, axis=2)


@METRICS.register("max_error")
class MaxError(SpaceMetric):
    """The largest error of any pixel and channel."""

    formula = "max(|x - y|)"
    unit = "radiance"
    map_formula = formula

    def errors(self, x: Colours, y: Colours, mask: Masked) -> ErrorMap:
        """The largest error of any channel."""
        return np.max(np.abs(x - y), axis=2)

    def pooled(self, errors: Errors) -> float:
        """The largest."""
        return float(np.max(errors))


@METRICS.register("mrse")
class MRSE(SpaceMetric):
    """Mean relative squared error of each channel: dark regions count as much as bright ones.

    Attributes:
        epsilon: [radiance^2] bounds the error of black pixels. It has a scale: choose another value for lights of
            another brightness.

    Source: Rousselle, Knaus, Zwicker 2011, "relative MSE", epsilon 0.01. Other papers halve it (Gharbi et al. 2019),
    divide by x^2 + y^2 + 0.1 (code of Hasselgren et al. 2021) or by (x + 0.01)^2 (Lehtinen et al. 2018): their
    numbers cannot be compared with these.
    """

    epsilon: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 0.01
    formula = "mean((x - y)^2 / (y^2 + epsilon))"
    unit = "1"
    map_formula = formula

    def errors(self, x: Colours, y: Colours, mask: Masked) -> ErrorMap:
        """Relative squared error, the mean over the channels."""
        return np.mean((x - y) ** 2 / (y**2 + self.epsilon), axis=2)


@METRICS.register("mrse_trimmed")
class TrimmedMRSE(MRSE):
    """MRSE without the worst pixels: a few very bright ones would decide it. Of P pixels floor(fraction P) are dropped.

    Attributes:
        fraction: fraction of the masked pixels that is dropped, in [0, 1).

    It is in common use but has no common source: papers differ in the fraction, and in whether they sort pixels or each
    channel. Here pixels are sorted by the mean error of their channels.
    """

    fraction: Annotated[float, Field(ge=0, lt=1)] = 0.001
    formula = "mrse over all but the worst pixels, a fraction of them"

    def pooled(self, errors: Errors) -> float:
        """Mean of all but the largest."""
        kept = errors.size - int(self.fraction * errors.size)
        return float(np.mean(np.partition(errors, kept - 1)[:kept]))


@METRICS.register("smape")
class SMAPE(SpaceMetric):
    """Symmetric mean absolute percentage error, as a fraction in [0, 2]; 0 over 0 is 0.

    Source: Armstrong 1985, with the factor 2. Denoising papers leave the factor out and add 0.01 to the denominator
    (Gharbi et al. 2019): their number is half of this one, and less in dark regions.
    """

    formula = "mean(2 |x - y| / (|x| + |y|))"
    unit = "1"
    map_formula = formula

    def errors(self, x: Colours, y: Colours, mask: Masked) -> ErrorMap:
        """Error divided by half the sum of both absolute values, the mean over the channels."""
        size = np.abs(x) + np.abs(y)
        return np.mean(2 * np.abs(x - y) / np.where(size > 0, size, 1), axis=2)
