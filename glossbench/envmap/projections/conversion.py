"""Projections: converts images of the whole sphere, the content of light files, to cube maps, and back.

Every image is seen by a camera at the origin: forward (-z) in the centre, +x right of it, +y above it. Files of other
programs differ by a rotation of the axes (see the module axes).

    projection             width : height   pixel -> direction
    lat_long               2 : 1            columns are longitude, backward to backward; rows the angle from +y
    angular                1 : 1            a light probe: radius = angle from forward / pi; no light outside
    vertical_cross         3 : 4            . +y . / -x -z +x / . -y . / . +z .   with +z rotated by 180 degrees
    horizontal_cross       4 : 3            . +y . . / -x -z +x +z / . -y . .
    strip                  6 : 1 or 1 : 6   +x -x +y -y -z +z, each seen from inside: the order of faces in
                                            left-handed programs
    dual_paraboloid        2 : 1            two discs that touch their squares: (x, y) / (1 + |z|) forward, and
                                            (-x, y) / (1 + |z|) backward; no light outside
    octahedral             1 : 1            (x, y) / (|x| + |y| + |z|) forward, in the square's inner diamond;
                                            backward folded over its sides, so that +z is in all four corners
    octahedral_equal_area  1 : 1            the same shape; all pixels have the same solid angle
    openexr_cube           1 : 6            +x -x +y -y +z -z downward, as in OpenEXR's `envmap`: a right-handed
                                            world, the outer samples lie on the edges of each face; read, not written

If two projections have the same shape, the first one is the default.

Source: octahedral, Engelhardt and Dachsbacher 2008, Cigolle et al. 2014; octahedral_equal_area, Clarberg 2008, as in
pbrt-v4; dual_paraboloid, Heidrich and Seidel 1998 with scale 1; angular, Debevec 1998; openexr_cube,
ImfEnvmap.h and ImfEnvmap.cpp.
"""

from math import gcd, log2
from typing import Literal, get_args

import torch
from torch import Tensor

from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.projections.axes import permutation, turn_faces
from glossbench.envmap.projections.layouts import LAYOUTS, solid_angles
from glossbench.envmap.projections.resampling import (
    halve_images,
    make_cube_source,
    make_edge_source,
    make_layout_source,
    resize,
    to_faces,
    to_layout,
)
from glossbench.errors import InputError, suggest_nearest

Written = Literal[
    "lat_long",
    "angular",
    "vertical_cross",
    "horizontal_cross",
    "strip",
    "dual_paraboloid",
    "octahedral",
    "octahedral_equal_area",
]
Projection = Literal[Written, "openexr_cube"]

# (row, column) of the faces +x, -x, +y, -y, +z, -z, in units of a face.
_UNFOLDED = {
    "vertical_cross": ((1, 2), (1, 0), (0, 1), (2, 1), (3, 1), (1, 1)),
    "horizontal_cross": ((1, 2), (1, 0), (0, 1), (2, 1), (1, 3), (1, 1)),
    "strip": ((0, 0), (0, 1), (0, 2), (0, 3), (0, 5), (0, 4)),
}
_NEAR = 0.1  # largest difference of width / height from 2 for which an image is taken as lat_long
# Columns and rows of an image per texel along the edge of a cube map.
_SIZE = {"vertical_cross": (3, 4), "horizontal_cross": (4, 3), "strip": (6, 1), "openexr_cube": (1, 6)} | {
    name: (layout.columns, layout.rows) for name, layout in LAYOUTS.items()
}


def guess_projection(height: int, width: int) -> Projection:
    """The first projection with this shape (lat_long within 5 %); InputError if there is none."""
    for projection in get_args(Projection):
        if fits(projection, height, width):
            return projection
    shapes = ", ".join(f"{_describe_shape(name)} {name}" for name in get_args(Projection)[:5])
    raise InputError(f"no known projection is {width} x {height} (width x height); known: {shapes}")


def note_unusual_shape(projection: str, height: int, width: int) -> tuple[str, ...]:
    """A note if a lat_long image is not twice as wide as high."""
    if projection != "lat_long" or width == 2 * height:
        return ()
    return (f"taken as lat_long, though {width} x {height} pixels are not 2 : 1",)


