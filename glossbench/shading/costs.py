"""Costs: seconds of work once warm, bytes of what it leaves, and the record of both that an image carries."""

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from time import perf_counter, process_time
from typing import Any, NamedTuple

import torch
from torch import Tensor

# Runs after the first, of work that takes long: three, that their spread shows; but no third once 10 s are spent.
LEAST_RUNS, LONG = 3, 10.0
# A first run of so many seconds is as good as any: what a cold start adds, some tens of milliseconds, is lost in it.
STARTED = 1.0


class Timing(NamedTuple):
    """Seconds of some work, run several times.

    Attributes:
        median: of the runs.
        low: the fastest run.
        high: the slowest run.
        runs: how many count.
        busy: share of the time in which this process could have run that other work had the processor, [0, 1].
    """

    median: float = float("nan")
    low: float = float("nan")
    high: float = float("nan")
    runs: int = 0
    busy: float = float("nan")


@dataclass(frozen=True)
class Costs:
    """What an image cost.

    Attributes:
        stage_seconds: of each stage, in their order.
        update_seconds: of the stages that must be redone when the light, material, geometry or view changes.
        shade: of all pixels, once the stages are there.
        state_bytes: of what all stages leave in memory.
        n_samples: light samples a pixel.
    """

    stage_seconds: dict[str, float] = field(default_factory=dict)
    update_seconds: dict[str, float] = field(default_factory=dict)
    shade: Timing = field(default_factory=Timing)
    state_bytes: int = 0
    n_samples: int = 0

    @property
    def shade_seconds(self) -> float:
        """Seconds of all pixels, the median of several runs."""
        return self.shade.median


def timed(work: Callable[[], Any], device: str = "cpu", patience: float = 0.2) -> tuple[Any, Timing]:
    """The value of some work and the seconds that it takes once warm.

    After a first run the work is run again while `patience` seconds last, and at least three times (twice where that
    takes more than ten seconds); patience 0 makes do with the first.
    """
    value, first = _run(work, device)
    if patience == 0:
        return value, Timing(first, first, first, 1)
    counted = [first] if first > STARTED else []
    watch, spent = Watch(), 0.0
    while spent < patience or len(counted) < (LEAST_RUNS if sum(counted) < LONG else 2):
        value, seconds = _run(work, device)
        counted.append(seconds)
        spent += max(seconds, patience / 5)
    return value, Timing(median(counted), min(counted), max(counted), len(counted), watch.busy())


class Watch:
    """How much other work had the processor since it was made."""

    def __init__(self) -> None:
        self._started = self._now()

    def busy(self) -> float:
        """Share of the time in which this process could have run that it waited for a processor, [0, 1].

        Linux counts, of each thread, the time that it waits. Elsewhere it is the share of the time without any
        progress, which says less where several threads work.
        """
        wall, cpu, waited = (now - then for now, then in zip(self._now(), self._started, strict=True))
        if waited != waited:  # NaN: not counted here
            return max(0.0, 1 - cpu / wall) if wall > 0 else 0.0
        return max(0.0, waited) / (max(0.0, waited) + cpu) if cpu > 0 else 0.0

    def _now(self) -> tuple[float, float, float]:
        return perf_counter(), process_time(), _waited()


def _waited() -> float:
    """Seconds that the threads of this process waited for a processor so far; NaN where nothing counts them."""
    total = 0.0
    for path in Path("/proc/self/task").glob("*/schedstat"):
        try:
            total += 1e-9 * int(path.read_text().split()[1])
        except OSError:  # a thread that has just ended
            continue
    return total or float("nan")


def _run(work: Callable[[], Any], device: str) -> tuple[Any, float]:
    started = perf_counter()
    value = work()
    if device.startswith("cuda"):
        torch.cuda.synchronize()
    return value, perf_counter() - started


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
