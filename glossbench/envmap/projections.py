"""Projections: an image of the whole sphere, as light files hold it, to a cube map, and back to a picture.

Every image is as a camera at the origin sees it: forward (-z) in the centre, +x right of it, +y above it.

    projection        width : height   pixel -> direction
    lat_long          2 : 1            columns are longitude, backward to backward; rows the angle from +y
    angular           1 : 1            a light probe: radius = angle from forward / pi; no light outside
    vertical_cross    3 : 4            . +y . / -x -z +x / . -y . / . +z .   with +z rotated by 180 degrees
    horizontal_cross  4 : 3            . +y . . / -x -z +x +z / . -y . .
"""

from collections.abc import Callable
from math import log2, pi
from typing import Literal, get_args

import torch
from torch import Tensor
from torch.nn.functional import grid_sample

from glossbench.directions import Vec3
from glossbench.envmap.cubemap import CubeMap, bordered, face_coordinates, face_directions, texel_solid_angles
from glossbench.errors import InputError, nearest

Projection = Literal["lat_long", "angular", "vertical_cross", "horizontal_cross"]

_ASPECT = {"lat_long": (2, 1), "angular": (1, 1), "vertical_cross": (3, 4), "horizontal_cross": (4, 3)}
# (row, column) of the faces +x, -x, +y, -y, +z, -z, in units of a face.
_PLACES = {
    "vertical_cross": ((1, 2), (1, 0), (0, 1), (2, 1), (3, 1), (1, 1)),
    "horizontal_cross": ((1, 2), (1, 0), (0, 1), (2, 1), (1, 3), (1, 1)),
}

# A source (H, W, 3) and the place of a direction in it: (column, row) in pixels, centres at half-integers.
Locate = Callable[[Vec3], tuple[Tensor, Tensor]]


def guess_projection(height: int, width: int) -> Projection:
    """The projection whose shape is height x width; InputError if there is none."""
    for projection in get_args(Projection):
        if _fits(projection, height, width):
            return projection
    shapes = ", ".join(f"{w}:{h} {name}" for name, (w, h) in _ASPECT.items())
    raise InputError(f"no known projection is {width} x {height} (width x height); known: {shapes}")


