"""The kernels that the cells of a study call, and how much work they have: found by running cells with few points.

Cells that differ only in their light, in the budget of their method or in other real numbers that are not 0 call the
same kernels, and so do cells that show another mesh or another virtual cube: only one of them is run.
"""

import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import fields, replace
from functools import partial
from math import sqrt
from typing import Any

import torch

from glossbench.envmap.cubemap import CubeMap
from glossbench.options import Options, copy_of
from glossbench.process.time_limit import alarm
from glossbench.scene.mesh_view import MeshView
from glossbench.scene.points import View
from glossbench.scene.virtual_cube import VirtualCube
from glossbench.shading.image import shade
from glossbench.shading.kernels.backend import choosing
from glossbench.shading.kernels.build import Call
from glossbench.shading.method import Method, find_budget_option
from glossbench.shading.stage_cache import StageCache
from glossbench.study.cells import Cell, to_text
from glossbench.study.schema import ReferenceOptions
from glossbench.truth.reference import ReferenceMethod, compute_reference
from glossbench.truth.sampling import FIRST_SAMPLES, N_REPLICATES

PIXELS, EDGE, TEXELS = 12, 2, 32  # along an edge of the views, of virtual cubes, and of the light
SHADE_RUNS = 4  # of a cell, to measure its time
SUM_ERROR = 1e-3  # relative error of the sums
USUAL_SAMPLES = 256  # of a method without a budget
MUCH = 1 << 24  # pairs of one call; the cell is not run further, because its precomputation does not become less


class _Enough(Exception):
    """A call has so much work that its cell is not run further."""


class CallFinder:
    """Finds the kernel calls of one study after another. What it has run for one study, it does not run again.

    Args:
        patience: seconds after which a cell with much precomputation is not run further.
        tell: called with the present work.
    """

    def __init__(self, patience: float = 1e6, tell: Callable[[str], None] = lambda text: None) -> None:
        self._patience, self._tell = patience, tell
        self._light, self._stages = _light(), StageCache()
        self._done: set[str] = set()  # kinds of cells and of references that were run

    def find(self, cells: Iterable[Cell], options: ReferenceOptions) -> Iterator[Call]:
        """The kernel calls of cells and of their references that earlier studies did not show, as they are found.

        Calls of equal kernels come several times, each with its share of the work of all cells. A cell that cannot be
        run is left out.

        Args:
            options: of the references. How many samples one will need is not known; the geometric mean of the first
                round and max_samples is assumed.
        """
        every = list(cells)
        for alike in self._new(
            every, lambda cell: [_kind(cell.method), _kind(cell.material), _kind(_small(cell.view))]
        ):
            cell = max(alike, key=_budget)
            self._tell(cell.method.name)

            def image(view: View, cell: Cell = cell) -> None:
                method, material = copy_of(cell.method), copy_of(cell.material)
                shade(method, self._light, material, view, cache=self._stages, time_it=False)

            yield from _times(SHADE_RUNS * sum(_enlargement(each.view) for each in alike), self._record(image, cell))
        first = FIRST_SAMPLES * N_REPLICATES
        for alike in self._new(every, lambda cell: [options.method, _kind(cell.material), _kind(_small(cell.view))]):
            cell = alike[0]
            self._tell("reference")

            def reference(view: View, method: ReferenceMethod, cell: Cell = cell) -> None:
                compute_reference(self._light, copy_of(cell.material), view, SUM_ERROR, first, method=method)

            references = _groups(alike, lambda cell: [to_text(each) for each in (cell.light, cell.material, cell.view)])
            times = sum(_enlargement(each[0].view) for each in references.values())
            is_sampled = options.method == "sampling"
            sums = [] if is_sampled else self._record(partial(reference, method="summation"), cell)
            yield from _times(times, sums)
            if not sums:  # where the scene hides light, there is no sum
                samples = self._record(partial(reference, method="sampling"), cell)
                yield from _times(times * sqrt(options.max_samples / first), samples)

    def _new(self, cells: Iterable[Cell], key: Callable[[Cell], Any]) -> Iterator[list[Cell]]:
        """The groups of cells with equal keys whose key is new."""
        for text, alike in _groups(cells, key).items():
            if text not in self._done:
                self._done.add(text)
                yield alike

    def _record(self, work: Callable[[View], None], cell: Cell) -> list[Call]:
        """The calls of some work for a view with few points."""
        calls: list[Call] = []

        def record(call: Call) -> bool:
            calls.append(call)
            if call.pairs > MUCH:
                raise _Enough
            return False

        # The run itself reports what is wrong with a cell.
        with suppress(Exception), choosing(record), alarm(self._patience):
            work(_small(cell.view))
        return calls


