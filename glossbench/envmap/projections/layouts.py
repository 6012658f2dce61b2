"""Layouts: maps of all directions to one image, except those that consist of the faces of a cube.

Each is a map from the unit square (u to the right, v down) to directions, and its inverse. An image is seen by a camera
at the origin: forward (-z) in its centre, +x right of it and +y above it.
"""

from collections.abc import Callable
from math import pi
from typing import NamedTuple

import torch
from torch import Tensor

from glossbench.directions import Vec3


class Layout(NamedTuple):
    """One projection.

    Attributes:
        columns, rows: pixels of the image per texel along the edge of an equally fine cube map.
        direction: (u, v) -> unit direction and solid angle per unit of area [sr], 0 where no direction is shown.
        place: unit direction -> (u, v).
        margin: image -> image with a border of one pixel, in which pixels that show no direction are filled, so that it
            can be interpolated everywhere.
    """

    columns: int
    rows: int
    direction: Callable[[Tensor, Tensor], tuple[Vec3, Tensor]]
    place: Callable[[Vec3], tuple[Tensor, Tensor]]
    margin: Callable[[Tensor], Tensor]


def solid_angles(layout: Layout, height: int, width: int) -> Tensor:
    """Solid angle of the pixels (H, W), up to a factor, by the density at their centres, float64."""
    u, v = ((torch.arange(n, dtype=torch.float64) + 0.5) / n for n in (width, height))
    return layout.direction(*torch.broadcast_tensors(u[None, :], v[:, None]))[1]


def _repeat_edges(image: Tensor) -> Tensor:
    rows = torch.cat([image[:1], image, image[-1:]])
    return torch.cat([rows[:, :1], rows, rows[:, -1:]], dim=1)


# Latitude and longitude: columns are longitude, from backward to backward; rows are the angle from +y.


def _lat_long_direction(u: Tensor, v: Tensor) -> tuple[Vec3, Tensor]:
    theta, phi = v * pi, (2 * u - 1) * pi
    sin = torch.sin(theta)
    return Vec3(sin * torch.sin(phi), torch.cos(theta), -sin * torch.cos(phi)), 2 * pi * pi * sin


def _lat_long_place(d: Vec3) -> tuple[Tensor, Tensor]:
    # atan2 for both angles: acos(y) loses half of its digits near the poles.
    theta = torch.atan2(torch.hypot(d.x, d.z), d.y)
    return torch.atan2(d.x, -d.z) / (2 * pi) + 0.5, theta / pi


