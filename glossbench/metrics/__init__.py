"""Metrics: how far an image is from the reference, over the pixels that show the surface."""

from glossbench.metrics.metric import METRICS, HasRadiance, Metric

__all__ = ["METRICS", "HasRadiance", "Metric"]
