"""The lighting function: the radiance for every normal and every view direction, sampled at the texels of a cube.

Lo(v, n) = sum over texels l of the light of f(v, l) L(l) g(l) max(n . l, 0), g the solid angle of a texel, for all
pairs of directions n, v of a virtual cube of V texels per edge with n . v > 0. The 24 rotations of the cube map the
texels of the light, and those of the virtual cube, onto themselves. An isotropic f depends only on angles, so that for
a rotation G

    Lo(G v, G n) = sum over l of f(v, l) L(G l) g(l) max(n . l, 0)

The values f g cos of one normal serve 24 normals, and the sum is a matrix product: (views x texels) times (texels x 24
rotated lights). This is exact and needs only one of 24 evaluations of f.

Source: Latta and Kolb 2002, section 3.3, eq. 9 to 11.
"""

from dataclasses import dataclass
from itertools import permutations, product
from math import pi
from typing import Any, Literal

import torch
from torch import Tensor

from glossbench.brdf.material import Material, Reflectance
from glossbench.channels import widen
from glossbench.directions import Vec3, cross, spherical, to_local, vec3
from glossbench.envmap.cubemap import CubeMap, face_coordinates, texel_solid_angles
from glossbench.envmap.projections.resampling import resize
from glossbench.errors import InputError
from glossbench.scene.virtual_cube import LEAST_COSINE, tangent, valid_pairs, virtual_directions
from glossbench.shading.kernels import kernel
from glossbench.shading.kernels.backend import ready

TexelWeight = Literal["exact", "differential"]

# Values of f in a block: a few blocks stay in a core's second-level cache.
_BLOCK = 1 << 18


@dataclass(frozen=True)
class LightingSamples:
    """Samples of the lighting function, normal by normal.

    Attributes:
        radiance: Lo (S, 3), float64.
        pairs: indices (S, 2) of normal and view: texels of the virtual cube in the order (face, row, column).
        edge: V.
        n_values: number of evaluations of f.
        standard_error: standard error of the radiance, (S, 3), if it was estimated instead of summed.
    """

    radiance: Tensor
    pairs: Tensor
    edge: int
    n_values: int
    standard_error: Tensor | None = None


def anisotropy(material: Material) -> str | None:
    """The reason why the lighting function of a material needs a tangent; None for an isotropic material.

    The test rotates both directions about the normal and compares f, for pairs near the mirror direction and far from
    it.
    """
    reflectance = material.reflectance()
    theta_o, theta_i, phi = (torch.tensor(v)[:, None] for v in zip(*_PAIRS, strict=True))
    turns = torch.tensor([0.0, 0.4, 1.1, pi / 2, 2.3, 4.0])
    wo, wi = (Vec3(*torch.broadcast_tensors(*d)) for d in (spherical(theta_o, turns), spherical(theta_i, turns + phi)))
    f = reflectance.f(wo, wi)
    for values in f:
        largest = values.max(1).values
        if bool(((largest - values.min(1).values) > 1e-2 * largest).any()):
            return "its material is anisotropic, and factors of normal and view do not depend on the tangent"
    return None


_PAIRS = (
    *((0.5, 0.5 + a, pi + b) for a in (0.0, 0.05, 0.2) for b in (0.0, 0.05, 0.3)),
    *((a, b, c) for a in (0.2, 0.9, 1.3) for b in (0.3, 1.0) for c in (0.5, 2.0)),
)


def texel_weights(edge: int, weight: TexelWeight) -> Tensor:
    """g of all texels of a light, (6 E^2,), float64: exact, or (2 / E)^2 / (x^2 + y^2 + 1)^(3/2), eq. 11."""
    if weight == "exact":
        return texel_solid_angles(edge).repeat(6, 1, 1).flatten()
    x = (torch.arange(edge, dtype=torch.float64) * 2 + 1) / edge - 1
    g = (2 / edge) ** 2 * (x[:, None] ** 2 + x[None, :] ** 2 + 1) ** -1.5
    return g.repeat(6, 1, 1).flatten()


