"""The space in which images are compared: radiance, or what becomes of it."""

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from glossbench.metrics.metric import Metric
from glossbench.shapes import Colours
from glossbench.srgb import encode

Space = Literal["linear", "clamped", "srgb8", "log"]


class SpaceMetric(Metric):
    """A metric of pixels in a space of the user's choice.

    Attributes:
        space: what x and y are: "linear", radiance; "clamped", radiance between 0 and 1; "srgb8", the same as the sRGB
            values of a picture with 8 bits, in [0, 1]; "log", log(1 + radiance). Clamped values have no exposure: a
            radiance of 1 is white. Below 0 is black in all spaces but the linear one.
    """

    space: Space = "linear"

    @classmethod
    def unit_with(cls, options: Mapping[str, Any]) -> str:
        """The unit of radiance only in the linear space."""
        return cls.unit if options.get("space", "linear") == "linear" else "1"

    def compared(self, radiance: Colours) -> Colours:
        """Radiance in the space."""
        match self.space:
            case "linear":
                return radiance
            case "clamped":
                return np.clip(radiance, 0, 1)
            case "srgb8":
                return np.round(255 * encode(np.clip(radiance, 0, 1))) / 255
            case "log":
                return np.log1p(np.maximum(radiance, 0))
