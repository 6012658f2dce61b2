"""The kernels that the cells of a study call, and how much work they have: found by running cells with few points.

Cells that differ only in their light, in the budget of their method or in other real numbers call the same kernels:
only one of them is run.
"""

import json
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import fields, replace
from functools import partial
from math import sqrt
from typing import Any

import torch

from glossbench.envmap.cubemap import CubeMap
from glossbench.options import Options, copy_of
from glossbench.process.time_limit import alarm
from glossbench.scene.points import View
from glossbench.shading.image import shade
from glossbench.shading.kernels.backend import choosing
from glossbench.shading.kernels.build import Call
from glossbench.shading.method import Method, find_budget_option
from glossbench.shading.stage_cache import StageCache
from glossbench.study.cells import Cell, to_text
from glossbench.study.schema import ReferenceOptions
from glossbench.truth.reference import ReferenceMethod, compute_reference
from glossbench.truth.sampling import FIRST_SAMPLES, N_REPLICATES

PIXELS, TEXELS = 12, 32  # along an edge of the views, and of the light
SHADE_RUNS = 4  # of a cell, to measure its time
SUM_ERROR = 1e-3  # relative error of the sums
USUAL_SAMPLES = 256  # of a method without a budget
MUCH = 1 << 24  # pairs of one call; the cell is not run further, because its precomputation does not become less


class _Enough(Exception):
    """A call has so much work that its cell is not run further."""


def calls_of(
    cells: Iterable[Cell],
    options: ReferenceOptions,
    patience: float = 1e6,
    tell: Callable[[str], None] = lambda text: None,
) -> list[Call]:
    """The different kernel calls of cells and of their references, each with the work of all cells together.

    A cell that cannot be run is left out.

    Args:
        options: of the references. How many samples one will need is not known; the geometric mean of the first round
            and max_samples is assumed.
        patience: seconds after which a cell with much precomputation is not run further.
        tell: called with the present work.
    """
    every, light, stages = list(cells), _light(), StageCache()
    found: dict[str, Call] = {}
    for alike in _groups(every, lambda cell: [_kind(cell.method), _kind(cell.material), _kind(cell.view)]):
        cell = max(alike, key=_budget)
        tell(f"the kernels of {cell.method.name}")

        def image(view: View, cell: Cell = cell) -> None:
            shade(copy_of(cell.method), light, copy_of(cell.material), view, cache=stages, time_it=False)

        _add(found, _recorded(image, cell.view, patience), SHADE_RUNS * sum(_enlargement(each.view) for each in alike))
    first = FIRST_SAMPLES * N_REPLICATES
    for alike in _groups(every, lambda cell: [_kind(cell.material), _kind(cell.view)]):
        cell = alike[0]

        def reference(view: View, method: ReferenceMethod, cell: Cell = cell) -> None:
            compute_reference(light, copy_of(cell.material), view, SUM_ERROR, first, method=method)

        references = _groups(alike, lambda cell: [to_text(each) for each in (cell.light, cell.material, cell.view)])
        times = sum(_enlargement(each[0].view) for each in references)
        sums = (
            []
            if options.method == "sampling"
            else _recorded(partial(reference, method="summation"), cell.view, patience)
        )
        _add(found, sums, times)
        if not sums:  # where the scene hides light, there is no sum
            samples = _recorded(partial(reference, method="sampling"), cell.view, patience)
            _add(found, samples, times * sqrt(options.max_samples / first))
    return list(found.values())


def bound_pairs(cells: Iterable[Cell], options: ReferenceOptions) -> float:
    """Points times samples of cells and their references, from their options alone, rather too many than too few.

    A method without a budget counts as 256 samples. Precomputation and more techniques of a reference do not count.
    """
    return sum(
        PIXELS**2 * _enlargement(cell.view) * (options.max_samples + SHADE_RUNS * max(_budget(cell), USUAL_SAMPLES))
        for cell in cells
    )


def _recorded(work: Callable[[View], None], view: View, patience: float) -> list[Call]:
    """The calls of some work for a view with few pixels."""
    calls: list[Call] = []

    def record(call: Call) -> bool:
        calls.append(call)
        if call.pairs > MUCH:
            raise _Enough
        return False

    # The run itself reports what is wrong with a cell.
    with suppress(Exception), choosing(record), alarm(patience):
        work(_small(view))
    return calls


def _add(found: dict[str, Call], calls: Iterable[Call], times: float) -> None:
    for call in calls:
        known = found.get(call.key)
        pairs = call.pairs if call.pairs > MUCH else round(times * call.pairs)
        found[call.key] = call._replace(pairs=pairs + (known.pairs if known else 0))


def _groups(cells: Iterable[Cell], key: Callable[[Cell], Any]) -> list[list[Cell]]:
    """The cells with equal keys, group by group."""
    groups: dict[str, list[Cell]] = {}
    for cell in cells:
        groups.setdefault(json.dumps(key(cell)), []).append(cell)
    return list(groups.values())


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
    return None if isinstance(value, float) else value


def _budget(cell: Cell) -> Any:
    return getattr(cell.method, find_budget_option(type(cell.method)), 0) or 0


def _small(view: View) -> View:
    """The view with few pixels, if it has a resolution."""
    known = {each.name for each in fields(view)}
    changed: dict[str, Any] = {"resolution": PIXELS} if "resolution" in known else {}
    return replace(view, **changed, **({"width": PIXELS} if "width" in known else {}))


def _enlargement(view: View) -> float:
    """How many times as many pixels a view has as the small one."""
    height = getattr(view, "resolution", PIXELS)
    return height * (getattr(view, "width", None) or height) / PIXELS**2


def _light() -> CubeMap:
    """A light whose texels all differ."""
    return CubeMap(torch.rand(6, TEXELS, TEXELS, 3, generator=torch.Generator().manual_seed(0)), "of kernel calls")
