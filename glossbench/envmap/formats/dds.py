"""DirectDraw surfaces (.dds): cube maps of 16- or 32-bit floats."""

import struct
from pathlib import Path

import numpy as np

from glossbench.envmap.formats.image_content import ImageContent
from glossbench.envmap.formats.refusals import check_fits, check_size, make_damage_error
from glossbench.errors import InputError

KIND = "a DDS cube map"
_HEADER = 128  # bytes, including the magic number
_HAS_LEVELS, _CUBE, _ALL_FACES = 0x20000, 0x200, 0xFC00
# (dtype, channels) by the D3DFORMAT in the fourCC and by the DXGI format of the extended header.
_FOURCC = {113: ("<f2", 4), 116: ("<f4", 4)}
_DXGI = {10: ("<f2", 4), 2: ("<f4", 4), 6: ("<f4", 3)}
_KNOWN = (
    "A16B16G16R16F (113), A32B32G32R32F (116), R16G16B16A16_FLOAT (10), R32G32B32A32_FLOAT (2), R32G32B32_FLOAT (6)"
)


def read_dds(path: Path) -> ImageContent:
    """The first MIP level as a vertical strip (6 R, R, 3), float32: the faces +X, -X, +Y, -Y, +Z, -Z, top to bottom.

    The cube is left-handed: +X right, +Y up, +Z forward, each face seen from inside; alpha is dropped.

    Raises:
        InputError: the file does not hold six faces of one size, its pixel format is not known (the error names it), or
            it has fewer bytes than its header claims.

    Source: Microsoft, "Programming Guide for DDS" and DDS_HEADER_DXT10.
    """
    n_bytes = path.stat().st_size
    with path.open("rb") as file:
        data = file.read(_HEADER + 20)
    if len(data) < _HEADER:
        raise make_damage_error(path, KIND, f"{len(data)} of {_HEADER} bytes of the header are there")
    size, flags, height, width, _, _, n_levels = struct.unpack_from("<7I", data, 4)
    format_size, format_flags, fourcc = struct.unpack_from("<2I4s", data, 76)
    caps2 = struct.unpack_from("<I", data, 112)[0]
    if (size, format_size) != (124, 32):
        raise make_damage_error(path, KIND, f"its header sizes must be 124 and 32, but are {size} and {format_size}")
    start, name = _HEADER, f"fourCC {int.from_bytes(fourcc, 'little')}"
    dtype, channels = _FOURCC.get(int.from_bytes(fourcc, "little"), ("", 0))
    is_cube = bool(caps2 & _CUBE) and caps2 & _ALL_FACES == _ALL_FACES
    if not format_flags & 4:
        dtype, name = "", "without a fourCC"
    elif fourcc == b"DX10":
        if len(data) < _HEADER + 20:
            raise make_damage_error(path, KIND, "its extended header is cut short")
        dxgi, dimension, misc, n_cubes, _ = struct.unpack_from("<5I", data, _HEADER)
        start, name = _HEADER + 20, f"DXGI format {dxgi}"
        dtype, channels = _DXGI.get(dxgi, ("", 0))
        is_cube = dimension == 3 and bool(misc & 4) and n_cubes == 1
    elif fourcc.isalnum():
        name = f"fourCC {fourcc.decode('ascii', 'replace')}"
    if not is_cube:
        raise InputError(f"{path}: must be one cube map with all six faces, but is another texture")
    if not dtype:
        raise InputError(f"{path}: its pixel format is {name}; known: {_KNOWN}")
    check_size(path, KIND, width, 6 * height)
    if width != height:
        raise make_damage_error(path, KIND, f"its faces must be square, but are {width}x{height}")
    n_levels = n_levels if flags & _HAS_LEVELS else 1
    if n_levels > width.bit_length():
        raise make_damage_error(path, KIND, f"{n_levels} MIP levels of {width}x{width} pixels")
    pixel = np.dtype(dtype).itemsize * channels
    face = pixel * sum(max(width >> level, 1) ** 2 for level in range(max(n_levels, 1)))
    if n_bytes - start < 6 * face:
        raise make_damage_error(path, KIND, f"{n_bytes - start} of {6 * face} bytes of pixels are there")
    check_fits(path, width, 6 * height)
    faces = np.fromfile(path, np.uint8, 6 * face, offset=start).reshape(6, face)[:, : pixel * width * width]
    texels = np.ascontiguousarray(faces).view(dtype).reshape(6 * width, width, channels)
    return ImageContent(texels[..., :3].astype(np.float32))
