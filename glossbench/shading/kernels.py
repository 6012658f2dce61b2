"""Running a kernel over all points: in chunks that limit the working set, fused by torch.compile if that is faster.

A kernel is a pure function kernel(points, *arguments) -> `OfPoints`: `points` are the ShadingPoints of a chunk as
columns (P, 1). The arguments are tensors of samples (1, N) and tables, alone or in named tuples and frozen dataclasses,
or `PerPoint`.
"""

import logging
import shutil
from collections.abc import Callable
from contextlib import nullcontext
from functools import cache, wraps
from math import ceil
from typing import Any, NamedTuple, TypeVar, cast

import torch
from jaxtyping import Shaped
from torch import Tensor

from glossbench.scene.points import ShadingPoints

# Point-sample pairs per chunk: a temporary of 512 KiB stays in a core's second-level cache. Measured on two cores,
# eager: 2^14 pairs 5.8, 2^17 pairs 9.5, 2^19 pairs 8.7 million pairs per second.
CHUNK = 1 << 17
# A call of about three seconds or more in eager mode (11 million pairs per second) is fused (47 million). Compiling
# takes about 15 s the first time, and 4 s from the compiler's cache on disk. The rule depends only on the call, so that
# a resumed run makes the same choice.
FUSE_ABOVE = 1 << 25

OfPoints = Shaped[Tensor, "points columns"]  # one row for each point
Kernel = Callable[..., OfPoints]
F = TypeVar("F", bound=Callable[..., Any])

_leave_out: list[Callable[[], None]] = []


class PerPoint(NamedTuple):
    """An argument of a kernel with one row for each point. The kernel gets the rows of its chunk as a tensor."""

    values: OfPoints

    def rows(self, start: int, stop: int) -> OfPoints:
        """Rows [start, stop)."""
        return self.values[start:stop]


def over_points(
    kernel: Kernel, points: ShadingPoints, width: int, *arguments: Any, fuse: bool | None = None
) -> OfPoints:
    """kernel(points, *arguments) for all points, chunk by chunk.

    Args:
        width: samples per point. The number of points and this number decide the chunks and whether to fuse.
        fuse: force the fused (True) or the eager (False) kernel.
    """
    n = len(points)
    if fuse is None:
        fuse = n * width >= FUSE_ABOVE
    run = fused(kernel) if fuse else kernel
    # Chunks have equal sizes: a last chunk of a single point would be compiled again.
    n_chunks = max(1, ceil(n * width / CHUNK))
    size = max(2, ceil(n / n_chunks))
    starts = range(0, n, size)
    # One kernel serves many kinds of lobes and tables, and is compiled for each of them.
    limits = torch._dynamo.config.patch(recompile_limit=64) if fuse else nullcontext()
    with limits, torch.no_grad():
        return torch.cat([run(points.columns(i, i + size), *_of_chunk(arguments, i, i + size)) for i in starts])


def _of_chunk(arguments: tuple[Any, ...], start: int, stop: int) -> list[Any]:
    return [a.rows(start, stop) if isinstance(a, PerPoint) else a for a in arguments]


def untraced(function: F) -> F:
    """Decorator: fused kernels call the function without compiling it, for example one that casts rays by a library.

    torch.compiler.disable does this, but it imports the compiler, which takes longer than the rest of a program start.
    So it is called only when a kernel is fused.
    """
    called: Callable[..., Any] = function

    def leave_out() -> None:
        nonlocal called
        called = torch.compiler.disable(function)

    @wraps(function)
    def run(*arguments: Any) -> Any:
        return called(*arguments)

    _leave_out.append(leave_out)
    return cast("F", run)


@cache
def can_fuse() -> bool:
    """Whether torch.compile has a C++ compiler to fuse with; if it does not, a warning of one line says so."""
    compiler = next((c for c in ("g++", "clang++", "c++", "cl") if shutil.which(c)), None)
    if compiler is None:
        logging.getLogger("glossbench").warning("no C++ compiler found: kernels run eagerly, about 5 times slower")
    return compiler is not None


@cache
def fused(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """The kernel compiled by torch.compile with dynamic shapes, or the kernel itself if there is no compiler.

    If the compiler fails, for example on a half-written file of a killed process in its cache, a warning of one line
    says so, and the kernel runs eagerly from then on.
    """
    if not can_fuse():
        return kernel
    from torch._dynamo.exc import BackendCompilerFailed
    from torch._inductor.exc import InductorError

    while _leave_out:
        _leave_out.pop()()
    # By default torch builds and loads a test program for each vector extension, 20 s of work. The CPU's flags suffice.
    run = torch.compile(kernel, dynamic=True, options={"cpp.vec_isa_ok": True})

    def guarded(*arguments: Any) -> Any:
        nonlocal run
        try:
            return run(*arguments)
        except (BackendCompilerFailed, InductorError) as error:
            why = str(error).strip().splitlines()[0]
            logging.getLogger("glossbench").warning("%s is not compiled and runs eagerly: %s", kernel.__name__, why)
            run = kernel
            return kernel(*arguments)

    return guarded
