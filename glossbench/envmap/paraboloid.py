"""Dual paraboloid maps: two square images; each shows one hemisphere and a rim of the other one."""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import pad

from glossbench.directions import Vec3
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.pyramid import FILTERS, MipFilter, MipTable, Taps, build_mip_levels, finest, lookup

SCALE = 1.2  # b of the paper


@dataclass(frozen=True)
class Paraboloid(MipTable):
    """A MIP-mapped dual paraboloid map; both images are filtered separately.

    Image coordinates in [-1, 1]^2: s = x / (b (1 + |z|)), t = -y / (b (1 + |z|)), b = 1.2; image 0 shows z < 0
    (forward), image 1 z >= 0.

    Source: Heidrich and Seidel 1998; scale and Jacobian, Krivanek and Colbert 2008 section 5.1.
    """

    def taps(self, d: Vec3, lod: Tensor | None) -> Taps:
        """Rows and weights for unit directions."""
        inverse = 0.5 / (SCALE * (1 + d.z.abs()))
        return self.bilinear((d.z >= 0).int(), d.x * inverse + 0.5, 0.5 - d.y * inverse, lod)

    def log2_texels_per_sr(self, d: Vec3) -> Tensor:
        """log2(w h / r(z)); r(z) = 4 b^2 (|z| + 1)^2 is the solid angle per image area at z, the image being 1 x 1."""
        return 2 * (torch.log2(self.sizes[0].float()) - torch.log2(2 * SCALE * (d.z.abs() + 1)))


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


def paraboloid_directions(resolution: int) -> Vec3:
    """Unit directions of the texel centres, components (2, R, R).

    p = b (s, t) is a point of the paraboloid: |z| = (1 - p^2) / (1 + p^2), negative beyond the image's hemisphere.
    """
    p = SCALE * ((torch.arange(resolution, dtype=torch.float64) * 2 + 1) / resolution - 1)
    x, y = p[None, :].expand(resolution, resolution), -p[:, None].expand(resolution, resolution)
    p2 = x * x + y * y
    z = (1 - p2) / (1 + p2)
    x, y = x * (1 + z), y * (1 + z)
    return Vec3(*(torch.stack(pair).float() for pair in ((x, x), (y, y), (-z, z))))


def repeat_edge(images: Tensor, width: int, out: Tensor) -> Tensor:
    """Write images (K, R, R, 3) with their outermost texels repeated `width` times into `out`."""
    planes = images.permute(0, 3, 1, 2)
    return out.copy_(pad(planes, (width, width, width, width), mode="replicate").permute(0, 2, 3, 1))
