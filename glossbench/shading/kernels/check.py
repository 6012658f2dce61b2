"""The largest difference between a compiled kernel and the eager one."""

import torch
from torch import Tensor

from glossbench.shading.kernels.backend import load
from glossbench.shading.kernels.build import Call
from glossbench.shading.kernels.programs import program


def difference(call: Call) -> float | None:
    """The largest difference, divided by the largest absolute value of the eager result; None if it is not compiled.

    NaN if one of the results is not finite.
    """
    run = load(call)
    if run is None:
        return None
    tensors = list(call.tensors)
    with torch.no_grad():
        if call.part == "after rays":  # every second sample sees the light
            needed = program(call.kernel.function, call.form, "before rays")(tensors)[0]
            tensors.append(torch.arange(needed.numel()).view(needed.shape) % 2 == 0)
        eager, compiled = _stacked(program(call.kernel.function, call.form, call.part)(tensors)), _stacked(run(tensors))
    return float((compiled - eager).abs().max() / eager.abs().max().clamp(min=1e-30))


def _stacked(value: Tensor | tuple[Tensor, ...]) -> Tensor:
    return (
        torch.stack([part.float() for part in torch.broadcast_tensors(*value)]) if isinstance(value, tuple) else value
    )
