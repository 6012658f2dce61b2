"""Shadows of N directional lights: by one ray per light, or by variance shadow maps, blurred by the light's width."""

from dataclasses import dataclass
from math import pi
from typing import Any, Literal, Protocol

import numpy as np
import scipy
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import grid_sample

from glossbench.directions import Vec3, stack
from glossbench.prefilter.median_cut import Partition
from glossbench.scene.camera import frame_vertices
from glossbench.scene.mesh import Mesh
from glossbench.scene.points import Occluder, ShadingPoints
from glossbench.shading.kernels import untraced
from glossbench.shading.method import stage

Visibility = Literal["none", "shadow_maps", "rays"]


class Shadows(Protocol):
    """The visibility of each of N lights from a point."""

    def visible(self, points: ShadingPoints) -> Tensor:
        """Visible share of each light (P, N), in [0, 1], at points with components (P, 1)."""


@dataclass(frozen=True)
class NoShadows:
    """N lights that nothing hides."""

    n_lights: int

    def visible(self, points: ShadingPoints) -> Tensor:
        """Ones (P, N)."""
        return torch.ones_like(points.n.x).expand(-1, self.n_lights)


@dataclass(frozen=True)
class RayShadows:
    """One ray to each light.

    Attributes:
        direction: to the lights, components (1, N).
        occluder: the scene that hides them.
    """

    direction: Vec3
    occluder: Occluder

    @untraced
    def visible(self, points: ShadingPoints) -> Tensor:
        """Ones and zeros (P, N); a light behind the surface is hidden."""
        assert points.position is not None
        assert points.ng is not None
        shape = torch.broadcast_shapes(points.n.x.shape, self.direction.x.shape)
        rays = (Vec3(*(c.expand(shape).flatten() for c in v)) for v in (points.position, points.ng, self.direction))
        return self.occluder.visible(*rays).view(shape).float()


@dataclass(frozen=True)
class VarianceShadowMaps:
    """N blurred images of the height towards the light, m1, and of its square, m2. They hide points below the height.

    p = v / (v + (m1 - z)^2) for z < m1, otherwise 1; v = m2 - m1^2

    By Chebyshev's inequality for one tail, at most the share p of the blurred area is at height z < m1 or below: a
    point below m1 sees the share p of the light, any other point all of it. The bound is exact for one flat blocker
    over a flat receiver. Where blockers overlap, light bleeds through, so shares below b = `light_bleeding` become 0:
    (p - b) / (1 - b). The maps do not test whether a surface faces the light: a closed surface hides its back itself.

    Attributes:
        moments: m1 and m2, (N, 2, M, M), float32.
        placing: maps a point (x, y, z, 1) to the right and down axes of the image, in [-1, 1], and to its height:
            (3, 4, N).
        least_variance: the square of half a texel, (1, N), so that rounding does not cast shadows.
        light_bleeding: b, in [0, 1).

    Source: Donnelly and Lauritzen 2006, "Variance shadow maps", eq. 5; b, Lauritzen 2007, "Summed-area variance shadow
    maps", section 8.4.3.
    """

    moments: Tensor
    placing: Tensor
    least_variance: Tensor
    light_bleeding: float

    def visible(self, points: ShadingPoints) -> Tensor:
        """The bound p (P, N)."""
        assert points.position is not None
        place = torch.cat([*points.position, torch.ones_like(points.n.x)], dim=1)
        x, y, z = torch.matmul(place, self.placing).unbind(0)
        grid = torch.stack([x, y], dim=-1).transpose(0, 1)[:, :, None]
        found = grid_sample(self.moments, grid, padding_mode="border", align_corners=False)[..., 0]
        m1, m2 = (m.T for m in found.unbind(1))
        variance = torch.maximum(m2 - m1 * m1, self.least_variance)
        p = variance / (variance + (m1 - z).clamp(min=0) ** 2)
        return ((p - self.light_bleeding) / (1 - self.light_bleeding)).clamp(min=0)


def no_shadows(visibility: Visibility, scene: Any) -> str | None:
    """The reason why the shadows of a scene cannot be computed; None if they can."""
    if visibility == "shadow_maps" and isinstance(scene, Occluder) and not isinstance(scene, Mesh):
        return "its shadow maps need a mesh"
    return None


