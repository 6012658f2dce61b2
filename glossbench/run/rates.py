"""What a run will cost in time, memory and disk, from what earlier runs of this user measured.

A time is a + b * pixels + c * work, with no negative coefficient: what each cell takes, its image, and its shading.
The work of a cell is its pixels times the budget of its method, that of a reference its pixels. Bytes on disk are
a + b * pixels. The coefficients are those with the least relative squares over the last measurements. What these do not
tell apart, a and b after views of one size, is shared equally. Stages count apart, by their mean over the cells of a
method: some cells compute a stage that the others share, and few depend on the view. So do metrics, by their names, as
a + b * pixels: FLIP takes longer than many a method. Memory is BYTES_A_PIXEL for each
pixel and the median of the rest, because runs differ in more than their pixels: a slope that is fitted to runs with
views of 8^2 and 96^2 pixels predicts 87 GB for full HD.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy

from glossbench.atomic import replacing
from glossbench.catalog.folders import cache_folder
from glossbench.errors import InputError
from glossbench.memory import read_peak
from glossbench.scene.points import BYTES_A_PIXEL, View
from glossbench.shading.method import find_budget_option
from glossbench.strict_json import seal, unseal
from glossbench.study.cells import Cell, to_text
from glossbench.study.schema import ReferenceOptions

KEPT = 24  # measurements of one kind


class Spent(NamedTuple):
    """One measurement, of one kind: a cell or its stages by the name of its method, its metrics by theirs, a reference,
    or the memory of a run.
    """

    kind: str
    work: float
    pixels: int
    seconds: float
    n_bytes: int


def count_pixels(view: View) -> int:
    """The pixels of a view."""
    stated = (getattr(view, option, None) for option in ("resolution", "width"))
    sizes = [size for size in stated if isinstance(size, int) and size > 0] or [128]
    return sizes[0] * sizes[-1]


def measure_cell(cell: Cell, seconds: float, n_bytes: int) -> Spent:
    """What a cell took, without its stages and metrics."""
    return Spent(f"method {cell.method.name}", _work(cell), count_pixels(cell.view), seconds, n_bytes)


def measure_stages(cell: Cell, seconds: float) -> Spent:
    """What the stages took that were computed for a cell; 0 if others had computed them."""
    return Spent(f"stages {cell.method.name}", 0.0, 0, seconds, 0)


def measure_metrics(cell: Cell, metrics: Iterable[str], seconds: float) -> Spent:
    """What the metrics of a cell took, given by their columns."""
    pixels = count_pixels(cell.view)
    return Spent(_name_metrics(metrics), pixels, pixels, seconds, 0)


def measure_reference(cell: Cell, options: ReferenceOptions, seconds: float, n_bytes: int) -> Spent:
    """What a reference took."""
    pixels = count_pixels(cell.view)
    return Spent(_name_reference(cell, options), pixels, pixels, seconds, n_bytes)


def measure_memory(cells: Iterable[Cell]) -> Spent:
    """The most memory that this process has taken, by the largest view of its cells."""
    pixels = max(count_pixels(cell.view) for cell in cells)
    return Spent("memory", pixels, pixels, 0.0, read_peak())


def remember(spent: Sequence[Spent]) -> None:
    """Keep measurements in the user's cache folder, the newest of each kind."""
    if not spent:
        return
    known = _read()
    for each in spent:
        known[each.kind] = [*known[each.kind], list(each[1:])][-KEPT:]
    with suppress(OSError, InputError):  # a prediction is not worth an error
        _file().parent.mkdir(parents=True, exist_ok=True)
        with replacing(_file()) as part:
            part.write_text(seal({"rates": known}))


@dataclass(frozen=True)
class Prediction:
    """The cost of cells.

    Attributes:
        seconds: on one process.
        disk: bytes.
        memory: peak of one process [bytes]; None if none was measured.
        n_unknown: cells and references of which nothing alike was measured; others stand for them.
    """

    seconds: float
    disk: float
    memory: float | None
    n_unknown: int


def predict(cells: Sequence[Cell], options: ReferenceOptions, metrics: Iterable[str]) -> Prediction:
    """What these cells, their references and their metrics will cost; metrics are given by their columns."""
    known = _read()
    wanted = [(f"method {cell.method.name}", _work(cell), count_pixels(cell.view)) for cell in cells]
    references = {tuple(map(to_text, (cell.light, cell.material, cell.view))): cell for cell in cells}
    of_views = ((cell, count_pixels(cell.view)) for cell in references.values())
    wanted += [(_name_reference(cell, options), pixels, pixels) for cell, pixels in of_views]
    seconds = disk = 0.0
    n_unknown = 0
    for kind, work, pixels in wanted:
        alike = known.get(kind)
        if alike is None:
            n_unknown += 1
            first = kind.partition(" ")[0]
            alike = [each for other, found in known.items() if other.startswith(f"{first} ") for each in found]
        seconds += _fit([(s, p, w) for w, p, s, _ in alike], pixels, work)
        disk += _fit([(n, p) for _, p, _, n in alike], pixels)
    seconds += sum(_average_stages(known, cell.method.name) for cell in cells)
    seconds += _predict_metrics(known, cells, _name_metrics(metrics))
    return Prediction(seconds, disk, predict_memory(cells), n_unknown)


