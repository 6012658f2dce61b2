"""Textures of 8 bits per channel whose product is a radiance, as on graphics hardware with values in [0, 1]."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class FixedPoint:
    """min(color q_1 ... q_J, 1) scale ~ t_1 ... t_J.

    Attributes:
        textures: q_j with 8 bits per channel, as float32 multiples of 1/255 in [0, 1].
        color: the correction colour (3,), in [0, 1].
        scale: 1, 2 or 4; the result is multiplied by it in the last step, so that values are not cut off too early.
        excess: the product of the maxima over `scale`, if that is above 1, otherwise 1, (3,).
    """

    textures: tuple[Tensor, ...]
    color: Tensor
    scale: int
    excess: Tensor


def fixed_point(textures: Sequence[Tensor], prescale: float) -> FixedPoint:
    """Textures (..., 3) normalised to the maximum of each channel and rounded to 8 bits.

    The product of the maxima is the correction colour. It is split into a colour of at most 1 and a scale of 1, 2 or 4.
    If it is above 4, the remaining factor is the excess. Then the textures together are brightened by excess^prescale
    and cut off at 1. The share of each texture is proportional to log(maximum / mean), so the loss is in the highlights
    of the texture that has them. The rest of the excess darkens the whole image.

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
