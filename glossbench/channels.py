"""Quantities in colour: one tensor if they are grey, three if red, green and blue differ."""

from collections.abc import Sequence

import torch

from glossbench.shapes import Radiance, Scalar, Values

Channels = tuple[Values, ...]
LUMINANCE = (0.2126, 0.7152, 0.0722)  # of linear Rec. 709
LARGEST = 1e30  # float32 ends at 3.4e38: a sum over 10^8 pixels of this stays below


def widen(channels: Channels, n: int) -> Channels:
    """A grey quantity as n channels."""
    return channels * n if len(channels) == 1 else channels


def add(a: Channels, b: Channels) -> Channels:
    """a + b, channel by channel. An empty tuple is zero; a grey quantity is added to all three channels."""
    if not a or not b:
        return a or b
    n = max(len(a), len(b))
    return tuple(x + y for x, y in zip(widen(a, n), widen(b, n), strict=True))


def channels(color: tuple[float, ...], device: str) -> Channels:
    """A colour as tensors: one if its components are equal, otherwise three."""
    values = color[:1] if len(set(color)) == 1 else color
    return tuple(scalar(v, device) for v in values)


def channels_unless_black(color: tuple[float, ...], device: str) -> Channels:
    """A colour as tensors, as `channels`; no tensor if it is black."""
    return channels(color, device) if any(color) else ()


def scalar(value: float, device: str) -> Scalar:
    """A number as a float32 tensor."""
    return torch.tensor(value, dtype=torch.float32, device=device)


def merge_channels(sums: Sequence[Radiance]) -> Radiance:
    """RGB of light that was summed once for each channel of its weight.

    Column c of the result is column c of sum c. If the weight is grey, the result is the only sum.
    """
    return sums[0] if len(sums) == 1 else torch.stack([s[:, c] for c, s in enumerate(sums)], dim=1)
