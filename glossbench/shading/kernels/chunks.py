"""Running a kernel over all points, in chunks that limit the working set."""

from collections.abc import Callable, Sequence
from math import ceil
from typing import Any, NamedTuple

import torch
from jaxtyping import Shaped
from torch import Tensor

from glossbench.scene.points import ShadingPoints
from glossbench.shading.kernels.backend import ready
from glossbench.shading.kernels.kernel import Kernel

# Point-sample pairs per chunk: a temporary of 512 KiB stays in a core's second-level cache. Measured on two cores,
# eager: 2^14 pairs 5.8, 2^17 pairs 9.5, 2^19 pairs 8.7 million pairs per second.
CHUNK = 1 << 17

OfPoints = Shaped[Tensor, "points columns"]  # one row for each point


class PerPoint(NamedTuple):
    """An argument of a kernel with one row for each point. The kernel gets the rows of its chunk as a tensor."""

    values: OfPoints

    def rows(self, start: int, stop: int) -> OfPoints:
        """Rows [start, stop)."""
        return self.values[start:stop]


def over_points(kernel: Callable[..., OfPoints], points: ShadingPoints, width: int, *arguments: Any) -> OfPoints:
    """kernel(points, *arguments) for all points, chunk by chunk.

    Args:
        kernel: a pure function; only a `Kernel` may be compiled. `points` are the points of a chunk as columns (P, 1).
            The arguments are tensors of samples (1, N) and tables, alone or in named tuples and dataclasses, or
            `PerPoint`.
        width: samples per point. The number of points and this number decide the chunks.
    """
    n = len(points)
    n_chunks = max(1, ceil(n * width / CHUNK))
    # Chunks have equal sizes, and a compiled kernel takes two points or more.
    size = max(2, ceil(n / n_chunks))

    run = ready(kernel, _chunk(points, arguments, 0, size), n * width) if isinstance(kernel, Kernel) else kernel
    with torch.no_grad():
        return torch.cat([run(*_chunk(points, arguments, start, size)) for start in range(0, n, size)])


def _chunk(points: ShadingPoints, arguments: Sequence[Any], start: int, size: int) -> list[Any]:
    """The arguments of a kernel for the points [start, start + size)."""
    stop = start + size
    return [points.columns(start, stop), *(a.rows(start, stop) if isinstance(a, PerPoint) else a for a in arguments)]
