"""The light filtered by round GGX lobes: a chain of cubes by alpha, summed over all texels, and the lookup by alpha."""

from math import ceil, log2, pi
from typing import Any

import torch
from torch import Tensor

from glossbench.directions import stack
from glossbench.envmap.cubemap import CubeMap, add_border, texel_directions, texel_solid_angles
from glossbench.envmap.pyramid import FILTERS, Pyramid, halve
from glossbench.shading.method import stage
from glossbench.shapes import Faces

COARSEST = 16  # texels along an edge that rough levels keep, as in engines
PAIRS = 1 << 18  # of texels, at a time; measured, 2^16 takes 1.4 and 2^22 2.2 times as long


def filter_ggx(faces: Faces, alpha: float, edge: int) -> Faces:
    """P(r) = sum of w L / sum of w over all texels above the horizon of r, w = D(h) G2 / 4 at n = wo = r.

    That is f cos_i of GGX without Fresnel for the view along the normal. Texels of the light are averaged first, as
    long as they stay below a quarter of the lobe's width, R >= 2 pi / alpha, and R >= 32. A light whose texels are
    wider has no detail to lose, but its own interpolation is not part of the sum.

    Args:
        edge: texels along an edge of the result.

    Source: the weight that Karis 2013 replaces by cos_i; G2, Heitz 2014 eq. 99.
    """
    while faces.shape[1] >= 2 * max(edge, 32, 2 ** ceil(log2(2 * pi / alpha))):
        faces = halve(faces, FILTERS["box"])
    resolution = faces.shape[1]
    solid_angle = texel_solid_angles(resolution).float().to(faces.device).expand(6, -1, -1)[..., None]
    weighted = torch.cat([faces * solid_angle, solid_angle], dim=3).reshape(-1, 4)
    light = stack(texel_directions(resolution)).reshape(-1, 3).T.to(faces.device)
    r = stack(texel_directions(edge)).reshape(-1, 3).to(faces.device)
    sums = torch.cat([weigh(some @ light, alpha) @ weighted for some in r.split(max(1, PAIRS // light.shape[1]))])
    return (sums[:, :3] / sums[:, 3:]).view(6, edge, edge, 3)


def weigh(cos: Tensor, alpha: float) -> Tensor:
    """w at cos = r . wi, up to a factor, in place of cos; cos_h^2 = (1 + cos) / 2."""
    a2 = alpha * alpha
    cos.clamp_(min=0)
    slope = cos.mul((a2 - 1) / 2).add_((a2 + 1) / 2)
    lambdas = (cos * cos).mul_(1 - a2).add_(a2).sqrt_().add_(cos)
    return cos.div_(lambdas.mul_(slope).mul_(slope))


@stage
def ggx_levels(self: Any, light: CubeMap) -> Pyramid:
    """The chain: level k of K = log2 R has alpha = (k / K)^2 and R / 2^k texels along an edge, at least 16."""
    n = light.resolution.bit_length() - 1
    edges = [max(light.resolution >> k, min(COARSEST, light.resolution)) for k in range(n + 1)]
    cubes = [light.faces] + [filter_ggx(light.faces, (k / n) ** 2, edges[k]) for k in range(1, n + 1)]
    texels = [add_border(cube).reshape(-1, 3) for cube in cubes]
    starts = [sum(len(t) for t in texels[:k]) for k in range(n + 1)]
    offsets, sizes = torch.tensor([starts, edges], dtype=torch.int32, device=light.faces.device)
    return Pyramid(torch.cat(texels), offsets, sizes)


def level_of_alpha(levels: Pyramid, alpha: Tensor) -> Tensor:
    """The level of the chain whose lobe has a width, K sqrt(alpha)."""
    return (len(levels.sizes) - 1) * torch.sqrt(alpha)
