"""The direction in which a chain is read: between the mirror direction and the normal, where a rough lobe leans."""

from math import sqrt

from torch import Tensor

from glossbench.prefilter import Vec3, lerp, normalize

from .settings import Direction


def lean(r: Vec3, n: Vec3, cos_o: Tensor, alpha: float, direction: Direction) -> Vec3:
    """n + f (r - n), of unit length.

    mirror f = 1; filament f = 1 - alpha^2; with a = 1 - alpha, frostbite f = a (sqrt(a) + alpha) and
    hdrp f = (sqrt(a) + alpha) min(a^2 + a cos_o^2, 1).

    Source: frostbite, Lagarde and Rousiers 2014; hdrp, ImageBasedLighting.hlsl of Unity's Core package.
    """
    a = 1 - alpha
    f: float | Tensor
    if direction == "mirror":
        return r
    if direction == "filament":
        f = 1 - alpha * alpha
    elif direction == "frostbite":
        f = a * (sqrt(a) + alpha)
    else:
        f = (sqrt(a) + alpha) * (a * a + a * cos_o * cos_o).clamp(max=1)
    return normalize(lerp(n, r, f))
