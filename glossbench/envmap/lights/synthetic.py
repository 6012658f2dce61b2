"""Embedded lights: radiance by formula, so that studies do not need files and tests have known answers."""

from math import cos, pi, radians
from typing import Annotated

import torch
from pydantic import Field

from glossbench.directions import stack
from glossbench.envmap.cubemap import CubeMap, texel_directions
from glossbench.envmap.lights.light import LIGHTS, Light
from glossbench.errors import InputError
from glossbench.options import NonNegative, Radiance, Resolution, Seed


@LIGHTS.register("constant")
class Constant(Light):
    """L(d) = radiance: a furnace; every material reflects its albedo times this radiance.

    Attributes:
        radiance: a scalar or RGB.
        resolution: texels along the edge of a face, a power of two.
    """

    radiance: Radiance = (1.0, 1.0, 1.0)
    resolution: Resolution = 16

    def cubemap(self) -> CubeMap:
        """The radiance itself."""
        faces = torch.tensor(self.radiance).expand(6, self.resolution, self.resolution, 3)
        return CubeMap(faces.clone(), self.key())


@LIGHTS.register("gradient")
class Gradient(Light):
    """L_c(d) = radiance (1 + d_c) / 2, red towards +x, green towards +y, blue towards +z.

    Its irradiance is known: E_c(n) = radiance pi / 2 (1 + 2 n_c / 3).

    Attributes:
        radiance: the largest value of a channel.
        resolution: texels along the edge of a face, a power of two.
    """

    radiance: NonNegative = 1.0
    resolution: Resolution = 64

    def cubemap(self) -> CubeMap:
        """The radiance itself."""
        return CubeMap(self.radiance * (1 + stack(texel_directions(self.resolution))) / 2, self.key())


@LIGHTS.register("texel")
class SingleTexel(Light):
    """One bright texel, all others black: the most difficult light; it shows the shape of a method's kernel.

    Attributes:
        face, row, column: the texel (see cubemap); by default near the centre of the face +z, behind the camera.
        radiance: radiance of the texel, a scalar or RGB.
        resolution: texels along the edge of a face, a power of two.
    """

    face: Annotated[int, Field(ge=0, le=5)] = 4
    row: Annotated[int, Field(ge=0)] | None = None
    column: Annotated[int, Field(ge=0)] | None = None
    radiance: Radiance = (1000.0, 1000.0, 1000.0)
    resolution: Resolution = 64

    def cubemap(self) -> CubeMap:
        """The radiance itself."""
        row, column = (self.resolution // 2 if c is None else c for c in (self.row, self.column))
        if max(row, column) >= self.resolution:
            raise InputError(f"texel.row and texel.column must be below {self.resolution}, got {row} and {column}")
        faces = torch.zeros(6, self.resolution, self.resolution, 3)
        faces[self.face, row, column] = torch.tensor(self.radiance)
        return CubeMap(faces, self.key())


# Colours of the faces +x, -x, +y, -y, +z, -z.
ORIENTATION_COLORS = ((1, 0, 0), (0, 1, 1), (0, 1, 0), (1, 0, 1), (0, 0, 1), (1, 1, 0))


@LIGHTS.register("orientation")
class Orientation(Light):
    """One colour per face: +x red, -x cyan, +y green, -y magenta, +z blue, -z yellow; top left quarters are doubled.

    Attributes:
        resolution: texels along the edge of a face, a power of two.
    """

    resolution: Resolution = 64

    def cubemap(self) -> CubeMap:
        """The radiance itself."""
        r = self.resolution
        faces = torch.tensor(ORIENTATION_COLORS, dtype=torch.float32)[:, None, None, :].repeat(1, r, r, 1)
        faces[:, : r // 2, : r // 2] *= 2
        return CubeMap(faces, self.key())


@LIGHTS.register("spots")
class Spots(Light):
    """Small bright discs on a dim sky: the test map of regular sampling, "tiny bright spots with 2 - 10 degrees".

    Diameters are uniform in [2, 10] degrees, intensities log-uniform in [0.01, 1] times `contrast`, directions uniform,
    colours mild tints; the sky changes from 0.5 (down) to 1.5 (up). Where discs overlap, the maximum counts. Their
    edges are one texel wide.

    Attributes:
        seed: seed of the generator that places the spots.
        n_spots: number of spots.
        contrast: largest intensity; the mean of the sky is 1.
        resolution: texels along the edge of a face, a power of two.

    Source: Luksch et al. 2014 section 8 (sizes, 1 : 3000 and 1024); number, colours and sky are ours.
    """

    seed: Seed = 0
    n_spots: Annotated[int, Field(ge=0, le=1000)] = 24
    contrast: Annotated[float, Field(ge=1, le=1e6)] = 3000.0
    resolution: Resolution = 1024

    def cubemap(self) -> CubeMap:
        """The radiance itself."""
        generator = torch.Generator().manual_seed(self.seed)
        u = torch.rand(self.n_spots, 7, generator=generator, dtype=torch.float64)
        z, phi = 2 * u[:, 0] - 1, 2 * pi * u[:, 1]
        centres = torch.stack([torch.sqrt(1 - z * z) * phi.cos(), torch.sqrt(1 - z * z) * phi.sin(), z], 1).float()
        radii = radians(1) + radians(4) * u[:, 2]
        intensity = self.contrast * 100 ** (u[:, 3] - 1)
        colors = (intensity[:, None] * (0.6 + 0.4 * u[:, 4:7])).float()
        texel = 2 / self.resolution
        faces = []
        for d in stack(texel_directions(self.resolution)):
            radiance = (1 + 0.5 * d[..., 1:2]).repeat(1, 1, 3)
            cosines = d @ centres.T
            for spot, (centre, radius, color) in enumerate(zip(centres, radii.tolist(), colors, strict=True)):
                near = cosines[..., spot] > cos(radius + 2 * texel)
                chord = (d[near] - centre).norm(dim=-1)  # 2 sin(angle / 2) is exact for small angles, acos is not
                coverage = ((radius - 2 * torch.asin(chord / 2)) / texel + 0.5).clamp(0, 1)
                radiance[near] = torch.maximum(radiance[near], coverage[:, None] * color)
            faces.append(radiance)
        return CubeMap(torch.stack(faces), self.key())
