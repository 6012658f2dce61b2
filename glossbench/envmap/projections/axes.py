"""Axis conventions of other programs: the directions, in this project's world, that their images show.

A convention states, for each projection of its program, three directions of the world: to the right of the image, above
it and behind it, in the layout of the module conversion. They are a signed permutation of the axes, which moves texels
of a cube exactly. A program's own world is mapped to this one (+y up, right-handed, forward -z) so that up stays up and
nothing is mirrored; the table states which direction becomes forward.

    axes        its world, here                      its images
    forward     this project's                       -z in the centre, +x right of it
    opengl      the same                             cube: the face that a texture lookup with the world's direction
                                                     reads; seen from inside, each face is mirrored
    directx     (x, y, -z): left-handed              cube: +Z is forward; faces are seen from inside
    mitsuba     the same                             lat_long: +z in the centre, -x right of it
    blender     (x, z, -y): its +z is up             lat_long: its +x in the centre, its -y right of it
    pbrt        (x, z, y): left-handed, +z up        lat_long (versions 2 and 3): its -x in the centre, its -y right;
                                                     octahedral_equal_area (version 4): its +z in the centre,
                                                     +x right of it, +y below it
    nvdiffrec   the same                             lat_long: as forward; cube: as opengl

Pictures of the six sides of a room (posx.jpg, negx.jpg, ...; the RenderMan convention), which look right to a viewer in
the room, are directx. Mitsuba has the poles at the centres of the first and the last row; here they are at the edges.
The difference is half a row at the poles and nothing at the horizon.

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
from glossbench.errors import InputError, suggest_nearest

Axes = Literal["forward", "opengl", "directx", "mitsuba", "blender", "pbrt", "nvdiffrec"]


def _repeat_for_cubes(directions: str) -> dict[str, str]:
    return dict.fromkeys(("vertical_cross", "horizontal_cross", "strip"), directions)


# The world's directions to the right of the image, above it and behind it, by projection.
_CONVENTIONS: dict[str, dict[str, str]] = {
    "opengl": _repeat_for_cubes("+x +y -z"),
    "directx": _repeat_for_cubes("+x +y +z"),
    "mitsuba": {"lat_long": "-x +y -z"},
    "blender": {"lat_long": "+z +y -x"},
    "pbrt": {"lat_long": "-z +y +x", "octahedral_equal_area": "+x -z -y"},
    "nvdiffrec": {"lat_long": "+x +y +z", **_repeat_for_cubes("+x +y -z")},
}


def permutation(axes: str, projection: str) -> Tensor:
    """Matrix (3, 3) of -1, 0 and 1 that maps a direction of the world to (right, up, backward) in the image.

    Raises:
        InputError: the convention is unknown, or does not have this projection.
    """
    if axes == "forward":
        return torch.eye(3)
    if axes not in _CONVENTIONS:
        raise InputError(f"unknown axes {axes!r}{suggest_nearest(axes, get_args(Axes))}")
    known = _CONVENTIONS[axes]
    if projection not in known:
        raise InputError(f"axes {axes!r} do not apply to the projection {projection}, only to {', '.join(known)}")
    unit = {
        f"{sign}{name}": s * row
        for sign, s in (("+", 1), ("-", -1))
        for name, row in zip("xyz", torch.eye(3), strict=True)
    }
    return torch.stack([unit[direction] for direction in known[projection].split()])


def turn_faces(faces: Tensor, matrix: Tensor) -> Tensor:
    """Faces (6, R, R, C) whose texel in direction d is the given texel in direction matrix d, without interpolation."""
    if torch.equal(matrix, torch.eye(3)):
        return faces
    r = faces.shape[1]
    out = torch.empty_like(faces)
    for rows, texels in texel_rows(r):
        face, s, t, _ = face_coordinates(vec3(stack(texels) @ matrix.T))
        column, row = (((c + 1) * (r / 2)).long().clamp(0, r - 1) for c in (s, t))
        out[:, rows] = faces[face.long(), row, column]
    return out
