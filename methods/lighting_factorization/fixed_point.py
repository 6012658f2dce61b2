"""Textures of 8 bits a channel whose product is a radiance, as graphics hardware with values in [0, 1] forms it."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class FixedPoint:
    """min(color q_1 ... q_J, 1) scale ~ t_1 ... t_J.

    Attributes:
        textures: q_j of 8 bits a channel, as float32 multiples of 1/255 in [0, 1].
        color: the correction colour (3,), in [0, 1].
        scale: 1, 2 or 4, by which the result is multiplied last, so that nothing is cut off too early.
        excess: by what factor the product of the maxima is beyond 4, (3,); 1 where it is not.
    """

    textures: tuple[Tensor, ...]
    color: Tensor
    scale: int
    excess: Tensor


def fixed_point(textures: Sequence[Tensor], prescale: float) -> FixedPoint:
    """Textures (..., 3) normalised to the maximum of each channel and rounded to 8 bits.

    The product of the maxima is the correction colour, split into a colour of at most 1 and a scale of 1, 2 or 4.
    Beyond 4 there is an excess: the textures are brightened by excess^prescale together, each in proportion to the
    logarithm of its maximum over its mean, and cut off at 1. That costs highlights, of the texture that has them; what
    prescale leaves of the excess darkens all.

    Args:
        prescale: in [0, 1].

    Source: Latta and Kolb 2002, section 3.4, where the pre-scaling is adjusted by hand.
    """
    maxima = [t.reshape(-1, t.shape[-1]).max(0).values.clamp(min=1e-30) for t in textures]
    product = torch.stack(maxima).double().prod(0)
    scale = next((s for s in (1, 2, 4) if float(product.max()) <= s), 4)
    excess = (product / scale).clamp(min=1)
    means = [t.reshape(-1, t.shape[-1]).mean(0).clamp(min=1e-30) for t in textures]
    peaks = torch.stack([torch.log(m / a) for m, a in zip(maxima, means, strict=True)]).double() + 1e-9
    gains = (excess ** (prescale * peaks / peaks.sum(0))).float()
    stored = tuple(
        torch.round((t / m * gain).clamp(0, 1) * 255) / 255 for t, m, gain in zip(textures, maxima, gains, strict=True)
    )
    return FixedPoint(stored, (product / scale / excess).float(), scale, excess.float())
