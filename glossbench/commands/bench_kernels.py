"""The kernels of all methods on this machine: compiled, compared with eager and with Dr.Jit, in one run."""

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import MISSING, fields
from typing import Any, get_args

import torch

from glossbench.brdf.kurt import Kurt
from glossbench.envmap.lights.synthetic import Spots
from glossbench.process.time_limit import alarm
from glossbench.scene.sphere import Sphere
from glossbench.shading.image import shade
from glossbench.shading.kernels.backend import compiled, recording
from glossbench.shading.kernels.build import Call
from glossbench.shading.kernels.programs import program
from glossbench.shading.method import METHODS, Method, find_budget_option

PATIENCE = 20.0  # seconds for the stages of a method; one that takes longer is left out


def method_calls(cube: int, view: int, samples: int) -> Iterator[tuple[str, Call, int]]:
    """(method, kernel call of its first chunk, pairs of that chunk) of each method that sums over samples or maps.

    A method with a choice of footprints comes once for each. Kernels of a precomputation are left out.
    """
    light, points = Spots(resolution=cube).cubemap(), Sphere(resolution=view)
    for name, method in _variants(samples):
        with suppress(Exception), recording() as calls, alarm(PATIENCE):
            shade(method, light, Kurt(m=(0.15, 0.15)), points, time_it=False)
        over_points = [call for call in calls if call.tensors[0].ndim == 2]  # columns of points come first
        for call in over_points[:1]:
            n_points = call.tensors[0].shape[0]
            yield name, call, n_points * call.pairs // len(points.points())


def rates(call: Call, pairs: int, repeats: int = 10) -> tuple[float, float] | None:
    """Million pairs per second of a kernel, eager and compiled: the fastest of runs that take turns.

    None if it cannot be compiled.
    """
    run = compiled(call)
    if run is None:
        return None
    eager = program(call.kernel.function, call.form, call.part)
    best = [float("inf")] * 2
    with torch.no_grad():
        for turn in range(repeats + 1):
            for i, work in enumerate((eager, run)):
                seconds = _seconds(lambda work=work: work(call.tensors))  # type: ignore[misc]
                best[i] = min(best[i], seconds if turn else best[i])
    return pairs / best[0] / 1e6, pairs / best[1] / 1e6


def _seconds(work: Callable[[], Any]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def _variants(samples: int) -> Iterator[tuple[str, Method]]:
    for cls in map(METHODS.get, METHODS.names()):
        if any(each.default is MISSING and each.default_factory is MISSING for each in fields(cls)):
            continue  # it needs a file
        budget = {find_budget_option(cls): samples} if find_budget_option(cls) == "samples" else {}
        footprint = {each.name: each.type for each in fields(cls)}.get("footprint")
        for value in get_args(footprint) or (None,):
            stated = {"footprint": value} if value else {}
            yield f"{cls.name} {value or ''}".strip(), cls.create({**budget, **stated})
