"""Metrics: how far an image is from the reference, over the pixels that show the surface, linear radiance."""

from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from glossbench.options import Options
from glossbench.registry import Registry

Pixels = NDArray[np.float64]


class HasRadiance(Protocol):
    """An image: radiance (H, W, 3), and mask (H, W) where it shows the surface."""

    @property
    def radiance(self) -> Tensor: ...
    @property
    def mask(self) -> Tensor: ...


class Metric(Options):
    """A number from an image and a reference: `metric(image, truth)` for two images of one view.

    Attributes:
        formula: in plain text; x the image, y the reference, the mean over masked pixels and three channels.
        unit: of the number.
        lower_is_better: for the absolute value.
    """

    formula: ClassVar[str]
    unit: ClassVar[str]
    lower_is_better: ClassVar[bool] = True

    def __call__(self, image: HasRadiance, truth: HasRadiance) -> float:
        mask = truth.mask.numpy()
        x = image.radiance.double().numpy()[mask]
        y = truth.radiance.double().numpy()[mask]
        return float(self.of(x, y))

    def of(self, x: Pixels, y: Pixels) -> float:
        """The number, from pixels (P, 3) of image and reference."""
        raise NotImplementedError


METRICS: Registry[Metric] = Registry("metric", "glossbench.metrics", "glossbench.metrics")


@METRICS.register("rms")
class RMS(Metric):
    """Root of the mean squared error."""

    formula = "sqrt(mean((x - y)^2))"
    unit = "radiance"

    def of(self, x: Pixels, y: Pixels) -> float:
        """The number, from pixels (P, 3) of image and reference."""
        return float(np.sqrt(np.mean((x - y) ** 2)))


@METRICS.register("relative_rms")
class RelativeRMS(Metric):
    """RMS over the mean of the reference: comparable between lights; 0 over 0 is 0."""

    formula = "sqrt(mean((x - y)^2)) / mean(y)"
    unit = "1"

    def of(self, x: Pixels, y: Pixels) -> float:
        """The number, from pixels (P, 3) of image and reference."""
        rms, mean = np.sqrt(np.mean((x - y) ** 2)), np.mean(y)
        return float(rms / mean) if mean > 0 else float(0 if rms == 0 else np.inf)


@METRICS.register("mean_error")
class MeanError(Metric):
    """Mean signed error: energy gained (above 0) or lost."""

    formula = "mean(x - y)"
    unit = "radiance"

    def of(self, x: Pixels, y: Pixels) -> float:
        """The number, from pixels (P, 3) of image and reference."""
        return float(np.mean(x - y))


@METRICS.register("max_error")
class MaxError(Metric):
    """The largest error of any pixel and channel."""

    formula = "max(|x - y|)"
    unit = "radiance"

    def of(self, x: Pixels, y: Pixels) -> float:
        """The number, from pixels (P, 3) of image and reference."""
        return float(np.max(np.abs(x - y)))
