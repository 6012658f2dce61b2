"""Costs: seconds of work once warm, bytes of what it leaves, and the record of both that an image carries."""

import dataclasses
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor


@dataclass(frozen=True)
class Costs:
    """What an image cost.

    Attributes:
        stage_seconds: of each stage, in their order.
        update_seconds: of the stages that must be redone when the light, material, geometry or view changes.
        shade_seconds: of all pixels, once the stages are there.
        state_bytes: of what all stages leave in memory.
        n_samples: light samples a pixel.
    """

    stage_seconds: dict[str, float] = field(default_factory=dict)
    update_seconds: dict[str, float] = field(default_factory=dict)
    shade_seconds: float = 0.0
    state_bytes: int = 0
    n_samples: int = 0


def timed(work: Callable[[], Any], device: str = "cpu", patience: float = 0.2) -> tuple[Any, float]:
    """The value of some work and the seconds that it takes once warm.

    After a first run the work is run again, at least once and while `patience` seconds last, and the fastest of these
    counts; patience 0 makes do with the first.
    """
    value, best = _run(work, device)
    if patience == 0:
        return value, best
    best, spent = float("inf"), 0.0
    while spent < patience:
        value, seconds = _run(work, device)
        best, spent = min(best, seconds), spent + max(seconds, patience / 5)
    return value, best


def _run(work: Callable[[], Any], device: str) -> tuple[Any, float]:
    started = time.perf_counter()
    value = work()
    if device.startswith("cuda"):
        torch.cuda.synchronize()
    return value, time.perf_counter() - started


def n_bytes(value: Any) -> int:
    """Bytes of all tensors inside a value: tuples, dictionaries and dataclasses of them."""
    return sum(t.element_size() * t.nelement() for t in tensors_in(value))


def tensors_in(value: Any) -> Iterator[Tensor]:
    """All tensors inside a value: tuples, dictionaries and dataclasses of them."""
    if isinstance(value, Tensor):
        yield value
    elif isinstance(value, Mapping):
        yield from (t for v in value.values() for t in tensors_in(v))
    elif isinstance(value, tuple | list):
        yield from (t for v in value for t in tensors_in(v))
    elif dataclasses.is_dataclass(value):
        yield from (t for f in dataclasses.fields(value) for t in tensors_in(getattr(value, f.name)))
