"""Measure what a run costs beside shading: the time of a cell, a second worker, and the memory of many cells."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import torch

from glossbench.commands.bench import Line
from glossbench.directions import points_2d
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.pyramid import Pyramid, weighted_radiance
from glossbench.errors import InputError
from glossbench.memory import read_peak
from glossbench.prefilter.filtered_samples import filtered_samples
from glossbench.prefilter.pyramids import build_pyramid
from glossbench.run.progress import Progress
from glossbench.run.runner import run_study
from glossbench.scene.points import ShadingPoints
from glossbench.shading.kernels import over_points
from glossbench.shading.method import METHODS, Method, stage
from glossbench.study.study import load_study

SERIAL, DASK, BOUND = 5000, 500, 20  # cells: tiny ones, tiny ones on Dask, shading-bound ones of one material
AIMS = {"serial": 5.0, "Dask": 15.0}  # ms
WARM = 100  # cells after which the memory counts


class Tiny(Method):
    """One radiance everywhere: what its cells take is what any cell takes beside its shading."""

    name = "bench_tiny"
    level: float = 0.5

    def shade(self, points: ShadingPoints) -> Any:
        return torch.full((len(points), 3), self.level)


class Bound(Method):
    """Filtered samples with one thread: nearly all of the time of its cells is shading."""

    name = "bench_bound"
    samples: int = 128
    level: float = 0.5

    @stage
    def pyramid(self, light: CubeMap) -> Pyramid:
        return build_pyramid(light, "box")

    def shade(self, points: ShadingPoints, material: Any, pyramid: Pyramid) -> Any:
        torch.set_num_threads(1)
        lobe = material.lobes[0]
        samples = lobe.sample_points(points_2d(self.samples))
        return over_points(_sum_filtered, points, self.samples, lobe, samples, pyramid, torch.tensor(-self.level))


def _sum_filtered(points: ShadingPoints, lobe: Any, samples: Any, pyramid: Pyramid, level: torch.Tensor) -> Any:
    _, d, lod, weight = filtered_samples(points, lobe, samples, pyramid, level)
    return weighted_radiance(pyramid, d, lod, weight)


def measure_scale(tell: Callable[[str], None]) -> list[Line]:
    """All measurements, in about 4 minutes; `tell` is called with the name of each before it begins."""
    with _apart() as folder:
        tell(f"{SERIAL} tiny cells, one after another")
        lines = _measure_tiny(folder, "serial", SERIAL, None)
        try:
            tell(f"{DASK} tiny cells on one worker of Dask")
            lines += _measure_tiny(folder, "Dask", DASK, "local:1")
            rates = []
            for n in (1, 2):
                tell(f"{2 * BOUND} shading-bound cells on {n} worker{'s' if n > 1 else ''}")
                rates.append(_measure_bound(folder, n))
        except InputError as error:
            return [*lines, Line("Dask", f"not measured: {error}")]
    return [
        *lines,
        Line("shading-bound cells, one worker with one thread", f"{rates[0]:.2f} cells/s", "1"),
        Line("the same on two workers; aim 1.85", f"{rates[1]:.2f} cells/s", f"{rates[1] / rates[0]:.2f}"),
    ]


@contextmanager
def _apart() -> Iterator[Path]:
    """A folder, and the methods of this file; what runs measure here is not remembered for predictions."""
    stated = os.environ.get("XDG_CACHE_HOME")
    with TemporaryDirectory(prefix="glossbench-") as folder, METHODS.isolated():
        os.environ["XDG_CACHE_HOME"] = folder
        for cls in (Tiny, Bound):
            METHODS.register(cls.name)(cls)
        try:
            yield Path(folder)
        finally:
            del os.environ["XDG_CACHE_HOME"]
            if stated is not None:
                os.environ["XDG_CACHE_HOME"] = stated


def _measure_tiny(folder: Path, how: str, n: int, dask: str | None) -> list[Line]:
    """The time of a cell from the second one on, and the growth of the memory of this process."""
    moments, peaks = [], []

    def count(row: Any) -> None:
        moments.append(time.perf_counter())
        if len(moments) in (WARM, n):
            peaks.append(read_peak())

    began = time.perf_counter()
    _run(folder, how, "sphere: {resolution: 8}", Tiny, 1, n, dask, count)
    whole = time.perf_counter() - began
    each = 1000 * (moments[-1] - moments[0]) / (n - 1)
    return [
        Line(f"a tiny cell, {how}; aim below {AIMS[how]:g} ms", f"{each:.1f} ms"),
        Line(f"{n} tiny cells, {how}, with all that comes before and after", f"{whole:.1f} s"),
        Line(f"memory that grows from cell {WARM} to cell {n}, {how}", f"{(peaks[1] - peaks[0]) / 1e6:.1f} MB"),
    ]


def _measure_bound(folder: Path, n_workers: int) -> float:
    """Cells per second from the moment at which both materials have a cell: all workers have begun then."""
    seen: set[str] = set()
    moments: list[float] = []

    def count(row: Any) -> None:
        seen.add(row["material_options"])
        if len(seen) == 2:
            moments.append(time.perf_counter())

    _run(folder, f"bound_{n_workers}", "sphere: {resolution: 128}", Bound, 2, BOUND, f"local:{n_workers}", count)
    return (len(moments) - 1) / (moments[-1] - moments[0])


def _run(
    folder: Path, name: str, view: str, method: type[Method], n_materials: int, n: int, dask: str | None,
    count: Callable[[Any], None],
) -> None:  # fmt: skip
    """Run n cells of a method for each material."""
    levels = ", ".join(f"{(i + 1) / n:.6f}" for i in range(n))
    widths = ", ".join(f"[{0.3 + 0.1 * i:.1f}, {0.3 + 0.1 * i:.1f}]" for i in range(n_materials))
    (folder / f"{name}.yaml").write_text(
        f"title: {name}\nlight: {{gradient: {{resolution: 32}}}}\nmaterial: {{ggx: {{alpha: [{widths}]}}}}\n"
        f"view: {{{view}}}\nmethods: {{{method.name}: {{level: [{levels}]}}}}\nreference: {{relative_error: 0.05}}\n"
        "metrics: [rms]\n"
    )
    run_study(load_study(folder / f"{name}.yaml"), folder / name, dask=dask, progress=Progress(cell=count))
