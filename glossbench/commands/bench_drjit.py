"""The bench's shading kernel in Dr.Jit on LLVM, as a measure of what a compiler for rendering reaches here."""

from collections.abc import Callable
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any

import numpy as np
import torch
from torch import Tensor

from glossbench.brdf.kurt import FreeShadowing
from glossbench.envmap.pyramid import Pyramid
from glossbench.scene.points import ShadingPoints


def drjit_version() -> str | None:
    """The version of Dr.Jit if it is installed and finds LLVM, else None."""
    if find_spec("drjit") is None:
        return None
    import drjit

    return version("drjit") if drjit.has_backend(drjit.JitBackend.LLVM) else None


def filtered_samples_in_drjit(
    points: ShadingPoints, lobe: FreeShadowing, samples: Any, pyramid: Pyramid, level: Tensor
) -> Callable[[], Tensor]:
    """A function that sums the filtered samples of a lobe with one channel, (P, 3).

    One lane of Dr.Jit is one pair of point and sample. Its result is the same as that of the bench's kernel.
    """
    import drjit as dr
    from drjit.llvm import Array3f, Bool, Float, Int, UInt

    n_points, n = len(points), samples.quarter_pdf.shape[1]

    def array(t: Tensor) -> Any:
        return Float(np.ascontiguousarray(t.flatten().numpy()))

    frame = [[array(c) for c in v] for v in (points.t, points.b, points.n, points.wo)]
    drawn = [array(c) for c in (*samples.h, samples.quarter_pdf)]
    texels = [array(pyramid.texels[:, c]) for c in range(3)]
    offsets, sizes = (Int(t.numpy()) for t in (pyramid.offsets, pyramid.sizes))
    (f0,), (ks,) = ([float(c) for c in channel] for channel in (lobe.f0, lobe.ks))
    shadowing, base, top = float(lobe.shadowing), float(level), len(pyramid.sizes) - 1
    largest = float(torch.log2(pyramid.sizes[0].float()))
    dr.eval(frame, drawn, texels, offsets, sizes)

    def largest_of(a: Any, b: Any) -> Any:
        return dr.select(a > b, a, b)  # LLVM before 16 ends the process at a maximum

    def taps(face: Any, s: Any, t: Any, at: Any, share: Any, total: list[Any]) -> list[Any]:
        """total + the share of the bilinear radiance of one level."""
        size = dr.gather(Int, sizes, at)
        x, y = s * Float(size) + 0.5, t * Float(size) + 0.5
        i, j = Int(x), Int(y)
        fx, fy = x - Float(i), y - Float(j)
        first = dr.gather(Int, offsets, at) + (face * (size + 2) + j) * (size + 2) + i
        corners = ((0, (1 - fx) * (1 - fy)), (1, fx * (1 - fy)), (size + 2, (1 - fx) * fy), (size + 3, fx * fy))
        for step, weight in corners:
            row = UInt(first + step)
            total = [sum_ + share * weight * dr.gather(Float, texel, row) for sum_, texel in zip(total, texels)]  # noqa: B905
        return total

    def run() -> Tensor:
        lane = dr.arange(UInt, n_points * n)
        point, sample = lane // n, lane % n
        t, b, normal, view = (Array3f(*(dr.gather(Float, c, point) for c in v)) for v in frame)
        hx, hy, hz, quarter = (dr.gather(Float, c, sample) for c in drawn)
        wo, h = Array3f(dr.dot(view, t), dr.dot(view, b), dr.dot(view, normal)), Array3f(hx, hy, hz)
        c = dr.dot(wo, h)
        wi = 2 * c * h - wo
        visible = (wi.z > 0) & (c > 0)
        c = largest_of(c, Float(1e-4))
        value = dr.exp2(-shadowing * dr.log2(largest_of(wi.z * wo.z, Float(1e-12)))) / (4 * c)
        m = 1 - c
        weight = dr.select(visible, value * 4 * c * wi.z / hz * ks * (f0 + (1 - f0) * m * m * m * m * m), 0)
        d = wi.x * t + wi.y * b + wi.z * normal
        ax, ay, az = dr.abs(d.x), dr.abs(d.y), dr.abs(d.z)
        major = largest_of(largest_of(ax, ay), az)
        lod = base + 0.5 * (2 * largest - 2 - 3 * dr.log2(major) - dr.log2(quarter / c))
        is_x, is_y = (ax >= ay) & (ax >= az), ay >= az
        face = dr.select(
            is_x, dr.select(d.x < 0, Int(1), Int(0)),
            dr.select(is_y, dr.select(d.y < 0, Int(3), Int(2)), dr.select(d.z < 0, Int(5), Int(4))),
        )  # fmt: skip
        s = dr.select(is_x, dr.select(d.x < 0, -d.z, d.z), dr.select(Bool(is_y), d.x, dr.select(d.z < 0, d.x, -d.x)))
        down = dr.select(is_x, -d.y, dr.select(is_y, dr.select(d.y < 0, d.z, -d.z), -d.y))
        s, down = s / major * 0.5 + 0.5, down / major * 0.5 + 0.5
        lod = largest_of(dr.select(lod < top, lod, Float(top)), Float(0))
        lower = Int(lod)
        share = lod - Float(lower)
        total = taps(face, s, down, lower, 1 - share, [Float(0)] * 3)
        total = taps(face, s, down, dr.select(lower < top, lower + 1, lower), share, total)
        sums = [dr.block_sum(weight * channel, n) for channel in total]
        dr.eval(sums)
        dr.sync_thread()
        return torch.from_numpy(np.stack([np.array(channel) for channel in sums], axis=1))

    return run
