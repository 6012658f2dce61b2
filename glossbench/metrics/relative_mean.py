"""The mean signed error as a share of the reference."""

from glossbench.metrics.metric import METRICS
from glossbench.metrics.pixelwise import MeanError
from glossbench.shapes import Colours, ErrorMap, Masked


@METRICS.register("relative_mean_error")
class RelativeMeanError(MeanError):
    """Mean signed error over the mean of the reference: the share of all energy that is gained, or below 0 lost."""

    formula = "mean(x - y) / mean(y)"
    unit = "1"
    map_formula = "mean(x - y) / mean of all y"

    def errors(self, x: Colours, y: Colours, mask: Masked) -> ErrorMap:
        """Mean error over the channels, over the mean of the reference."""
        mean = float(y[mask].mean())
        return super().errors(x, y, mask) / (mean if mean > 0 else 1.0)