def sample_lighting_function(
    light: CubeMap,
    material: Material,
    edge: int = 12,
    light_edge: int = 64,
    weight: TexelWeight = "exact",
) -> LightingSamples:
    """Lo for all valid pairs of normal and view of a virtual cube, each the sum over all texels of the light.

    Args:
        edge: V, at least 2.
        light_edge: a finer light is averaged, by solid angle, to this number of texels along the edge of a face.
        weight: the formula of g.

    Raises:
        InputError: the material is anisotropic.
    """
    if reason := anisotropy(material):
        raise InputError(f"the lighting function: {reason}")
    device = light.faces.device
    n_texels = min(light_edge, light.resolution)
    faces = light.faces.cpu() if n_texels == light.resolution else resize(light.faces.cpu(), n_texels)
    texels = virtual_directions(n_texels).float().to(device)
    weights = texel_weights(n_texels, weight).float().to(device)
    rotated = faces.reshape(-1, 3)[_rotate_texels(n_texels)].to(device)  # (24, texels, 3)
    directions, images = virtual_directions(edge), _rotate_texels(edge)
    lo = torch.zeros(len(directions), len(directions), 3, dtype=torch.float64, device=device)
    first = images.min(0).values.unique()  # one normal of each orbit
    n_values = len(first) * len(directions) * len(texels) // 4
    reflectance = material.reflectance(str(device))
    counted = 0
    with torch.no_grad():
        for one in first.tolist():
            n = directions[one]
            seen = (directions @ n > LEAST_COSINE).nonzero()[:, 0]
            lit = (texels @ n.float().to(device) > 0).nonzero()[:, 0]
            sums = _sum_radiance(
                reflectance, n, directions[seen].to(device), texels[lit], weights[lit], rotated[:, lit], n_values
            )
            lo[images[:, one, None], images[:, seen]] = sums
            counted += len(seen) * len(lit)
    pairs = valid_pairs(edge)
    return LightingSamples(lo[pairs[:, 0], pairs[:, 1]], pairs, edge, counted)


def _sum_radiance(
    reflectance: Reflectance, n: Tensor, views: Tensor, texels: Tensor, weights: Tensor, rotated: Tensor, n_values: int
) -> Tensor:
    """Lo for one normal and its views under each of 24 rotated lights (24, texels, 3): (24, views, 3), float64."""
    normal = vec3(n.to(views.device))
    t = tangent(normal)
    frame = (t, cross(normal, t), normal)
    wo = Vec3(*(c.float()[:, None] for c in to_local(vec3(views), *frame)))
    wi = Vec3(*(c.float()[None] for c in to_local(vec3(texels.double()), *frame)))
    total = torch.zeros(3, len(views), len(rotated), dtype=torch.float64, device=views.device)
    size = max(2, _BLOCK // len(views))

    def of_block(block: slice) -> tuple[Any, ...]:
        return reflectance, wo, Vec3(*(c[:, block] for c in wi)), weights[None, block]

    evaluate = ready(_weigh_light, of_block(slice(0, size)), n_values)
    for start in range(0, len(texels), size):
        block = slice(start, start + size)
        values = evaluate(*of_block(block))
        for c, value in enumerate(widen(values, 3)):
            total[c] += (value @ rotated[:, block, c].T).double()
    return total.permute(2, 1, 0)


@kernel("lighting_function")
def _weigh_light(reflectance: Reflectance, wo: Vec3, wi: Vec3, weights: Tensor) -> tuple[Tensor, ...]:
    """f g cos_i, (views, texels), for each channel."""
    return tuple(f * (wi.z * weights) for f in reflectance.f(wo, wi))


def _list_rotations() -> Tensor:
    """The 24 rotations of a cube onto itself, (24, 3, 3), float64: permutations of the axes with signs."""
    eye = torch.eye(3, dtype=torch.float64)
    signs = [torch.tensor(s, dtype=torch.float64)[:, None] for s in product((1.0, -1.0), repeat=3)]
    turned = [s * eye[list(p)] for p in permutations(range(3)) for s in signs]
    return torch.stack([m for m in turned if torch.linalg.det(m) > 0])


def _rotate_texels(edge: int) -> Tensor:
    """The texel to which each rotation maps each texel, (24, 6 edge^2)."""
    turned = virtual_directions(edge) @ _list_rotations().transpose(1, 2)
    face, s, t, _ = face_coordinates(vec3(turned))
    column, row = (((c + 1) * edge / 2).floor().long().clamp(0, edge - 1) for c in (s, t))
    return (face.long() * edge + row) * edge + column