def to_cubemap(
    image: Tensor,
    projection: Projection | None = None,
    resolution: int | None = None,
    flip_vertical: bool = False,
    key: str = "",
    axes: str = "forward",
) -> CubeMap:
    """Converts an image (H, W, 3) of the whole sphere to a cube map with the same energy.

    texel = integral of L dw over the texel / its solid angle, L bilinear between the pixels. Pixels smaller than half a
    texel are first averaged by 2 x 2 (a little more for odd sizes), weighted by solid angle. If the faces of a cross or
    strip have the wanted resolution times a power of two, they are not interpolated: texels are such averages or
    copies. In a lat_long image pixels near a pole, which are narrower than high, are first averaged along their row.

    Args:
        projection: by default recognised from the shape.
        resolution: R, a power of two of at least 2; by default the one nearest to the image's own resolution: the size
            of a face of a cross or strip, H / 4 for an angular map, H / 2 for the others.
        flip_vertical: whether the file begins with the bottom row.
        key: identifies the light; the cube map keeps it.
        axes: the axis convention of the image (see the module axes).

    Raises:
        InputError: the projection is unknown, the shape does not fit it (lat_long accepts every shape), the axes do not
            have it, or the resolution is not a power of two.
    """
    if image.dim() != 3 or image.shape[2] != 3:
        raise InputError(f"a light needs an image (H, W, 3), got {tuple(image.shape)}")
    height, width = image.shape[:2]
    projection = projection or guess_projection(height, width)
    _check_projection(projection)
    if projection != "lat_long" and not fits(projection, height, width):  # whose angles fill any shape
        raise InputError(
            f"{projection} must have width : height = {_describe_shape(projection)}, got {width} x {height}"
        )
    matrix = permutation(axes, projection)
    columns, rows = _SIZE[projection]
    resolved = max(max(height, width) / max(columns, rows), min(height, width) / min(columns, rows))
    if resolution is None:
        resolution = max(2, 2 ** round(log2(resolved)))
    _check_resolution(resolution)
    image = image.float().flip(0) if flip_vertical else image.float()
    if projection in _UNFOLDED:
        faces = resize(_fold(image, projection), resolution)
    elif projection == "openexr_cube":
        finest = max(resolution, 2 ** round(log2(resolved)))
        faces = resize(to_faces(*make_edge_source(image), resolved, finest), resolution)
    else:
        layout = LAYOUTS[projection]
        while resolved > 2 * resolution:
            image, resolved = halve_images(image[None], solid_angles(layout, *image.shape[:2]))[0], resolved / 2
        faces = to_faces(*make_layout_source(image, layout), resolved, resolution)
    return CubeMap(turn_faces(faces, matrix), key)


def from_cubemap(cubemap: CubeMap, projection: Written, resolution: int | None = None, axes: str = "forward") -> Tensor:
    """Converts a cube map to an image (H, W, 3) of a projection with the same energy: the inverse of `to_cubemap`.

    pixel = integral of L dw over the pixel / its solid angle, L bilinear between the texels. A cross or strip of the
    cube's own resolution holds its texels, a smaller one their averages. Pixels that show no direction are black: the
    empty parts of a cross, the outside of a disc.

    After conversion and back the mean is within 0.05 % for a photographed light, 2.5 % for one bright texel (5 % at the
    rim of an angular map); a cross or strip of the cube's own resolution comes back bit for bit.

    Args:
        resolution: texels along the edge of a cube map as fine as the image, a power of two; by default the cube's.
        axes: the axis convention of the image (see the module axes).

    Raises:
        InputError: as `check_written`, or the resolution is not a power of two.
    """
    check_written(projection, axes)
    matrix = permutation(axes, projection)
    resolution = cubemap.resolution if resolution is None else resolution
    _check_resolution(resolution)
    faces = turn_faces(cubemap.faces.cpu(), matrix.T)
    if projection in _UNFOLDED:
        return _unfold(resize(faces, resolution), projection)
    if faces.shape[1] > 2 * resolution:
        faces = resize(faces, 2 * resolution)
    return to_layout(*make_cube_source(faces), faces.shape[1], LAYOUTS[projection], resolution)


def _describe_shape(projection: str) -> str:
    columns, rows = (n // gcd(*_SIZE[projection]) for n in _SIZE[projection])
    return "6:1 or 1:6" if projection == "strip" else f"{columns}:{rows}"


def fits(projection: str, height: int, width: int) -> bool:
    """Whether an image of this shape can have a projection (lat_long within 5 % of 2 : 1); False if it is unknown."""
    if projection not in _SIZE:
        return False
    if projection == "lat_long":
        return height > 0 and abs(width - 2 * height) <= _NEAR * height
    columns, rows = (n // gcd(*_SIZE[projection]) for n in _SIZE[projection])
    if projection == "strip" and height > width:
        height, width = width, height
    return height > 0 and width * rows == height * columns and width % columns == 0


def _check_projection(projection: str) -> None:
    if projection not in _SIZE:
        raise InputError(f"unknown projection {projection!r}{suggest_nearest(projection, _SIZE)}")


def check_written(projection: str, axes: str) -> None:
    """Raises InputError if a projection is unknown, cannot be written, or is not in the axis convention."""
    _check_projection(projection)
    if projection not in get_args(Written):
        raise InputError(f"{projection} can be read but not written; write one of {', '.join(get_args(Written))}")
    permutation(axes, projection)


def _check_resolution(resolution: int) -> None:
    if resolution < 2 or resolution & (resolution - 1):
        raise InputError(f"a cube map's resolution must be a power of two of at least 2, got {resolution}")


def _fold(image: Tensor, projection: str) -> Tensor:
    """Faces (6, F, F, 3) of a cross or strip."""
    columns, rows = _SIZE[projection]
    if projection == "strip" and image.shape[0] > image.shape[1]:
        image = torch.cat(image.chunk(6), dim=1)
    grid = image.unflatten(0, (rows, -1)).unflatten(2, (columns, -1))
    faces = torch.stack([grid[row, :, column] for row, column in _UNFOLDED[projection]])
    if projection == "vertical_cross":
        faces[4] = faces[4].flip(0, 1)
    return faces


def _unfold(faces: Tensor, projection: str) -> Tensor:
    """The cross or strip of faces (6, F, F, 3)."""
    columns, rows = _SIZE[projection]
    size = faces.shape[1]
    grid = faces.new_zeros(rows, size, columns, size, 3)
    for (row, column), face in zip(_UNFOLDED[projection], faces, strict=True):
        grid[row, :, column] = face.flip(0, 1) if (projection, row) == ("vertical_cross", 3) else face
    return grid.flatten(2, 3).flatten(0, 1)
