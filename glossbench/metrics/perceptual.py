"""Metrics of visible differences: images on a display, at exposures that depend on the reference only."""

from math import ceil, log2
from typing import Annotated, NamedTuple

import flip_evaluator
import numpy as np
import skimage
from pydantic import Field

from glossbench.channels import LUMINANCE
from glossbench.metrics.metric import METRICS, Metric
from glossbench.shapes import Colours, ErrorMap, Errors, Masked
from glossbench.srgb import encode
from glossbench.tone import aces, invert_aces

BRIGHT = 0.85  # the first exposure maps the brightest pixel to this value, the last exposure the median
WINDOW = 5  # [pixels] from the centre of a window to its edge


class Exposures(NamedTuple):
    """The first and the last exposure [stops], and the number of exposures."""

    start: float
    stop: float
    n_steps: int


def choose_exposures(y: Colours, mask: Masked) -> Exposures:
    """The exposures [stops] at which HDR-FLIP compares images with a reference.

    start = log2(x / max(Y)), stop = log2(x / median(Y)), n_steps = max(2, ceil(stop - start)), where ACES(x) = 0.85 and
    Y is luminance.

    Source: Andersson et al. 2021 section 3. Differs: the median is over masked pixels, because a black background would
    lower it; if it is 0, it is over pixels above 0; for a black reference start and stop are 0.
    """
    luminance = y[mask] @ np.array(LUMINANCE)
    seen = luminance[luminance > 0]
    if not seen.size:
        return Exposures(0.0, 0.0, 2)
    x = invert_aces(BRIGHT)
    median = np.median(luminance)
    start, stop = log2(x / seen.max()), log2(x / (median if median > 0 else np.median(seen)))
    return Exposures(start, stop, max(2, ceil(stop - start)))


def display(image: Colours, stops: float) -> Colours:
    """An image on a display, in [0, 1]: exposure, then the ACES curve, then the sRGB curve; below 0 is black."""
    return encode(aces(np.clip(2**stops * image, 0, 1e6)))


@METRICS.register("flip")
class FLIP(Metric):
    """HDR-FLIP, in [0, 1]: the difference that a viewer sees when image and reference alternate on a display.

    Each pixel has the largest LDR-FLIP error over several exposures, after the ACES curve. The exposures depend on the
    reference only, so they are the same for all images; negative radiance counts as black. Near the silhouette the
    filter that models the eye mixes in the background, which is black in both images.

    Attributes:
        pixels_per_degree: pixels per degree of visual angle. 67 is a display of 3840 pixels and 0.7 m width, seen from
            0.7 m.

    Source: Andersson, Nilsson, Shirley, Akenine-Moeller 2021, by the authors' `flip-evaluator`.
    """

    pixels_per_degree: Annotated[float, Field(ge=1, le=1000)] = 67.0
    formula = "mean of HDR-FLIP(x, y), of both on a display"
    unit = "1"
    map_formula = "HDR-FLIP(x, y)"
    n_groups = 4

    def errors(self, x: Colours, y: Colours, mask: Masked) -> ErrorMap:
        """The FLIP map."""
        start, stop, n_steps = choose_exposures(y, mask)
        # Scaled so that the first exposure is 0: single precision then neither overflows nor underflows.
        images = [np.clip(2**start * image, 0, 1e6).astype(np.float32) for image in (y, x)]
        stated = {"ppd": self.pixels_per_degree, "startExposure": 0.0, "stopExposure": stop - start}
        flip, *_ = flip_evaluator.evaluate(
            *images, "HDR", applyMagma=False, computeMeanError=False, parameters={**stated, "numExposures": n_steps}
        )
        return np.asarray(flip[..., 0], np.float64)


@METRICS.register("ssim")
class SSIM(Metric):
    """Structural similarity of the images on a display, at most 1 (no difference): higher is better.

    It is defined for a bounded range. Both images are therefore exposed at the middle of HDR-FLIP's exposures, which
    depend on the reference only; the ACES and the sRGB curve then map them into [0, 1]. Windows are Gaussian, 11 x 11
    pixels with standard deviation 1.5; the mean is over channels and masked pixels. The background is black in both
    images, and black outside the image too: a window across the silhouette is more similar than the surface in it.

    Source: Wang et al. 2004 (K1 = 0.01, K2 = 0.03), by scikit-image. Differs: the paper uses luminance.
    """

    formula = "mean of SSIM(x, y), of both on a display"
    unit = "1"
    map_formula = "1 - SSIM(x, y)"
    lower_is_better = False

    def errors(self, x: Colours, y: Colours, mask: Masked) -> ErrorMap:
        """1 - SSIM of the window around each pixel, the mean over the channels."""
        start, stop, _ = choose_exposures(y, mask)
        edge = ((WINDOW, WINDOW), (WINDOW, WINDOW), (0, 0))
        images = [np.pad(display(image, (start + stop) / 2), edge) for image in (x, y)]
        _, similarity = skimage.metrics.structural_similarity(
            *images, data_range=1.0, channel_axis=2, full=True,
            gaussian_weights=True, sigma=1.5, truncate=WINDOW / 1.5, use_sample_covariance=False,
        )  # fmt: skip
        return 1 - similarity[WINDOW:-WINDOW, WINDOW:-WINDOW].mean(axis=2)

    def pooled(self, errors: Errors) -> float:
        """1 - mean."""
        return float(1 - np.mean(errors))
