"""Building MIP pyramids of a light: each level is the level before, filtered and halved by a kernel."""

from collections.abc import Callable
from typing import Literal

import torch
from torch import Tensor
from torch.nn.functional import pad

from glossbench.directions import Vec3
from glossbench.envmap.cubemap import CubeMap, add_border
from glossbench.envmap.paraboloid import Paraboloid, paraboloid_directions
from glossbench.envmap.pyramid import Pyramid, finest, lookup
from glossbench.shading.kernels.backend import ready
from glossbench.shading.kernels.kernel import kernel

MipFilter = Literal["box", "gauss4", "gauss6"]

# One row of each separable filter, before division by its sum: binomial coefficients (Luksch et al. 2014, section 3).
FILTERS: dict[str, tuple[float, ...]] = {
    "box": (1, 1),
    "gauss4": (1, 3, 3, 1),
    "gauss6": (1, 5, 10, 10, 5, 1),
}
# So many taps of values take as long as one point-sample pair, the unit of work in `ready`. Measured eagerly on a 1024
# cube: box 160, gauss4 190, gauss6 250.
TAPS_PER_PAIR = 200

# Writes images (K, R, R, 3) with borders of a width into a tensor (K, R + 2 width, R + 2 width, 3).
Border = Callable[[Tensor, int, Tensor], Tensor]


def build_pyramid(light: CubeMap, mip_filter: MipFilter) -> Pyramid:
    """All levels of a light; each is filtered from the level before, also across edges.

    A coarse texel is the separable weighted mean of the 2x2, 4x4 or 6x6 fine texels around it. As in the paper and on
    graphics hardware, texels are not weighted by solid angle.

    Source: Luksch et al. 2014, section 3.
    """
    return Pyramid(*build_mip_levels(light.faces, FILTERS[mip_filter], add_border))


def build_paraboloid(light: CubeMap, mip_filter: MipFilter) -> Paraboloid:
    """All levels of both images, at twice the resolution of a cube face: about as many texels per steradian.

    A texel is the mean of the light at its 2x2 sub-texel centres.
    """
    n = 2 * light.resolution
    directions = paraboloid_directions(2 * n)
    cube = finest(light)
    images = []
    for image in range(2):
        d = Vec3(*(c[image].reshape(-1).to(light.faces.device) for c in directions))
        fine = lookup(cube, d).view(n, 2, n, 2, 3)
        images.append(fine.mean(dim=(1, 3)))
    return Paraboloid(*build_mip_levels(torch.stack(images), FILTERS[mip_filter], repeat_edge))


def repeat_edge(images: Tensor, width: int, out: Tensor) -> Tensor:
    """Write images (K, R, R, 3) with their outermost texels repeated `width` times into `out`."""
    planes = images.permute(0, 3, 1, 2)
    return out.copy_(pad(planes, (width, width, width, width), mode="replicate").permute(0, 2, 3, 1))


def build_mip_levels(images: Tensor, taps: tuple[float, ...], border: Border) -> tuple[Tensor, Tensor, Tensor]:
    """Table, offsets and sizes of images (K, R, R, 3); each level is half of the level before, down to one texel."""
    n_images, resolution = images.shape[:2]
    sizes = [resolution >> level for level in range(resolution.bit_length())]
    counts = [n_images * (n + 2) ** 2 for n in sizes]
    offsets = [sum(counts[:level]) for level in range(len(sizes))]
    images = images.detach()  # no step that follows has a gradient
    texels = images.new_empty(sum(counts), 3)
    width = len(taps) // 2 - 1
    margin = max(width, 1)  # the same border is used for the filter and the table
    for offset, count, n in zip(offsets, counts, sizes, strict=True):
        level = texels[offset : offset + count].view(n_images, n + 2, n + 2, 3)
        padded = level if margin == 1 else images.new_empty(n_images, n + 2 * margin, n + 2 * margin, 3)
        border(images, margin, padded)
        if margin > 1:
            level.copy_(padded[:, margin - 1 : 1 - margin, margin - 1 : 1 - margin])
        if n > 1:
            images = halve(padded if width else images, taps)
    starts, edges = torch.tensor([offsets, sizes], dtype=torch.int32, device=texels.device)
    return texels, starts, edges


def halve(padded: Tensor, taps: tuple[float, ...]) -> Tensor:
    """Halve images (K, H, W, C) with a border of len(taps) / 2 - 1 texels: the filter is centred on each 2x2 block."""
    run = ready(_halve_image, [padded[0], taps], padded.numel() * len(taps) // (4 * TAPS_PER_PAIR))
    with torch.no_grad():
        return torch.stack([run(image, taps) for image in padded])  # one by one: their rows stay in the cache


@kernel("halve")
def _halve_image(padded: Tensor, taps: tuple[float, ...]) -> Tensor:
    """One image (H, W, C): out[i, j] = sum over a, b of taps[a] taps[b] padded[2 i + a, 2 j + b] / sum(taps)^2."""
    height, width = ((n - len(taps)) // 2 + 1 for n in padded.shape[:2])
    rows = _combine([padded[k::2][:height] for k in range(len(taps))], taps)
    columns = [rows[:, 0::2], rows[:, 1::2]]
    if len(taps) > 2:  # each is read more than once
        columns = [each.contiguous() for each in columns]
    return _combine([columns[k % 2][:, k // 2 :][:, :width] for k in range(len(taps))], taps)


def _combine(slices: list[Tensor], taps: tuple[float, ...]) -> Tensor:
    """sum of taps[k] slices[k] / sum(taps) for a symmetric filter: two slices share each tap."""
    half, total = len(taps) // 2, sum(taps)
    out = torch.add(slices[half - 1], slices[half]).mul_(taps[half] / total)
    for k in range(half - 1):
        out.add_(slices[k], alpha=taps[k] / total).add_(slices[-1 - k], alpha=taps[k] / total)
    return out
