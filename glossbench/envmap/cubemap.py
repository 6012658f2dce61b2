"""Cube maps: the only module that converts directions to texels and texels to directions.

Faces are images seen by a camera at the origin, in the order +x, -x, +y, -y, +z, -z. The world is right-handed with
+y up and forward -z (face 5), so no face of a vertical cross is mirrored. Row 0 is the top.

    face   normal   to the right (s)   down (t)
    0 +x    +x           +z               -y
    1 -x    -x           -z               -y
    2 +y    +y           +x               -z
    3 -y    -y           +x               +z
    4 +z    +z           -x               -y
    5 -z    -z           +x               -y

Texel centres lie at half-integers: column i of R columns has s = (2 i + 1) / R - 1 in [-1, 1].
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from math import isfinite, pi
from typing import Self
from uuid import uuid4

import numpy as np
import torch
from jaxtyping import Float, Float64, Int
from numpy.typing import NDArray
from torch import Tensor

from glossbench.directions import Vec3, normalize, stack
from glossbench.errors import InputError
from glossbench.shapes import Directions, Irradiance, PointDirections, Values

_TEXELS = 2**20  # at a time
_NORMALS = torch.tensor([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]).float()
_RIGHT = torch.tensor([[0, 0, 1], [0, 0, -1], [1, 0, 0], [1, 0, 0], [-1, 0, 0], [1, 0, 0]]).float()
_DOWN = torch.tensor([[0, -1, 0], [0, -1, 0], [0, 0, -1], [0, 0, 1], [0, -1, 0], [0, -1, 0]]).float()


@dataclass(frozen=True)
class CubeMap:
    """Incoming radiance as a cube of texels: the light that shades every surface.

    Between texel centres the radiance is interpolated bilinearly, across edges too. The reference integrates this
    interpolated light, and every method approximates it.

    Attributes:
        faces: radiance (6, R, R, 3), float32, finite, not negative, linear Rec. 709; R a power of two.
        key: text that identifies the light: a hash of its file, or the options that made it; unique by default.
    """

    faces: Tensor  # not the type Faces: users can pass a wrong shape, which is refused below
    key: str = field(default_factory=lambda: f"unnamed {uuid4().hex}")

    def __post_init__(self) -> None:
        shape = tuple(self.faces.shape)
        r = shape[1] if len(shape) == 4 else 0
        if shape != (6, r, r, 3) or r < 2 or r & (r - 1):
            raise InputError(f"a cube map needs faces (6, R, R, 3) with R a power of two of at least 2, got {shape}")
        lowest, highest = (bound.item() for bound in self.faces.aminmax())  # one pass; both are NaN if a texel is
        if not isfinite(lowest) or not isfinite(highest):
            raise InputError("a cube map must be finite everywhere, got NaN or infinity")
        if lowest < 0:
            raise InputError(f"a cube map must not be negative, got a minimum of {lowest:g}")

    @property
    def resolution(self) -> int:
        """Texels along the edge of a face."""
        return self.faces.shape[1]

    def to(self, device: str) -> Self:
        """The same light on another device."""
        return type(self)(self.faces.to(device), self.key)

    def mean(self) -> Float64[Tensor, "3"]:
        """Mean radiance over the sphere."""
        weight = texel_solid_angles(self.resolution).to(self.faces.device)[:, :, None]
        # One face at a time saves memory.
        return torch.stack([(face.double() * weight).sum((0, 1)) for face in self.faces]).sum(0) / (4 * pi)

    def irradiance(self, n: PointDirections) -> Irradiance:
        """E(n) = integral of L cos over the hemisphere about each n, summed over all texels.

        The midpoint rule over texels, each with its exact solid angle.
        """
        solid_angle = texel_solid_angles(self.resolution).to(self.faces.device)
        normals = stack(n).reshape(-1, 3)
        total = normals.new_zeros(len(normals), 3, dtype=torch.float64)
        for rows, texels in texel_rows(self.resolution):
            d = stack(texels).reshape(-1, 3).to(self.faces.device)
            weighted = (self.faces[:, rows].double() * solid_angle[rows, :, None]).reshape(-1, 3)
            # One normal at a time: all texels times all normals may not fit into memory.
            total += torch.stack([(d @ normal).clamp(min=0).double() @ weighted for normal in normals])
        return total


def texel_directions(resolution: int, samples: int = 1) -> Vec3:
    """Unit directions through the texel centres, components of shape (6, R, R).

    With samples = k: directions through the k x k sub-texel centres, components of shape (6, k R, k R).
    """
    n = resolution * samples
    s = (torch.arange(n, dtype=torch.float64) * 2 + 1) / n - 1
    return face_directions(s[None, :].expand(n, n), s[:, None].expand(n, n))


def texel_rows(resolution: int) -> Iterator[tuple[slice, Vec3]]:
    """Blocks of rows of all six faces, each with its directions (6, rows, R); the size of a block bounds the memory."""
    s = (torch.arange(resolution, dtype=torch.float64) * 2 + 1) / resolution - 1
    step = max(1, _TEXELS // (6 * resolution))
    for row in range(0, resolution, step):
        t = s[row : row + step]
        shape = (len(t), resolution)
        yield slice(row, row + len(t)), face_directions(s[None, :].expand(shape), t[:, None].expand(shape))


def face_directions(s: Tensor, t: Tensor) -> Vec3:
    """Unit directions (6, ...) float32 at face coordinates s (right), t (down) in [-1, 1] on each of the six faces."""
    shape = (6, *([1] * s.dim()))
    tables = (table.to(s.device).double().T for table in (_NORMALS, _RIGHT, _DOWN))
    axes = zip(*tables, strict=True)
    v = normalize(Vec3(*(n.view(shape) + r.view(shape) * s + d.view(shape) * t for n, r, d in axes)))
    return Vec3(v.x.float(), v.y.float(), v.z.float())


def face_axes(device: str) -> Float[Tensor, "6 3 3"]:
    """The directions of each face: its normal, to the right, down."""
    return torch.stack([_NORMALS, _RIGHT, _DOWN], 1).to(device)


def face_coordinates(d: Directions) -> tuple[Int[Tensor, "*#pairs"], Values, Values, Values]:
    """The point where a direction hits the cube [-1, 1]^3: (face int32, s, t in [-1, 1], major).

    major = max(|x|, |y|, |z|); for a unit direction the cube is hit at distance 1 / major.
    """
    ax, ay, az = d.x.abs(), d.y.abs(), d.z.abs()
    major = torch.maximum(torch.maximum(ax, ay), az)
    on_x = ax == major
    on_y = (ay == major) & ~on_x
    negative = torch.where(on_x, d.x, torch.where(on_y, d.y, d.z)) < 0
    face = (torch.where(on_x, 0, torch.where(on_y, 2, 4)) + negative).int()
    # s is z on the x faces and -x on the z faces, times the sign of the face, and x on the y faces; t is -y, on the y
    # faces -z times the sign of the face.
    side = torch.where(on_x, d.z, -d.x)
    s = torch.where(on_y, d.x, torch.where(negative, -side, side))
    t = torch.where(on_y, torch.where(negative, d.z, -d.z), -d.y)
    inverse = 1 / major
    return face, s * inverse, t * inverse, major


def texel_solid_angles(resolution: int) -> Float64[Tensor, "{resolution} {resolution}"]:
    """Exact solid angle of each texel of a face, in sr; six faces sum to 4 pi.

    A rectangle from the face's centre to the corner (s, t) subtends atan2(s t, sqrt(s^2 + t^2 + 1)); a texel is the
    alternating sum over its four corners.
    """
    edge = torch.linspace(-1, 1, resolution + 1, dtype=torch.float64)
    s, t = edge[None, :], edge[:, None]
    corner = torch.atan2(s * t, torch.sqrt(s * s + t * t + 1))
    return corner[1:, 1:] - corner[1:, :-1] - corner[:-1, 1:] + corner[:-1, :-1]


def add_border(faces: Tensor, width: int = 1, out: Tensor | None = None) -> Tensor:
    """Faces (6, R, R, C) with a border of `width` texels from the adjoining faces: (6, R + 2w, R + 2w, C).

    Border row k beyond an edge is row k inside the adjoining face. Beyond a corner of the cube there is no texel: the
    border holds the mean of the three texels that meet at this corner.

    Args:
        out: where to write the result; by default, new memory.
    """
    r = faces.shape[1]
    out = faces.new_empty(6, r + 2 * width, r + 2 * width, faces.shape[3]) if out is None else out
    inner = slice(width, r + width)
    out[:, inner, inner] = faces
    index = torch.from_numpy(_edge_texels(r, width)).to(faces.device)
    edges = faces.reshape(6 * r * r, -1)[index.reshape(-1)].reshape(6, 4, width, r, -1)
    out[:, :width, inner] = edges[:, 0].flip(1)
    out[:, r + width :, inner] = edges[:, 1]
    out[:, inner, :width] = edges[:, 2].flip(1).transpose(1, 2)
    out[:, inner, r + width :] = edges[:, 3].transpose(1, 2)
    # (border, last texel inside, first texel beyond) at the two ends of an axis.
    ends = ((slice(0, width), width, width - 1), (slice(r + width, None), r + width - 1, r + width))
    for rows, row, beyond_row in ends:
        for columns, column, beyond_column in ends:
            mean = (out[:, row, column] + out[:, beyond_row, column] + out[:, row, beyond_column]) / 3
            out[:, rows, columns] = mean[:, None, None]
    return out


@cache
def _edge_texels(resolution: int, width: int) -> NDArray[np.int64]:
    """Flat texel index (6, 4, width, R) of the neighbours at depth k beyond the top, bottom, left and right edge."""
    along = (torch.arange(resolution, dtype=torch.float64) * 2 + 1) / resolution - 1
    # A point e beyond the edge of a face folds down onto the adjoining face, at depth e below that edge.
    depth = (torch.arange(width, dtype=torch.float64) * 2 + 1)[:, None] / resolution
    along, depth = along.expand(width, resolution), depth.expand(width, resolution)
    one = torch.ones_like(along)
    shape = (6, 1, 1, 1)
    s = torch.stack([along, along, -one, one])
    t = torch.stack([-one, one, along, along])
    folded = 1 - depth
    point = [n.view(shape) * folded + r.view(shape) * s + d.view(shape) * t
             for n, r, d in zip(_NORMALS.T, _RIGHT.T, _DOWN.T, strict=True)]  # fmt: skip
    face, fs, ft, _ = face_coordinates(Vec3(*(c.double() for c in point)))
    column = ((fs + 1) * resolution / 2).floor().clamp(0, resolution - 1).long()
    row = ((ft + 1) * resolution / 2).floor().clamp(0, resolution - 1).long()
    index: NDArray[np.int64] = ((face * resolution + row) * resolution + column).numpy()
    return index
