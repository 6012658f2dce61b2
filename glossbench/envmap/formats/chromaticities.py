"""Chromaticities: converts radiance in other primaries to linear Rec. 709."""

from collections.abc import Sequence

import numpy as np

from glossbench.errors import InputError

# CIE xy of red, green, blue and white.
REC_709 = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), (0.3127, 0.3290))
_XYZ = ((1.0, 0.0), (0.0, 1.0), (0.0, 0.0))
_ROUNDING = 5e-4  # files state three decimals or more
_ROWS = 256  # converted at a time, to bound the memory
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


def to_rec709(pixels: np.ndarray, chromaticities: Sequence[tuple[float, float]]) -> np.ndarray:
    """Radiance (..., 3) in linear Rec. 709; the same array if the chromaticities are those of Rec. 709.

    A colour outside Rec. 709 gets a negative channel.

    Args:
        chromaticities: CIE xy of red, green, blue and white.

    Raises:
        InputError: as `build_matrix_to_rec709`.
    """
    if len(chromaticities) == 4 and np.allclose(chromaticities, REC_709, rtol=0, atol=_ROUNDING):
        return pixels
    return pixels @ build_matrix_to_rec709(chromaticities).T.astype(pixels.dtype)


def convert_to_rec709(
    image: np.ndarray, chromaticities: Sequence[tuple[float, float]], stated: str
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Converts an image (H, W, 3) to linear Rec. 709, in place, and returns it with notes.

    If a colour outside Rec. 709 gets a negative channel, this channel is set to 0. Invalid chromaticities leave the
    image unchanged.

    Args:
        stated: the name of the chromaticities in the note.
    """
    n_outside = 0
    for row in range(0, len(image), _ROWS):
        stored = image[row : row + _ROWS]
        try:
            converted = to_rec709(stored, chromaticities)
        except InputError as error:
            return image, (f"taken as linear Rec. 709, for its {error}",)
        if converted is stored:
            return image, ()
        outside = (converted < 0) & (stored >= 0).all(-1, keepdims=True)
        n_outside += int(outside.any(-1).sum())
        image[row : row + _ROWS] = np.where(outside, 0, converted)
    note = f"converted from {stated} to linear Rec. 709"
    if n_outside:
        note += f"; {n_outside} pixels have colours beyond Rec. 709, their negative channels are 0"
    return image, (note,)


def build_matrix_to_rec709(chromaticities: Sequence[tuple[float, float]]) -> np.ndarray:
    """Matrix (3, 3), float64, from radiance in these primaries to linear Rec. 709.

    M = inverse(P709) A P. P is the matrix from the primaries to XYZ, scaled so that (1, 1, 1) is the white; A is the
    Bradford adaptation from this white to that of Rec. 709, so white stays (1, 1, 1). For the primaries of CIE XYZ
    itself A is not needed.

    Raises:
        InputError: the chromaticities are not four pairs of numbers below 10, the primaries are on one line, or the
            white is outside their triangle.

    Source: SMPTE RP 177, normalised primary matrix; Bradford, Lam 1985 with the numbers of Lindbloom, as in OpenEXR's
    ImfAcesFile.
    """
    xy = np.asarray(chromaticities, np.float64)
    stated = " ".join(f"({x:g}, {y:g})" for x, y in xy.reshape(-1, 2)) if xy.size % 2 == 0 else str(xy.tolist())
    if xy.shape != (4, 2) or not (np.abs(xy) < 10).all():
        raise InputError(f"chromaticities must be four pairs below 10: red, green, blue, white, got {stated}")
    *_, (_, y) = xy
    primaries = np.column_stack([xy, 1 - xy.sum(1)]).T  # columns x, y, z
    if y <= 0 or abs(np.linalg.det(primaries[:, :3])) < 1e-6:
        raise InputError(f"chromaticities must be a triangle with the white in it, got {stated}")
    white = primaries[:, 3] / y
    luminance = np.linalg.solve(primaries[:, :3], white)
    if (luminance <= 0).any():
        raise InputError(f"chromaticities must be a triangle with the white in it, got {stated}")
    to_xyz = primaries[:, :3] * luminance
    if np.allclose(xy[:3], _XYZ, rtol=0, atol=_ROUNDING):
        adapted = np.diag(1 / luminance)  # the stored values are X, Y, Z, whatever the white is
    else:
        adapted = _build_adaptation(white, _build_matrix_of_rec709().sum(1))
    return np.linalg.solve(_build_matrix_of_rec709(), adapted @ to_xyz)


def _build_matrix_of_rec709() -> np.ndarray:
    xy = np.array(REC_709)
    primaries = np.column_stack([xy, 1 - xy.sum(1)]).T
    return primaries[:, :3] * np.linalg.solve(primaries[:, :3], primaries[:, 3] / xy[3, 1])


def _build_adaptation(white: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Matrix (3, 3) that maps one white (XYZ) to another by scaling the cone responses."""
    scale = np.diag((_BRADFORD @ wanted) / (_BRADFORD @ white))
    return np.linalg.solve(_BRADFORD, scale @ _BRADFORD)