def predict_memory(cells: Sequence[Cell]) -> float | None:
    """The most memory that one process will take [bytes]; None if none was measured."""
    rests = _measure_rests()
    return float(np.median(rests)) + _count_bytes(cells) if rests and cells else None


def check_fits(cells: Sequence[Cell], n_processes: int, stated: int | None, of_machine: int | None) -> None:
    """InputError if so many processes take more memory than they may.

    What is predicted must fit into what a study states. Predictions may be wrong, so the machine's own memory bounds
    only what is needed at least.

    Args:
        stated: in the study [bytes].
        of_machine: the memory of the machine [bytes].
    """
    processes = f"{n_processes} process{'es' if n_processes > 1 else ''}"
    if stated is not None and n_processes * (peak := predict_memory(cells) or 0) > stated:
        raise InputError(
            f"this run needs about {n_processes * peak / 1e9:.1f} GB of memory for {processes}, and the study allows "
            f"{stated / 1e9:.1f} GB (memory)"
        )
    if of_machine is not None and (least := n_processes * _find_least_memory(cells)) > of_machine:
        raise InputError(
            f"this run needs at least {least / 1e9:.1f} GB of memory for {processes}, and this machine has "
            f"{of_machine / 1e9:.1f} GB"
        )


def _find_least_memory(cells: Sequence[Cell]) -> float:
    """Bytes that one process needs at least: the largest view, and the smallest rest that was ever measured."""
    return min(_measure_rests(), default=0.0) + _count_bytes(cells)


def _measure_rests() -> list[float]:
    """What runs took beside the pixels of their largest view [bytes]."""
    return [max(n - BYTES_A_PIXEL * p, 0.0) for _, p, _, n in _read().get("memory", ())]


def _count_bytes(cells: Sequence[Cell]) -> float:
    """What the pixels of the largest view take at least [bytes]."""
    return BYTES_A_PIXEL * max((count_pixels(cell.view) for cell in cells), default=0)


def _average_stages(known: Mapping[str, list[list[float]]], method: str) -> float:
    """The mean time of the stages of a cell of this method, or of any method if none was measured [s]."""
    every = (each for kind, found in known.items() if kind.startswith("stages ") for each in found)
    alike = known.get(f"stages {method}") or list(every)
    return sum(seconds for _, _, seconds, _ in alike) / max(1, len(alike))


def _predict_metrics(known: Mapping[str, list[list[float]]], cells: Sequence[Cell], kind: str) -> float:
    """The time of the metrics of all cells, from that of the same metrics, or of any if these were not measured [s]."""
    every = [each for other, found in known.items() if other.startswith("metrics ") for each in found]
    alike = [(s, p) for _, p, s, _ in known.get(kind) or every]
    views = Counter(count_pixels(cell.view) for cell in cells)
    return sum(n * _fit(alike, pixels) for pixels, n in views.items())


def _work(cell: Cell) -> float:
    budget = getattr(cell.method, find_budget_option(type(cell.method)) or "no budget", 1)
    return float(count_pixels(cell.view) * (budget if isinstance(budget, int | float) and budget > 1 else 1))


def _name_reference(cell: Cell, options: ReferenceOptions) -> str:
    return f"reference {cell.material.name} {options.method} {options.relative_error:g}"


def _name_metrics(metrics: Iterable[str]) -> str:
    return f"metrics {', '.join(sorted(metrics))}"


def _fit(measured: Sequence[tuple[float, ...]], *at: float) -> float:
    """The value at some variables: a constant and a multiple of each, of least relative squares; 0 if none is measured.

    Args:
        measured: values, each followed by its variables.
    """
    found = np.array([each for each in measured if each[0] > 0], float)
    if not len(found):
        return 0.0
    values, variables = found[:, 0], found[:, 1:]
    scale = np.maximum(variables.max(axis=0), 1)
    terms = np.column_stack([np.ones(len(values)), variables / scale])
    # The last rows keep the coefficients small where the measurements leave them open.
    small = 1e-4 / np.median(values) * np.eye(terms.shape[1])
    wanted = np.concatenate([np.ones(len(values)), np.zeros(len(small))])
    coefficients, _ = scipy.optimize.nnls(np.concatenate([terms / values[:, None], small]), wanted)
    return float(coefficients @ [1, *(np.array(at) / scale)])


def _read() -> dict[str, list[list[float]]]:
    found: dict[str, list[list[float]]] = defaultdict(list)
    with suppress(OSError, ValueError, KeyError, AttributeError):
        stated: Mapping[str, Any] = unseal(_file().read_bytes())["rates"]
        found |= {kind: [list(map(float, each)) for each in rows] for kind, rows in stated.items()}
    return found


def _file() -> Path:
    return cache_folder() / "rates.json"
