"""The error of an image's shape: what is left once its energy is right."""

from typing import Annotated

import numpy as np
from pydantic import Field

from glossbench.metrics.metric import METRICS, Metric
from glossbench.shapes import Colours, ErrorMap, Masked


@METRICS.register("shape_error")
class ShapeError(Metric):
    """Relative mean absolute error after x is scaled to the volume of y.

    The volume is the mean of y^p. For a sphere under one bright texel this compares two lobes of equal volume: with
    p = 1 the volume is the integral of a lobe, with p = 3 that of the solid which a radial plot of it draws. Each part
    of the volume that is in a wrong place counts twice: where it is, and where it should be. A black x has the error 1,
    a black y 0 or infinity.

    Attributes:
        power: p.
    """

    power: Annotated[int, Field(ge=1, le=4)] = 1

    formula = "mean(|s x^p - y^p|) / mean(y^p), s = mean(y^p) / mean(x^p)"
    unit = "1"
    map_formula = "mean(|s x^p - y^p|) / mean of all y^p"

    def errors(self, x: Colours, y: Colours, mask: Masked) -> ErrorMap:
        """Mean absolute error over the channels at equal volume, divided by the volume."""
        x, y = x**self.power, y**self.power
        of_x, of_y = float(x[mask].mean()), float(y[mask].mean())
        scaled = x * (of_y / of_x) if of_x > 0 and of_y > 0 else x
        error = np.mean(np.abs(scaled - y), axis=2)
        return error / of_y if of_y > 0 else np.where(error == 0, 0.0, np.inf)
