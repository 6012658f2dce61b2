"""Dual paraboloid maps: two square images; each shows one hemisphere and a rim of the other one."""

from dataclasses import dataclass

import torch
from torch import Tensor

from glossbench.directions import Vec3
from glossbench.envmap.pyramid import MipTable, Taps

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
