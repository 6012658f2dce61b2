"""Tensor files: several named arrays in one file, the format of the RGL material database."""

import struct
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glossbench.errors import InputError

MAGIC = b"tensor_file\0"
TYPES = {1: "u1", 2: "i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4", 7: "<u8", 8: "<i8", 9: "<f2", 10: "<f4", 11: "<f8"}


def read_tensors(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of a tensor file of version 1.0, by name.

    The file begins with 12 bytes "tensor_file" and zero, two bytes of the version and the uint32 number of arrays. Each
    array has: uint16 length of the name, the name, uint16 number of axes, uint8 type, uint64 offset in the file, uint64
    length of each axis. All numbers are little-endian.

    Raises:
        InputError: the file is not a tensor file, has another version, or ends before its arrays do.

    Source: the loader of Dupuy and Jakob 2018, github.com/rgl-epfl/brdf-loader.
    """
    data = path.read_bytes()
    if data[:12] != MAGIC:
        raise InputError(f"{path}: not a tensor file: it begins with {data[:12]!r}, must with {MAGIC!r}")
    try:
        major, minor, n_fields = struct.unpack_from("<BBI", data, 12)
        if (major, minor) != (1, 0):
            raise InputError(f"{path}: tensor file of version {major}.{minor}, must be 1.0")
        at, arrays = 18, {}
        for _ in range(n_fields):
            (length,) = struct.unpack_from("<H", data, at)
            name = data[at + 2 : at + 2 + length].decode("utf-8")
            n_axes, kind, offset = struct.unpack_from("<HBQ", data, at + 2 + length)
            shape = struct.unpack_from(f"<{n_axes}Q", data, at + 13 + length)
            at += 13 + length + 8 * n_axes
            if kind not in TYPES:
                raise InputError(f"{path}: tensor file: {name!r} is of type {kind}, must be 1 to {max(TYPES)}")
            size = prod(shape) * np.dtype(TYPES[kind]).itemsize
            if offset + size > len(data):
                raise InputError(
                    f"{path}: tensor file truncated: {name!r} ends at {offset + size} of {len(data)} bytes"
                )
            arrays[name] = np.frombuffer(data, TYPES[kind], prod(shape), offset).reshape(shape)
    except (struct.error, UnicodeDecodeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: tensor file truncated or damaged: its list of arrays cannot be read") from None
    return arrays