def to_cubemap(
    image: Tensor,
    projection: Projection | None = None,
    resolution: int | None = None,
    flip_vertical: bool = False,
    key: str = "",
) -> CubeMap:
    """The cube map of an image (H, W, 3) of the whole sphere; its energy is kept.

    texel = integral of L dw over the texel / its solid angle, L bilinear between the pixels. Pixels smaller
    than half a texel are first averaged by 2 x 2, weighted by solid angle. A cross whose faces are the asked
    resolution times a power of two is never interpolated: its texels are such averages, or copies. In a
    lat-long image the pixels near a pole, narrower than high, are first averaged along their row.

    Args:
        projection: by default guessed from the shape.
        resolution: R, a power of two of at least 2; by default the one nearest to what the image resolves:
            H / 2 of a lat-long image, H / 4 of an angular map, the size of a face of a cross.
        flip_vertical: for files that begin with the bottom row.
        key: what the light is, kept in the cube map.

    Raises:
        InputError: no known projection, a shape that does not fit it, or a resolution not a power of two.
    """
    if image.dim() != 3 or image.shape[2] != 3:
        raise InputError(f"a light needs an image (H, W, 3), got {tuple(image.shape)}")
    height, width = image.shape[:2]
    projection = projection or guess_projection(height, width)
    if projection not in _ASPECT:
        raise InputError(f"unknown projection {projection!r}{nearest(projection, _ASPECT)}")
    if not _fits(projection, height, width):
        w, h = _ASPECT[projection]
        raise InputError(f"{projection} must have width : height = {w} : {h}, got {width} x {height}")
    resolved = {"lat_long": height / 2, "angular": height / 4}.get(projection, width / _ASPECT[projection][0])
    if resolution is None:
        resolution = max(2, 2 ** round(log2(resolved)))
    if resolution < 2 or resolution & (resolution - 1):
        raise InputError(f"a cube map's resolution must be a power of two of at least 2, got {resolution}")
    image = image.float().flip(0) if flip_vertical else image.float()
    if projection in _PLACES:
        faces = _cut(image, projection)
        exact = resolved % resolution == 0 and (int(resolved) // resolution).bit_count() == 1
        while resolved > (resolution if exact else 2 * resolution) and resolved % 2 == 0:
            faces, resolved = _halved(faces, texel_solid_angles(int(resolved))), resolved / 2
        if exact:
            return CubeMap(faces.contiguous(), key)
        return CubeMap(_resample(*_cube_source(faces), resolved, resolution), key)
    while resolved > 2 * resolution and height % 2 == 0:
        image = _halved(image[None], _pixel_solid_angles(projection, height))[0]
        height, resolved = height // 2, resolved / 2
    source = _lat_long_source(image) if projection == "lat_long" else _angular_source(image)
    return CubeMap(_resample(*source, resolved, resolution), key)


def lat_long(cubemap: CubeMap, height: int) -> Tensor:
    """A picture (H, 2 H, 3) of the whole light: forward (-z) in the centre, +x right of it, +y up."""
    if height < 1:
        raise InputError(f"the height of a picture must be at least 1, got {height}")
    theta = (torch.arange(height, dtype=torch.float64) + 0.5) / height * pi
    phi = ((torch.arange(2 * height, dtype=torch.float64) + 0.5) / height - 1) * pi
    sin, cos = torch.sin(theta)[:, None], torch.cos(theta)[:, None]
    d = Vec3(sin * torch.sin(phi), cos.expand(height, 2 * height), -sin * torch.cos(phi))
    source, locate = _cube_source(cubemap.faces.cpu())
    return _bilinear(source[None], *locate(Vec3(*(c.float()[None] for c in d))))[0].to(cubemap.faces.device)


def _fits(projection: str, height: int, width: int) -> bool:
    w, h = _ASPECT[projection]
    return height > 0 and width * h == height * w and width % w == 0


def _cut(cross: Tensor, projection: str) -> Tensor:
    """Faces (6, F, F, 3) of a cross."""
    size = cross.shape[1] // _ASPECT[projection][0]
    grid = cross.unflatten(0, (-1, size)).unflatten(2, (-1, size))
    faces = torch.stack([grid[row, :, column] for row, column in _PLACES[projection]])
    if projection == "vertical_cross":
        faces[4] = faces[4].flip(0, 1)
    return faces


def _cube_source(faces: Tensor) -> tuple[Tensor, Locate]:
    """Bordered faces, one above the other."""
    size = faces.shape[1]

    def locate(d: Vec3) -> tuple[Tensor, Tensor]:
        face, s, t, _ = face_coordinates(d)
        return (s + 1) * (size / 2) + 1, (t + 1) * (size / 2) + 1 + face * (size + 2)

    return bordered(faces).flatten(0, 1), locate


def _lat_long_source(image: Tensor) -> tuple[Tensor, Locate]:
    """The image with a border: columns wrap round, beyond a pole lies the row of the opposite longitude.

    Bilinear rows weigh a pixel by its solid angle, but those at the poles themselves by 1/12 too much.
    """
    height, width = image.shape[:2]
    image = _widened_near_poles(image)
    over = image.roll(width // 2, 1)
    rows = torch.cat([over[:1], image, over[-1:]])
    source = torch.cat([rows[:, -1:], rows, rows[:, :1]], dim=1)

    def locate(d: Vec3) -> tuple[Tensor, Tensor]:
        # atan2 for both angles: acos(y) loses half of its digits near the poles.
        theta = torch.atan2(torch.hypot(d.x, d.z), d.y)
        phi = torch.atan2(d.x, -d.z)
        return (phi / (2 * pi) + 0.5) * width + 1, theta / pi * height + 1

    return source, locate


def _widened_near_poles(image: Tensor) -> Tensor:
    """Each pixel a tent along its row, of half width 1 / sin(theta): as wide as bilinear rows are high.

    Without it a lamp in one pixel near a pole falls between the directions of _resample, or on one of them
    and counts for many. The mean of a row, and so its energy, stays.
    """
    height, width = image.shape[:2]
    half = ((1 / _pixel_solid_angles("lat_long", height)[:, 0] - 1) / 2).round().long()
    near = half.nonzero()[:, 0]
    half = half[near, None]
    row, column = torch.arange(len(near))[:, None], torch.arange(width)[None, :] + width
    wide = image[near].double()
    for _ in range(2):  # a box twice is a tent
        total = torch.cat([wide] * 3, dim=1).cumsum(1)
        wide = (total[row, column + half] - total[row, column - half - 1]) / (2 * half + 1)[:, :, None]
    # Differences of sums leave a rounding error, which must not turn black into negative.
    return image.index_copy(0, near, wide.clamp(min=0).float())


def _angular_source(image: Tensor) -> tuple[Tensor, Locate]:
    """The image with its disc continued beyond the rim, which is a single direction: backward."""
    size = image.shape[0]
    centre = (torch.arange(size, dtype=torch.float64) * 2 + 1) / size - 1
    x, y = centre[None, :], centre[:, None]
    r = torch.hypot(x, y)
    # Radius 1 + e continues on the far side of backward at radius 1 - e, so nothing dark bleeds into the rim.
    # A pixel's half diagonal short of the rim, or the pixel met could itself be an outer one.
    mirrored = torch.where(r > 1, -(2 - r).clamp(max=1 - 1.5 / size) / r, 1.0)
    column, row = (((c * mirrored + 1) * size / 2).long().clamp(0, size - 1) for c in (x, y))
    source = image[row, column]

    def locate(d: Vec3) -> tuple[Tensor, Tensor]:
        sin = torch.hypot(d.x, d.y)
        radius = torch.atan2(sin, -d.z) / pi / sin.clamp(min=1e-30)
        return (1 + d.x * radius) * (size / 2), (1 - d.y * radius) * (size / 2)

    return source, locate


def _pixel_solid_angles(projection: str, height: int) -> Tensor:
    """Solid angle of the pixels (H, 1) or (H, H), up to a factor, float64."""
    centre = (torch.arange(height, dtype=torch.float64) * 2 + 1) / height - 1
    if projection == "lat_long":
        return torch.cos(centre * (pi / 2))[:, None]
    r = torch.hypot(centre[None, :], centre[:, None])
    return torch.where(r < 1, torch.sinc(r), 0.0)


def _halved(images: Tensor, weight: Tensor) -> Tensor:
    """Means (N, H / 2, W / 2, 3) over 2 x 2 pixels; weight (H, W) or (H, 1)."""
    n, height, width, _ = images.shape
    w = weight.float().expand(height, width)[None, :, :, None]
    blocks = (n, height // 2, 2, width // 2, 2, -1)
    total = (images * w).reshape(blocks).sum((2, 4))
    return total / w.reshape(1, *blocks[1:]).sum((2, 4)).clamp(min=1e-30)


def _resample(source: Tensor, locate: Locate, resolved: float, resolution: int) -> Tensor:
    """Faces (6, R, R, 3): means of the bilinear source over k x k directions a texel, by solid angle."""
    # Directions along a pixel: a lamp of one pixel is then right within 1 % (4 left 2 %).
    k = max(2, round(6 * resolved / resolution))
    n = resolution * k
    s = (torch.arange(n, dtype=torch.float64) * 2 + 1) / n - 1
    faces = torch.empty(6, resolution, resolution, 3)
    step = max(1, 2**20 // (6 * n * k))  # rows of texels at a time, a million directions: bounds the memory
    images = source.expand(6, *source.shape)
    for row in range(0, resolution, step):
        rows = min(step, resolution - row)
        t = s[row * k : (row + rows) * k]
        shape = (len(t), n)
        directions = face_directions(s[None, :].expand(shape), t[:, None].expand(shape))
        radiance = _bilinear(images, *locate(directions))
        weight = ((1 + s[None, :] ** 2 + t[:, None] ** 2) ** -1.5).float()[:, :, None]
        blocks = (rows, k, resolution, k)
        total = (radiance * weight).reshape(6, *blocks, 3).sum((2, 4))
        faces[:, row : row + rows] = total / weight.reshape(blocks).sum((1, 3))[..., None]
    return faces


def _bilinear(images: Tensor, column: Tensor, row: Tensor) -> Tensor:
    """Images (N, H, W, 3) between pixel centres, at places (N, h, w) in pixels: (N, h, w, 3)."""
    height, width = images.shape[1:3]
    grid = torch.stack([column * (2 / width) - 1, row * (2 / height) - 1], dim=-1)
    planes = images.permute(0, 3, 1, 2)
    return grid_sample(planes, grid, padding_mode="border", align_corners=False).permute(0, 2, 3, 1)
