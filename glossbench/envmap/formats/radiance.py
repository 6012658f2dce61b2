"""Finds pixels that are not radiance: NaN, infinite, negative, or so large that sums over them overflow."""

from pathlib import Path
from typing import Literal

import numpy as np

from glossbench.channels import LARGEST
from glossbench.errors import InputError

Invalid = Literal["refuse", "clamp"]


def fit_to_be_light(path: Path, image: np.ndarray, invalid: Invalid = "refuse") -> tuple[str, ...]:
    """Checks the values of an image (H, W, 3), or makes them valid in place and returns a note about the changes.

    With `clamp` a value above 1e30 or infinite becomes the largest valid value; a negative value or NaN becomes 0.

    Raises:
        InputError: with `refuse`, if a value is NaN, infinite, above 1e30 or negative.
    """
    if image.min() >= 0 and image.max() <= LARGEST:  # False if there is a NaN
        return ()
    is_nan, is_large, is_negative = np.isnan(image), image > LARGEST, image < 0
    if invalid == "refuse":
        for rule, bad in (
            ("finite", ~np.isfinite(image)),
            (f"at most {LARGEST:g}", is_large),
            ("not negative", is_negative),
        ):
            if bad.any():
                raise InputError(f"{path}: radiance must be {rule}, but {_locate_bad_pixels(image, bad)}")
    largest = image[~(is_nan | is_large | is_negative)].max(initial=0)
    for bad, value in ((is_nan, 0), (is_negative, 0), (is_large, largest)):
        image[bad] = value
    done = [
        f"{bad.sum()} {what} to {value:.4g}"
        for what, bad, value in (("NaN", is_nan, 0), ("negative", is_negative, 0), ("too large", is_large, largest))
        if bad.any()
    ]
    n_pixels = int((is_nan | is_large | is_negative).any(2).sum())
    return (f"invalid values of {n_pixels} of {image.shape[0] * image.shape[1]} pixels set: {', '.join(done)}",)


def _locate_bad_pixels(image: np.ndarray, bad: np.ndarray) -> str:
    """The number of bad pixels, and the first of them."""
    pixels = bad.any(2)
    row, column = np.argwhere(pixels)[0].tolist()
    value = image[row, column][bad[row, column]][0].item()
    where = f"first at row {row}, column {column}: {value:g}"
    return f"{pixels.sum()} pixels are not, {where}; invalid: clamp lets them in, changed and counted"
