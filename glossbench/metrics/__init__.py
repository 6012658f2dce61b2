"""Metrics: how much an image differs from the reference, over the pixels that show the surface.

It imports process, catalog and the loose files. A metric works on arrays: an image or a reference is
anything that satisfies `RadianceImage`.
"""

from glossbench.metrics.metric import METRICS, Metric, RadianceImage

__all__ = ["METRICS", "Metric", "RadianceImage"]
