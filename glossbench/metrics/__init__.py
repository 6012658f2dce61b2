"""Metrics: how far an image is from the reference, over the pixels that show the surface.

It imports process, catalog and the loose files. A metric sees arrays: an image or a reference is
anything that `HasRadiance`.
"""

from glossbench.metrics.metric import METRICS, HasRadiance, Metric

__all__ = ["METRICS", "HasRadiance", "Metric"]
