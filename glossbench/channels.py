"""Quantities in colour: one tensor where they are grey, three where red, green and blue differ."""

import torch

from glossbench.shapes import Values

Channels = tuple[Values, ...]
LARGEST = 1e30  # float32 ends at 3.4e38: a sum over 10^8 pixels of this stays below


def widen(channels: Channels, n: int) -> Channels:
    """A grey quantity as n channels."""
    return channels * n if len(channels) == 1 else channels


def add(a: Channels, b: Channels) -> Channels:
    """Channel by channel; an empty tuple is zero, a grey one counts for all three channels."""
    if not a or not b:
        return a or b
    n = max(len(a), len(b))
    return tuple(x + y for x, y in zip(widen(a, n), widen(b, n), strict=True))


def channels(color: tuple[float, ...], device: str) -> Channels:
    """A colour as tensors: one when its components are equal, else three."""
    values = color[:1] if len(set(color)) == 1 else color
    return tuple(torch.tensor(v, dtype=torch.float32, device=device) for v in values)
