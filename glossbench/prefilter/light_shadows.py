"""Shadows of N directional lights: by a ray a light, or by variance shadow maps as soft as the lights are wide."""

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
from glossbench.scene.camera import framing
from glossbench.scene.mesh import Mesh
from glossbench.scene.points import Occluder, ShadingPoints
from glossbench.shading.kernels import untraced
from glossbench.shading.method import stage

Visibility = Literal["none", "shadow_maps", "rays"]


class Shadows(Protocol):
    """What of each light reaches a point."""

    def visible(self, points: ShadingPoints) -> Tensor:
        """Share of each light (P, N), in [0, 1], at points with components (P, 1)."""


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
        occluder: what hides them.
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
    """N images of height towards the light, m1, and its square, m2, blurred: what lies above a point at height z?

    Of what the blur covers at most the share p = v / (v + (m1 - z)^2) is no higher than z < m1, v = m2 - m1^2
    (Chebyshev's inequality for one tail): a point below m1 sees p of the light, one that is not sees all of it. An
    equality for one flat blocker over a flat receiver; where blockers overlap, light bleeds through: what is below
    `light_bleeding` is taken as dark, (p - b) / (1 - b). Which way a surface faces the maps do not ask: its own other
    side hides it, where it has one.

    Attributes:
        moments: (N, 2, M, M), float32.
        placing: a point (x, y, z, 1) to the image's right and down, in [-1, 1], and to its height: (3, 4, N).
        least_variance: the square of half a texel, (1, N), so that rounding casts no shadow.
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
    """Why the shadows of a scene cannot be had; None where they can."""
    if visibility == "shadow_maps" and isinstance(scene, Occluder) and not isinstance(scene, Mesh):
        return "its shadow maps need a mesh"
    return None


def cast(
    visibility: Visibility, scene: Any, direction: Vec3, solid_angle: Tensor,
    resolution: int, blocker_distance: float, light_bleeding: float,
) -> Shadows:  # fmt: skip
    """The shadows of N lights, directions and solid angles (N,); the last three of shadow maps alone."""
    if visibility == "none" or not isinstance(scene, Occluder):
        return NoShadows(len(solid_angle))
    if visibility == "rays":
        return RayShadows(Vec3(*(c[None] for c in direction)), scene)
    assert isinstance(scene, Mesh)
    return variance_shadow_maps(scene, direction, solid_angle, resolution, blocker_distance, light_bleeding)


@stage
def shadows(self: Any, partition: Partition, scene: Any) -> Shadows:
    """What hides the regions of the light, by the method's `visibility`."""
    return cast(
        self.visibility, scene, partition.direction, partition.solid_angle,
        self.shadow_resolution, self.blocker_distance, self.light_bleeding,
    )  # fmt: skip


def variance_shadow_maps(
    mesh: Mesh,
    direction: Vec3,
    solid_angle: Tensor,
    resolution: int = 256,
    blocker_distance: float = 0.25,
    light_bleeding: float = 0.0,
) -> VarianceShadowMaps:
    """Shadow maps of N lights: heights of first hits along parallel rays, framed to the mesh, blurred.

    A disc of the light's solid angle, 2 pi (1 - cos a), shines past an edge at distance d into a penumbra that is the
    edge under a disc of radius d tan a; the Gaussian has the standard deviation of that disc along an axis,
    d tan(a) / 2. A blur of depth cannot know d: one distance stands for all. Where rays hit nothing the height is that
    of the mesh's lowest vertex, and so it is beyond the image.

    Args:
        direction: to the lights, (N,).
        solid_angle: of the lights, below 2 pi, (N,) [sr].
        resolution: M.
        blocker_distance: d, where the mesh has a half-extent of 1; 0 for no blur.
    """
    toward = stack(direction).cpu().double().numpy()
    cosine = 1 - solid_angle.cpu().double().numpy() / (2 * pi)
    deviation = blocker_distance / 2 * np.sqrt(1 - cosine**2) / cosine
    rendered = [_rendered(mesh, d, s, resolution) for d, s in zip(toward, deviation, strict=True)]
    moments, placing, texel = (np.stack(values) for values in zip(*rendered, strict=True))
    device = solid_angle.device
    return VarianceShadowMaps(
        torch.from_numpy(moments).to(device),
        torch.from_numpy(placing).float().permute(1, 2, 0).contiguous().to(device),
        torch.from_numpy((texel[None] / 2) ** 2).float().to(device),
        light_bleeding,
    )


def _rendered(
    mesh: Mesh, toward: NDArray[np.float64], deviation: float, resolution: int
) -> tuple[NDArray[np.float32], NDArray[np.float64], float]:
    """Moments (2, M, M), placing (3, 4) and the edge of a texel of one light."""
    azimuth, elevation = np.degrees([np.arctan2(toward[0], toward[2]), np.arcsin(np.clip(toward[1], -1, 1))])
    camera = framing(mesh.vertices, 1.0, azimuth, elevation, None, 1.0)
    right, up, back = camera.axes
    lowest = (mesh.vertices @ back).min()
    origins, directions = camera.rays(resolution, resolution)
    hit = mesh.rays.first_hit(origins, directions).distance
    # Above the lowest vertex, so that nothing is 0, as is what the blur finds beyond the image.
    height = np.where(np.isfinite(hit), origins @ back - hit - lowest, 0.0).reshape(resolution, resolution)
    texel = 2 * camera.half / resolution
    blurred = [scipy.ndimage.gaussian_filter(m, deviation / texel, mode="constant") for m in (height, height**2)]
    x, y = camera.middle[:2] / camera.half
    placing = np.vstack([[*right / camera.half, -x], [*-up / camera.half, y], [*back, -lowest]])
    return np.stack(blurred).astype(np.float32), placing, texel