def cast(
    visibility: Visibility, scene: Any, direction: Vec3, solid_angle: Tensor,
    resolution: int, blocker_distance: float, light_bleeding: float,
) -> Shadows:  # fmt: skip
    """The shadows of N lights with directions and solid angles (N,); only shadow maps use the last three arguments."""
    if visibility == "none" or not isinstance(scene, Occluder):
        return NoShadows(len(solid_angle))
    if visibility == "rays":
        return RayShadows(Vec3(*(c[None] for c in direction)), scene)
    assert isinstance(scene, Mesh)
    return build_variance_shadow_maps(scene, direction, solid_angle, resolution, blocker_distance, light_bleeding)


@stage
def shadows(self: Any, partition: Partition, scene: Any) -> Shadows:
    """The shadows of the regions of the light, by the method's option `visibility`."""
    return cast(
        self.visibility, scene, partition.direction, partition.solid_angle,
        self.shadow_resolution, self.blocker_distance, self.light_bleeding,
    )  # fmt: skip


def build_variance_shadow_maps(
    mesh: Mesh,
    direction: Vec3,
    solid_angle: Tensor,
    resolution: int = 256,
    blocker_distance: float = 0.25,
    light_bleeding: float = 0.0,
) -> VarianceShadowMaps:
    """Shadow maps of N lights: blurred heights of the first hits of parallel rays, in an image that frames the mesh.

    A disc of the light's solid angle, 2 pi (1 - cos a), seen past an edge at distance d, gives a penumbra: the edge
    blurred by a disc of radius d tan a. The Gaussian has the standard deviation of that disc along one axis,
    d tan(a) / 2. A blur of the heights cannot depend on d, so one distance is used everywhere. Where a ray does not hit
    the mesh, and outside the image, the height is that of the lowest vertex of the mesh.

    Args:
        direction: directions to the lights, (N,).
        solid_angle: solid angles of the lights, below 2 pi, (N,) [sr].
        resolution: M.
        blocker_distance: d, in units of the mesh's half-extent; 0 for no blur.
    """
    toward = stack(direction).cpu().double().numpy()
    cosine = 1 - solid_angle.cpu().double().numpy() / (2 * pi)
    deviation = blocker_distance / 2 * np.sqrt(1 - cosine**2) / cosine
    rendered = [_render(mesh, d, s, resolution) for d, s in zip(toward, deviation, strict=True)]
    moments, placing, texel = (np.stack(values) for values in zip(*rendered, strict=True))
    device = solid_angle.device
    return VarianceShadowMaps(
        torch.from_numpy(moments).to(device),
        torch.from_numpy(placing).float().permute(1, 2, 0).contiguous().to(device),
        torch.from_numpy((texel[None] / 2) ** 2).float().to(device),
        light_bleeding,
    )


def _render(
    mesh: Mesh, toward: NDArray[np.float64], deviation: float, resolution: int
) -> tuple[NDArray[np.float32], NDArray[np.float64], float]:
    """Moments (2, M, M), placing (3, 4) and the edge length of a texel, for one light."""
    azimuth, elevation = np.degrees([np.arctan2(toward[0], toward[2]), np.arcsin(np.clip(toward[1], -1, 1))])
    camera = frame_vertices(mesh.vertices, 1.0, azimuth, elevation, None, 1.0)
    right, up, back = camera.axes
    lowest = (mesh.vertices @ back).min()
    origins, directions = camera.rays(resolution, resolution)
    hit = mesh.rays.first_hit(origins, directions).distance
    # Heights are above the lowest vertex: so a ray without a hit has height 0, as the blur assumes outside the image.
    height = np.where(np.isfinite(hit), origins @ back - hit - lowest, 0.0).reshape(resolution, resolution)
    texel = 2 * camera.half / resolution
    blurred = [scipy.ndimage.gaussian_filter(m, deviation / texel, mode="constant") for m in (height, height**2)]
    x, y = camera.middle[:2] / camera.half
    placing = np.vstack([[*right / camera.half, -x], [*-up / camera.half, y], [*back, -lowest]])
    return np.stack(blurred).astype(np.float32), placing, texel
