"""Radiance rounded to the formats in which programs store it."""

import torch
from torch import Tensor

from .settings import Storage

HALF_MAX = 65504.0
# Bits after the point of the three channels of R11G11B10F. All have 5 bits of exponent, as a half, and no sign.
MANTISSAS = (6, 6, 5)


def store(radiance: Tensor, storage: Storage) -> Tensor:
    """Radiance (..., 3) as it is read back; larger values become the largest of the format.

    R11G11B10F: a half with fewer bits, rounded to the nearest, ties away from zero; denormal numbers, too.
    """
    if storage == "half":
        return radiance.clamp(max=HALF_MAX).half().float()
    if storage == "r11g11b10":
        return torch.stack([_round(c, m) for c, m in zip(radiance.unbind(-1), MANTISSAS, strict=True)], dim=-1)
    return radiance


def _round(channel: Tensor, mantissa: int) -> Tensor:
    largest = (2 - 2.0**-mantissa) * 2.0**15
    exponent = torch.frexp(channel.clamp(min=2.0**-14, max=largest)).exponent - 1  # normal numbers begin at 2^-14
    step = torch.ldexp(torch.ones_like(channel), exponent - mantissa)
    return (torch.floor(channel / step + 0.5) * step).clamp(max=largest)
