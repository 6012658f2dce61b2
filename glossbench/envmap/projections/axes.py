"""Axis conventions of other programs: where their images of the whole sphere have what, in this project's world.

A convention is, for each projection that its program has, the world's directions at three places of the image as
`projections` lays it out: at its right, at its top, and behind it. They are a signed permutation of the axes, which
moves the texels of a cube exactly. A program's own world is brought into this one (+y up, right-handed, forward -z)
so that up stays up and nothing is mirrored; which way is forward follows the table.

    axes        its world, here                      its images
    forward     this project's                       -z in the centre, +x right of it
    opengl      the same                             cube: the face that a texture lookup with the world's direction
                                                     reads, so seen from within each face is mirrored
    directx     (x, y, -z): left-handed              cube: +Z is forward; faces as seen from within
    mitsuba     the same                             lat_long: +z in the centre, -x right of it
    blender     (x, z, -y): its +z is up             lat_long: its +x in the centre, its -y right of it
    pbrt        (x, z, y): left-handed, +z up        lat_long (versions 2 and 3): its -x in the centre, its -y right;
                                                     octahedral_equal_area (version 4): its +z in the centre,
                                                     +x right of it, +y below it
    nvdiffrec   the same                             lat_long: as forward; cube: as opengl

Pictures of the six sides of a room (posx.jpg, negx.jpg, ...; the RenderMan convention) look right as they are: they
are directx. Mitsuba puts the poles at the centres of the first and the last row, here they are at its edges: half a
row apart at the poles, nothing at the horizon.

Source: opengl, OpenGL 4.6 specification table 8.19; directx, Microsoft "Cubic Environment Mapping"; mitsuba,
mitsuba3 src/emitters/envmap.cpp, direction_to_uv; blender, Cycles kernel/camera/projection.h,
direction_to_equirectangular, and its glTF exporter's "+Y up"; pbrt, pbrt-v3 lights/infinite.cpp, pbrt-v4
util/math.cpp EqualAreaSquareToSphere and imgtool makeequiarea; nvdiffrec, render/util.py latlong_to_cubemap.
"""

from typing import Literal, get_args

import torch
from torch import Tensor

from glossbench.directions import stack, vec3
from glossbench.envmap.cubemap import face_coordinates, texel_rows
from glossbench.errors import InputError, nearest

Axes = Literal["forward", "opengl", "directx", "mitsuba", "blender", "pbrt", "nvdiffrec"]


def _of_cubes(directions: str) -> dict[str, str]:
    return dict.fromkeys(("vertical_cross", "horizontal_cross", "strip"), directions)


# By projection: the world's directions to the right of the image, above it and behind it.
_CONVENTIONS: dict[str, dict[str, str]] = {
    "opengl": _of_cubes("+x +y -z"),
    "directx": _of_cubes("+x +y +z"),
    "mitsuba": {"lat_long": "-x +y -z"},
    "blender": {"lat_long": "+z +y -x"},
    "pbrt": {"lat_long": "-z +y +x", "octahedral_equal_area": "+x -z -y"},
    "nvdiffrec": {"lat_long": "+x +y +z", **_of_cubes("+x +y -z")},
}


def permutation(axes: str, projection: str) -> Tensor:
    """(3, 3) of -1, 0 and 1: world direction -> (right, up, backward) in the image.

    Raises:
        InputError: no such convention, or it has no such projection.
    """
    if axes == "forward":
        return torch.eye(3)
    if axes not in _CONVENTIONS:
        raise InputError(f"unknown axes {axes!r}{nearest(axes, get_args(Axes))}")
    known = _CONVENTIONS[axes]
    if projection not in known:
        raise InputError(f"axes {axes!r} say nothing of the projection {projection}, only of {', '.join(known)}")
    unit = {
        f"{sign}{name}": s * row
        for sign, s in (("+", 1), ("-", -1))
        for name, row in zip("xyz", torch.eye(3), strict=True)
    }
    return torch.stack([unit[direction] for direction in known[projection].split()])


def turned(faces: Tensor, matrix: Tensor) -> Tensor:
    """Faces (6, R, R, C) whose texel in direction d is the given one in direction matrix d; texels are moved whole."""
    if torch.equal(matrix, torch.eye(3)):
        return faces
    r = faces.shape[1]
    out = torch.empty_like(faces)
    for rows, texels in texel_rows(r):
        face, s, t, _ = face_coordinates(vec3(stack(texels) @ matrix.T))
        column, row = (((c + 1) * (r / 2)).long().clamp(0, r - 1) for c in (s, t))
        out[:, rows] = faces[face.long(), row, column]
    return out
