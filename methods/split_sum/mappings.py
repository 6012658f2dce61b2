"""Level of a chain <-> width of its lobe. r = sqrt(alpha) is roughness; t = level / (levels - 1).

`alpha` and `level` are inverse, but for the last two: these programs read a level for another width than that it has.
"""

from collections.abc import Callable
from itertools import pairwise
from math import log2, sqrt
from typing import Literal, NamedTuple

MappingName = Literal[
    "exact", "linear", "filament", "hdrp", "unreal", "godot", "babylon", "eevee", "three_r185", "playcanvas"
]


class Layout(NamedTuple):
    """The number of levels of a chain, and the texels along the edge of level 0."""

    levels: int
    edge: int


class Mapping(NamedTuple):
    """Both ways: the width that a level is filtered with, and the level that is read for a width.

    Attributes:
        alpha: (level, layout) -> width; 0 is not filtered.
        level: (width, layout) -> level, which may lie outside the chain.
    """

    alpha: Callable[[int, Layout], float]
    level: Callable[[float, Layout], float]


def _by_share(roughness: Callable[[float], float], share: Callable[[float], float]) -> Mapping:
    """A mapping that depends only on t, from r(t) and t(r)."""
    return Mapping(
        lambda level, layout: roughness(level / (layout.levels - 1)) ** 2,
        lambda alpha, layout: share(sqrt(alpha)) * (layout.levels - 1),
    )


def _linear(x: float) -> float:
    return x


# Roughness at the ends of the linear parts of three.js r182 to r186, and the mip of each. The last level has mip -2;
# there are log2(edge) + 3 levels, 11 for a cube of 256.
_THREE = ((1.0, -2.0), (0.8, -1.0), (0.4, 2.0), (0.305, 3.0), (0.21, 4.0))


def _three_level(alpha: float, layout: Layout) -> float:
    r = max(sqrt(alpha), 1e-3)
    mip = -2 * log2(1.16 * r)
    for (high, at_high), (low, at_low) in pairwise(_THREE):
        if low <= r <= high:
            mip = at_high + (high - r) / (high - low) * (at_low - at_high)
    return layout.levels - 3 - mip


def _unreal_alpha(level: int, layout: Layout) -> float:
    r = min(2 ** ((level - layout.levels + 3) / 1.2), 1.0)
    return 0.0 if r < 0.01 else r * r


def _eevee_roughness(t: float) -> float:
    """r at t = 0.6 x + 0.4 sqrt(x), x = r / 0.7."""
    return 0.7 * ((sqrt(0.16 + 2.4 * t) - 0.4) / 1.2) ** 2


def _eevee_share(r: float) -> float:
    x = min(r / 0.7, 1.0)
    return 0.6 * x + 0.4 * sqrt(x)


MAPPINGS: dict[MappingName, Mapping] = {
    "linear": _by_share(_linear, _linear),
    "filament": _by_share(lambda t: 1 - sqrt(1 - t), lambda r: r * (2 - r)),
    "hdrp": _by_share(lambda t: 1.7 / 1.4 - sqrt(2.89 / 1.96 - 2.8 / 1.96 * t), lambda r: r * (1.7 - 0.7 * r)),
    "godot": _by_share(lambda t: t * t, sqrt),
    "eevee": _by_share(_eevee_roughness, _eevee_share),
    "unreal": Mapping(_unreal_alpha, lambda alpha, layout: layout.levels - 3 + 1.2 * log2(max(sqrt(alpha), 1e-3))),
    "babylon": Mapping(
        lambda level, layout: min(2 ** (level / 0.8) / layout.edge, 1.0) if level else 0.0,
        lambda alpha, layout: 0.8 * log2(alpha * layout.edge),
    ),
    "three_r185": Mapping(lambda level, layout: (level / (layout.levels - 1)) ** 2, _three_level),
    # Cosine powers 512, 128, 32, 8, 2 with r = 1 - log2(power) / 11, which is 2 level / 11, are read at 5 r.
    "playcanvas": Mapping(lambda level, layout: (2 * level / 11) ** 2, lambda alpha, layout: 5 * sqrt(alpha)),
}
