"""Costs: seconds of work after a warm-up, bytes of its results, and the record of both in an image."""

import dataclasses
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from statistics import median
from time import perf_counter, process_time
from typing import Any, NamedTuple

import torch
from torch import Tensor

# Least number of counted runs of long work: three, so that their spread is known, but two if these take 10 s.
LEAST_RUNS, LONG = 3, 10.0
# A first run of more seconds than this counts too: a cold start adds only some tens of milliseconds to it.
STARTED = 1.0


class Timing(NamedTuple):
    """Seconds of some work, run several times.

    Attributes:
        median: median of the runs.
        low: the fastest run.
        high: the slowest run.
        runs: number of runs that count.
        busy: of the time in which this process could have run, the share in which other work had the processor, [0, 1].
    """

    median: float = float("nan")
    low: float = float("nan")
    high: float = float("nan")
    runs: int = 0
    busy: float = float("nan")


@dataclass(frozen=True)
class Costs:
    """The costs of an image.

    Attributes:
        stage_seconds: time of each stage, in their order [s].
        update_seconds: time of the stages that must be computed again when the light, material, geometry or view
            changes [s].
        shade: time of shading all pixels, without the stages.
        state_bytes: size of the results of all stages [bytes].
        n_samples: light samples per pixel.
    """

    stage_seconds: dict[str, float] = field(default_factory=dict)
    update_seconds: dict[str, float] = field(default_factory=dict)
    shade: Timing = field(default_factory=Timing)
    state_bytes: int = 0
    n_samples: int = 0

    @property
    def shade_seconds(self) -> float:
        """Time of shading all pixels, the median of several runs [s]."""
        return self.shade.median


def time_work(work: Callable[[], Any], device: str = "cpu", patience: float = 0.2) -> tuple[Any, Timing]:
    """The value of some work and the seconds that it takes after a warm-up.

    After a first run the work is run again until `patience` seconds have passed, and at least three times (twice if
    that takes more than ten seconds). With patience 0 only the first run is made.
    """
    value, first = _run(work, device)
    if patience == 0:
        return value, Timing(first, first, first, 1)
    counted = [first] if first > STARTED else []
    watch, spent = Watch(), 0.0
    while spent < patience or len(counted) < (LEAST_RUNS if sum(counted) < LONG else 2):
        value = None  # it may be large, and the next run makes it again
        value, seconds = _run(work, device)
        counted.append(seconds)
        spent += max(seconds, patience / 5)
    return value, Timing(median(counted), min(counted), max(counted), len(counted), watch.measure_busy_share())


class Watch:
    """Measures how much other work has had the processor since this object was made."""

    def __init__(self) -> None:
        self._started = self._read_clocks()

    def measure_busy_share(self) -> float:
        """The share of its runnable time in which this process waited for a processor, [0, 1].

        Linux counts the waiting time of each thread. On other systems the result is the share of the time in which the
        process did not use a processor, which is less exact if several threads work.
        """
        wall, cpu, waited = (now - then for now, then in zip(self._read_clocks(), self._started, strict=True))
        if waited != waited:  # NaN: this system does not count it
            return max(0.0, 1 - cpu / wall) if wall > 0 else 0.0
        return max(0.0, waited) / (max(0.0, waited) + cpu) if cpu > 0 else 0.0

    def _read_clocks(self) -> tuple[float, float, float]:
        return perf_counter(), process_time(), _read_waiting_time()


def _read_waiting_time() -> float:
    """Seconds that the threads of this process have waited for a processor; NaN if the system does not count them."""
    total = 0.0
    with suppress(OSError):  # no other system has this folder
        for thread in os.listdir("/proc/self/task"):
            with suppress(OSError), open(f"/proc/self/task/{thread}/schedstat") as file:  # it may have just ended
                total += 1e-9 * int(file.read().split()[1])
    return total or float("nan")


def _run(work: Callable[[], Any], device: str) -> tuple[Any, float]:
    started = perf_counter()
    value = work()
    if device.startswith("cuda"):
        torch.cuda.synchronize()
    return value, perf_counter() - started


def count_bytes(value: Any) -> int:
    """Bytes of all tensors inside a value: tuples, dictionaries and dataclasses of them."""
    return sum(t.element_size() * t.nelement() for t in find_tensors(value))


def find_tensors(value: Any) -> Iterator[Tensor]:
    """All tensors inside a value: tuples, dictionaries and dataclasses of them."""
    if isinstance(value, Tensor):
        yield value
    elif isinstance(value, Mapping):
        yield from (t for v in value.values() for t in find_tensors(v))
    elif isinstance(value, tuple | list):
        yield from (t for v in value for t in find_tensors(v))
    elif dataclasses.is_dataclass(value):
        yield from (t for f in dataclasses.fields(value) for t in find_tensors(getattr(value, f.name)))
