"""Kernels: pure functions of tensors that run over all points, eagerly or compiled ahead of time."""

from glossbench.shading.kernels.chunks import PerPoint, over_points
from glossbench.shading.kernels.kernel import Kernel, kernel

__all__ = ["Kernel", "PerPoint", "kernel", "over_points"]