def calls_of(cells: Iterable[Cell], options: ReferenceOptions, patience: float = 1e6) -> list[Call]:
    """The different kernel calls of cells and of their references, each with the work of all cells together."""
    found: dict[str, Call] = {}
    for call in CallFinder(patience).find(cells, options):
        known = found.get(call.key)
        pairs = call.pairs + (known.pairs if known else 0)
        # The largest is compiled: the small dimensions of one of a few texels would be fixed.
        found[call.key] = max(known or call, call, key=_count_numbers)._replace(pairs=pairs)
    return list(found.values())


def _count_numbers(call: Call) -> int:
    return sum(tensor.numel() for tensor in call.tensors)


def bound_pairs(cells: Iterable[Cell], options: ReferenceOptions) -> float:
    """Points times samples of cells and their references, from their options alone, rather too many than too few.

    A method without a budget counts as 256 samples. Precomputation and more techniques of a reference do not count.
    """
    return sum(
        PIXELS**2 * _enlargement(cell.view) * (options.max_samples + SHADE_RUNS * max(_budget(cell), USUAL_SAMPLES))
        for cell in cells
    )


def _times(times: float, calls: Iterable[Call]) -> Iterator[Call]:
    """Calls with so many times as much work; that of a call with much work does not grow with the cells."""
    return (call if call.pairs > MUCH else call._replace(pairs=round(times * call.pairs)) for call in calls)


def _groups(cells: Iterable[Cell], key: Callable[[Cell], Any]) -> dict[str, list[Cell]]:
    """The cells with equal keys, by the text of the key."""
    groups: dict[str, list[Cell]] = {}
    for cell in cells:
        groups.setdefault(json.dumps(key(cell)), []).append(cell)
    return groups


def _kind(item: Options) -> list[Any]:
    """The name of an item and those of its options that may decide which kernels it calls."""
    budget = find_budget_option(type(item)) if isinstance(item, Method) else ""
    named = {
        name: value for name, value in item.as_dict().items() if name not in (budget, "seed", "resolution", "width")
    }
    return [item.name, {name: _without_reals(value) for name, value in named.items()}]


def _without_reals(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_without_reals(part) for part in value]
    return value == 0 if isinstance(value, float) else value  # 0 often switches a part off


def _budget(cell: Cell) -> Any:
    return getattr(cell.method, find_budget_option(type(cell.method)), 0) or 0


def _small(view: View) -> View:
    """A view of the same kind with few points; its scene hides light if that of the view does."""
    if isinstance(view, VirtualCube):
        return replace(view, edge=EDGE, every=1)
    known = {each.name for each in fields(view)}
    changed: dict[str, Any] = {"resolution": PIXELS} if "resolution" in known else {}
    shape = {"shape": MeshView().shape} if isinstance(view, MeshView) else {}
    return replace(view, **changed, **shape, **({"width": PIXELS} if "width" in known else {}))


def _enlargement(view: View) -> float:
    """How many times as many points a view has as the small one, if it shows as much of its pixels."""
    if isinstance(view, VirtualCube):
        return (view.edge / EDGE) ** 4 / view.every
    height = getattr(view, "resolution", PIXELS)
    return height * (getattr(view, "width", None) or height) / PIXELS**2


def _light() -> CubeMap:
    """A light whose texels all differ."""
    return CubeMap(torch.rand(6, TEXELS, TEXELS, 3, generator=torch.Generator().manual_seed(0)), "of kernel calls")
