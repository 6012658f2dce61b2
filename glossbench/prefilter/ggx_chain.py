"""A chain of cubes: the light filtered by round lobes of GGX, wider from level to level, and the lookup by alpha."""

from typing import Any

import torch
from torch import Tensor

from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.pyramid import Pyramid, join_levels
from glossbench.prefilter.pyramids import build_pyramid
from glossbench.prefilter.round_lobes import RoundGGX
from glossbench.prefilter.texel_sums import sum_over_tree
from glossbench.shading.method import stage

COARSEST = 16  # texels along an edge that rough levels keep, as in engines


@stage
def ggx_levels(self: Any, light: CubeMap) -> Pyramid:
    """The chain: level k of K = log2 R has alpha = (k / K)^2 and R / 2^k texels along an edge, at least 16."""
    n, source = light.resolution.bit_length() - 1, build_pyramid(light, "box")
    levels = [light.faces]
    for k in range(1, n + 1):
        lobe = RoundGGX(torch.tensor((k / n) ** 2, device=light.faces.device), "g2")
        levels.append(sum_over_tree(light, source, lobe, max(light.resolution >> k, min(COARSEST, light.resolution))))
    return join_levels(levels)


def level_of_alpha(levels: Pyramid, alpha: Tensor) -> Tensor:
    """The level of the chain whose lobe has a width, K sqrt(alpha)."""
    return (len(levels.sizes) - 1) * torch.sqrt(alpha)
