"""Checksums of all bytes that a value holds, to find out whether its memory was written to."""

import dataclasses
import zlib
from collections.abc import Iterator, Mapping
from types import FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np
import torch
from torch import Tensor

# The search does not look inside these: their contents do not belong to the value.
_CLOSED = (str, bytes, int, float, complex, type, FunctionType, MethodType, ModuleType)


def compute_digest(*values: Any) -> int:
    """CRC-32 of the bytes of all tensors and arrays inside some values, in main memory.

    A tensor counts its own writes, but not writes through an array that shares its memory; only the bytes show these.
    Measured: 1.7 GB/s, so 15 ms for a pyramid of 512 x 512 texels per face.
    """
    crc = 0
    for array in find_arrays(values):
        crc = zlib.crc32(array.data, crc)
    return crc


def find_arrays(value: Any) -> Iterator[np.ndarray]:
    """The memory of all tensors and arrays inside a value, each once, as flat arrays of bytes."""
    seen: set[int] = set()
    pending = [value]
    while pending:
        current = pending.pop()
        if current is None or isinstance(current, _CLOSED) or id(current) in seen:
            continue
        seen.add(id(current))
        if isinstance(current, Tensor):
            if current.layout is torch.strided and current.device.type == "cpu":
                storage = current.untyped_storage()
                if storage.data_ptr() not in seen:
                    seen.add(storage.data_ptr())
                    yield torch.empty(0, dtype=torch.uint8).set_(storage).numpy()
        elif isinstance(current, np.ndarray):
            if not current.dtype.hasobject:
                yield np.ascontiguousarray(current).reshape(-1).view(np.uint8)
        elif isinstance(current, Mapping):
            pending += reversed(list(current.values()))
        elif isinstance(current, tuple | list | set | frozenset):
            pending += reversed(list(current))
        elif dataclasses.is_dataclass(current):  # only its fields, not values that it cached from them
            pending += [getattr(current, f.name) for f in reversed(dataclasses.fields(current))]
        elif hasattr(current, "__dict__"):
            pending += reversed(list(vars(current).values()))
