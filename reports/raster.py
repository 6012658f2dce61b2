"""Pictures and error maps of a report: 8-bit images of linear radiance, which is averaged over area first."""

from base64 import b64encode
from collections.abc import Sequence
from functools import cache
from io import BytesIO

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray
from PIL import Image
from scipy.sparse import csr_array

from glossbench.srgb import encode

Floats = NDArray[np.floating]
Mask = NDArray[np.bool_]

# An odd number of colours has a centre. Signed: ColorBrewer's, blue darker, red brighter. Unsigned: perceptually even.
SIGNED, UNSIGNED = colormaps["RdBu_r"].resampled(255), colormaps["magma"].resampled(255)
CLIPPED_SHARE = 0.5  # percent of the pixels that may lie beyond the scale of error maps
WHITE = 99.0  # percentile of the reference that the exposure brings to white


def downscale(image: Floats, mask: Mask, largest: int = 256) -> tuple[Floats, Floats]:
    """Image (H, W, C) of at most `largest` pixels a side, averaged over the masked area; and that area."""
    share = mask.astype(float)
    total = image * share[..., None]
    if max(mask.shape) <= largest:
        return total, share
    sides = [max(1, round(n * largest / max(mask.shape))) for n in mask.shape]
    for n in sides:  # along rows, then along columns
        total, share = _average(total, n).swapaxes(0, 1), _average(share, n).swapaxes(0, 1)
    return total / np.where(share > 0, share, 1)[..., None], share


def _average(values: Floats, m: int) -> Floats:
    """The first axis of values (n, ...) resampled to m pixels, each the mean over its part of the n."""
    means: Floats = _area_weights(len(values), m) @ values.reshape(len(values), -1)
    return means.reshape(m, *values.shape[1:])


@cache
def _area_weights(n: int, m: int) -> csr_array:
    """Sparse (m, n): the share of each of the n pixels in each of the m pixels; rows sum to 1."""
    edges = np.linspace(0, n, m + 1)
    low, high = np.maximum(edges[:-1, None], np.arange(n)), np.minimum(edges[1:, None], np.arange(n) + 1)
    return csr_array(np.clip(high - low, 0, None) * m / n)


def draw_picture(radiance: Floats, mask: Mask, exposure: float, largest: int = 256) -> bytes:
    """PNG of radiance times exposure through the sRGB curve, clipped at white; transparent off the mask."""
    linear, share = downscale(radiance, mask, largest)
    linear = np.clip(linear * exposure, 0, 1)
    rgba = np.round(255 * np.dstack([encode(linear), np.clip(share, 0, 1)])).astype(np.uint8)
    return _encode_png(Image.fromarray(rgba))


def draw_error_map(error: Floats, mask: Mask, limit: float, signed: bool = True, largest: int = 256) -> bytes:
    """PNG of an error (H, W), full colour at `limit`: from black at zero, or, signed, from blue over white to red.

    Colours 0 to 254 of the palette are the scale, from -limit or from 0 to limit; 255 is transparent, off the mask.
    """
    finite = np.where(np.isfinite(error), error, limit)[..., None]
    value, share = downscale(finite, mask, largest)
    scaled = np.clip(value[..., 0] / limit, -1 if signed else 0, 1)
    index = np.round(127 + 127 * scaled if signed else 254 * scaled).astype(np.uint8)
    index[share < 0.5] = 255
    image = Image.fromarray(index)
    colours = (SIGNED if signed else UNSIGNED)(range(255))
    image.putpalette(np.round(255 * colours[:, :3]).astype(np.uint8).tobytes() + bytes(3))
    return _encode_png(image, transparency=255)


def scale(signed: bool = True) -> bytes:
    """PNG of the colours of error maps from left to right, one pixel high."""
    colours = (SIGNED if signed else UNSIGNED)(range(255))
    return _encode_png(Image.fromarray(np.round(255 * colours[None, :, :3]).astype(np.uint8)))


def find_error_limit(errors: Sequence[Floats]) -> float:
    """The end of the scale that error maps share: a percentile of |error| over all their pixels."""
    size = np.abs(np.concatenate([error.ravel() for error in errors]))
    size = size[np.isfinite(size)]
    if not size.size:
        return 1.0
    return float(np.percentile(size, 100 - CLIPPED_SHARE)) or float(size.max()) or 1.0


def find_middle_limit(errors: Sequence[Floats]) -> float:
    """The median of the scales that these error maps would have alone; of two middle ones the lower.

    A map whose errors are far larger than the others is then clipped, and the others still show their differences.
    """
    return sorted(find_error_limit([error]) for error in errors)[(len(errors) - 1) // 2]


def choose_exposure(reference: Floats, mask: Mask) -> float:
    """The factor that brings a high percentile of the reference's brightest channel to white."""
    brightest = reference[mask].max(axis=1)
    white = float(np.percentile(brightest, WHITE)) or float(brightest.max())
    return 1 / white if white > 0 else 1.0


def to_uri(png: bytes) -> str:
    """An image as the source of an <img>."""
    return f"data:image/png;base64,{b64encode(png).decode()}"


def svg_to_uri(svg: bytes) -> str:
    """A drawing as the source of an <img>."""
    return f"data:image/svg+xml;base64,{b64encode(svg).decode()}"


def _encode_png(image: Image.Image, **options: int) -> bytes:
    out = BytesIO()
    image.save(out, format="PNG", **options)
    return out.getvalue()