def _lat_long_margin(image: Tensor) -> Tensor:
    """Columns wrap around; beyond a pole lies the row of the opposite longitude.

    Bilinear rows weight a pixel by its solid angle, but a pixel at a pole by 1/12 too much.
    """
    height, width = image.shape[:2]
    out = image.new_empty(height + 2, width + 2, 3)
    inner = out[1:-1, 1:-1]
    inner.copy_(image)
    widen_near_poles(inner)
    out[0, 1:-1], out[-1, 1:-1] = inner[0].roll(width // 2, 0), inner[-1].roll(width // 2, 0)
    out[:, 0], out[:, -1] = out[:, -2].clone(), out[:, 1].clone()
    return out


def widen_near_poles(image: Tensor) -> None:
    """Makes each pixel a tent along its row with half width 1 / sin(theta) (at 2 : 1), the height of bilinear rows.

    Without it, a lamp of one pixel near a pole lies between the directions at which the image is sampled, or on one of
    them, where it counts too much. The mean of a row, and so its energy, does not change.
    """
    height, width = image.shape[:2]
    sin = torch.sin((torch.arange(height, dtype=torch.float64) + 0.5) / height * pi)
    half_widths = ((width / (2 * height) / sin - 1) / 2).round().clamp(min=0).long()
    column = torch.arange(width)[None, :] + width
    for near in half_widths.nonzero()[:, 0].split(64):  # 64 rows at a time, to bound the memory
        half = half_widths[near, None]
        row = torch.arange(len(near))[:, None]
        wide = image[near].double()
        for _ in range(2):  # a box twice is a tent
            total = torch.cat([wide] * 3, dim=1).cumsum(1)
            wide = (total[row, column + half] - total[row, column - half - 1]) / (2 * half + 1)[:, :, None]
        # Differences of sums have rounding errors, which must not make black negative.
        image[near] = wide.clamp(min=0).float()


# The angular map of a light probe: radius = angle from forward / pi.


def _angular_direction(u: Tensor, v: Tensor) -> tuple[Vec3, Tensor]:
    x, y = 2 * u - 1, 1 - 2 * v
    r = torch.hypot(x, y)
    sin_over_r = pi * torch.sinc(r)
    density = torch.where(r < 1, 4 * pi * sin_over_r, 0.0)
    return Vec3(sin_over_r * x, sin_over_r * y, -torch.cos(pi * r)), density


def _angular_place(d: Vec3) -> tuple[Tensor, Tensor]:
    sin = torch.hypot(d.x, d.y)
    radius = torch.atan2(sin, -d.z) / pi / sin.clamp(min=1e-30)
    return (1 + d.x * radius) / 2, (1 - d.y * radius) / 2


def _angular_margin(image: Tensor) -> Tensor:
    """The disc, continued beyond its rim, which is a single direction: backward."""
    size = image.shape[0]
    centre = (torch.arange(size, dtype=torch.float64) * 2 + 1) / size - 1
    x, y = centre[None, :], centre[:, None]
    r = torch.hypot(x, y)
    # Radius 1 + e continues on the far side of backward, at radius 1 - e: black pixels do not darken the rim.
    # The radius read is at least half a pixel's diagonal below the rim; otherwise the pixel could itself be outside.
    mirrored = torch.where(r > 1, -(2 - r).clamp(max=1 - 1.5 / size) / r, 1.0)
    column, row = (((c * mirrored + 1) * size / 2).long().clamp(0, size - 1) for c in (x, y))
    return _repeat_edges(image[row, column])


# Two paraboloids of scale 1, left and right: a disc that touches its square for the front half of the sphere, and one
# for the back half, seen by a camera that has turned around; they touch in the direction +x.


def _paraboloid_direction(u: Tensor, v: Tensor) -> tuple[Vec3, Tensor]:
    behind = u >= 0.5
    x, y = 4 * u - torch.where(behind, 3.0, 1.0), 1 - 2 * v
    p2 = x * x + y * y
    side = torch.where(behind, -1.0, 1.0)
    scale = 2 / (1 + p2)
    # dx dy = 8 du dv; a paraboloid's solid angle is 4 / (1 + p^2)^2 dx dy.
    return Vec3(side * x * scale, y * scale, -side * (scale - 1)), torch.where(p2 < 1, 8 * scale * scale, 0.0)


def _paraboloid_place(d: Vec3) -> tuple[Tensor, Tensor]:
    inverse = 1 / (1 + d.z.abs())
    x = d.x * inverse
    return torch.where(d.z > 0, 3 - x, 1 + x) / 4, (1 - d.y * inverse) / 2


def _paraboloid_margin(image: Tensor) -> Tensor:
    """Beyond its rim each disc continues with the other disc."""
    size = image.shape[0]
    centre = (torch.arange(size, dtype=torch.float64) * 2 + 1) / size - 1
    x, y = centre[None, :], centre[:, None]
    r = torch.hypot(x, y)
    # Radius r continues at radius 1 / r of the other disc, mirrored, and below its rim as in the angular map.
    beyond = (1 / r).clamp(max=1 - 1.5 / size) / r
    column, row = (((c * beyond + 1) * size / 2).long().clamp(0, size - 1) for c in (-x, y))
    front, behind = image[:, :size], image[:, size:]
    outside = (r > 1)[:, :, None]
    filled = [torch.where(outside, b[row, column], a) for a, b in ((front, behind), (behind, front))]
    return _repeat_edges(torch.cat(filled, dim=1))


# Octahedra unfolded into a square: forward in the centre, backward in all four corners.


def _octahedral_direction(u: Tensor, v: Tensor) -> tuple[Vec3, Tensor]:
    x, y = 2 * u - 1, 1 - 2 * v
    front = 1 - x.abs() - y.abs()
    x, y = _fold(x, y, front < 0)
    norm = torch.sqrt(x * x + y * y + front * front)
    return Vec3(x / norm, y / norm, -front / norm), 4 / norm**3


def _octahedral_place(d: Vec3) -> tuple[Tensor, Tensor]:
    norm = d.x.abs() + d.y.abs() + d.z.abs()
    x, y = _fold(d.x / norm, d.y / norm, d.z > 0)
    return (1 + x) / 2, (1 - y) / 2


def _equal_area_direction(u: Tensor, v: Tensor) -> tuple[Vec3, Tensor]:
    x, y = 2 * u - 1, 1 - 2 * v
    front = 1 - x.abs() - y.abs()
    r = 1 - front.abs()
    phi = torch.where(r > 0, (y.abs() - x.abs()) / r.clamp(min=1e-30) + 1, 1.0) * (pi / 4)
    sin = r * torch.sqrt((2 - r * r).clamp(min=0))
    z = torch.copysign(r * r - 1, -front)
    return Vec3(torch.copysign(sin * phi.cos(), x), torch.copysign(sin * phi.sin(), y), z), torch.full_like(r, 4 * pi)


def _equal_area_place(d: Vec3) -> tuple[Tensor, Tensor]:
    sin2 = d.x * d.x + d.y * d.y
    # 1 - |z| in a form that does not lose digits if |z| is near 1.
    r = torch.sqrt(sin2 / (1 + d.z.abs()))
    along_y = r * torch.atan2(d.y.abs(), d.x.abs()) * (2 / pi)
    x, y = torch.copysign(r - along_y, d.x), torch.copysign(along_y, d.y)
    x, y = _fold(x, y, d.z > 0)
    return (1 + x) / 2, (1 - y) / 2


def _fold(x: Tensor, y: Tensor, fold: Tensor) -> tuple[Tensor, Tensor]:
    """Folds the triangle of each quadrant over the diagonal |x| + |y| = 1; the map is its own inverse."""
    over_x, over_y = torch.copysign(1 - y.abs(), x), torch.copysign(1 - x.abs(), y)
    return torch.where(fold, over_x, x), torch.where(fold, over_y, y)


def _octahedral_margin(image: Tensor) -> Tensor:
    """The pixels beyond an edge are those of the same edge in reverse order."""
    rows = torch.cat([image[:1].flip(1), image, image[-1:].flip(1)])
    return torch.cat([rows[:, :1].flip(0), rows, rows[:, -1:].flip(0)], dim=1)


LAYOUTS = {
    "lat_long": Layout(4, 2, _lat_long_direction, _lat_long_place, _lat_long_margin),
    "angular": Layout(4, 4, _angular_direction, _angular_place, _angular_margin),
    "dual_paraboloid": Layout(4, 2, _paraboloid_direction, _paraboloid_place, _paraboloid_margin),
    "octahedral": Layout(2, 2, _octahedral_direction, _octahedral_place, _octahedral_margin),
    "octahedral_equal_area": Layout(2, 2, _equal_area_direction, _equal_area_place, _octahedral_margin),
}
