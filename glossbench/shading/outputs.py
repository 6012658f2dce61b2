"""Checks of the values that plug-ins return in addition to radiance: a wrong type, shape or size is a MethodError.

These values go into the table, the files and the reports of a run, and a fault in one cell must not end the run.
"""

import operator
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from glossbench.errors import MethodError
from glossbench.scene.points import View

MOST_SAMPLES = 1 << 53  # double precision holds every whole number up to this
MOST_PIXELS = 8192  # along an edge
LONGEST = 80  # characters in the name of a picture, which is part of a file name


def check_reason(by: str, value: Any) -> str | None:
    """The checked result of `supports`: None, or a sentence."""
    if value is None:
        return None
    text = escape_surrogates(str(value))
    if isinstance(value, bool) or not text.strip():
        raise MethodError(
            f"{by}.supports must return None or a sentence that says why not, got {_describe_value(value)}"
        )
    return text


def check_count(by: str, value: Any) -> int:
    """The checked result of `n_samples`: a whole number."""
    rule = f"{by}.n_samples must return a whole number in [0, 2^53]"
    try:
        if isinstance(value, bool | np.bool_):
            raise TypeError
        count = operator.index(value)
    except (TypeError, RuntimeError):
        raise MethodError(f"{rule}, got {_describe_value(value)}") from None
    if not 0 <= count <= MOST_SAMPLES:
        raise MethodError(f"{rule}, got {_describe_value(count)}")
    return count


def check_notes(by: str, value: Any) -> list[str]:
    """The checked result of `notes`: sentences."""
    if not isinstance(value, list | tuple) or not all(isinstance(note, str) for note in value):
        raise MethodError(f"{by}.notes must return a tuple of sentences, got {_describe_value(value)}")
    return [escape_surrogates(note) for note in value]


def check_key(by: str, value: Any) -> str:
    """The checked result of `key`: text."""
    if not isinstance(value, str):
        raise MethodError(f"{by}.key must return text, got {_describe_value(value)}")
    return escape_surrogates(value)


def check_number(by: str, value: Any) -> float:
    """The checked result of a metric: a number, which may be infinite, but not NaN."""
    try:
        if isinstance(value, str | bytes | bool | np.bool_):
            raise TypeError
        number = float(value)
    except (TypeError, ValueError, OverflowError, RuntimeError):
        raise MethodError(f"metric {by} must return a number, got {_describe_value(value)}") from None
    if number != number:
        raise MethodError(f"metric {by} must return a number, got NaN")
    return number


def check_pattern(by: str, value: Any) -> NDArray[np.float32] | None:
    """The checked result of `half_vectors`: None, or a finite tensor (N, 2)."""
    if value is None:
        return None
    rule = f"{by}.half_vectors must return None or finite numbers (N, 2) in a tensor"
    if not isinstance(value, Tensor) or value.ndim != 2 or value.shape[1] != 2 or value.is_complex():
        raise MethodError(f"{rule}, got {_describe_value(value)}")
    found = value.detach().float().cpu()
    if not torch.isfinite(found).all():
        raise MethodError(f"{rule}, got numbers that are not finite")
    array: NDArray[np.float32] = found.numpy()
    return array


def check_pictures(by: str, value: Any) -> dict[str, Tensor]:
    """The checked result of `pictures`: finite images (H, W, 3) in tensors, by names that are valid in file names."""
    if not isinstance(value, Mapping):
        raise MethodError(
            f"{by}.pictures must return a mapping of names to tensors (H, W, 3), got {_describe_value(value)}"
        )
    found = {}
    for name, picture in value.items():
        if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_ .+-]*", name) or len(name) > LONGEST:
            rule = f"a name of letters, digits, '_', '-', '.', '+' and spaces, at most {LONGEST} of them"
            raise MethodError(f"{by}.pictures: a picture needs {rule}, got {name!r:.100}")
        rule = f"{by}.pictures: {name!r} must be a tensor (H, W, 3) of finite numbers, H and W at most {MOST_PIXELS}"
        shape = tuple(picture.shape) if isinstance(picture, Tensor) else ()
        if len(shape) != 3 or shape[2] != 3 or not all(1 <= n <= MOST_PIXELS for n in shape) or picture.is_complex():
            raise MethodError(f"{rule}, got {_describe_value(picture)}")
        found[name] = picture.detach().float().cpu()
        if not torch.isfinite(found[name]).all():
            raise MethodError(f"{rule}, got numbers that are not finite")
    return found


def check_view(view: View) -> None:
    """Raise MethodError if the mask or the points of a view have a wrong type, shape or value."""
    mask, points = view.mask(), view.points()
    if not isinstance(mask, Tensor) or mask.dtype != torch.bool or mask.ndim != 2:
        raise MethodError(f"{view.name}.mask must return booleans (H, W) in a tensor, got {_describe_value(mask)}")
    if not mask.any():
        raise MethodError(f"{view.name}.mask shows no point of a surface: none of its {mask.numel()} pixels is true")
    n = int(mask.sum())
    for name in ("t", "b", "n", "wo", "position", "ng"):
        vector = getattr(points, name)
        for c in vector or ():
            if not isinstance(c, Tensor) or tuple(c.shape) != (n,) or c.dtype != torch.float32:
                raise MethodError(
                    f"{view.name}.points: {name} needs components ({n},) float32, as the mask, got {_describe_value(c)}"
                )
            if not torch.isfinite(c).all():
                raise MethodError(f"{view.name}.points: {name} must be finite, got numbers that are not")


def escape_surrogates(text: str) -> str:
    """Text that every file can hold: half of a surrogate pair, which Python allows in text, is escaped."""
    return text.encode("utf-8", "backslashreplace").decode()


def _describe_value(value: Any) -> str:
    """A returned value in a few words."""
    if isinstance(value, Tensor | np.ndarray):
        return f"{type(value).__name__} {tuple(value.shape)} {str(value.dtype).removeprefix('torch.')}"
    if isinstance(value, int) and abs(value) > 10**30:
        return "a number of more than 30 digits"
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."
