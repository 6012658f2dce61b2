"""Batches: the cells of a study in portions that any process can run, here or on another machine."""

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from glossbench.errors import InputError
from glossbench.process.surroundings import settled
from glossbench.run.cell_keys import Identity
from glossbench.run.executor import Executor
from glossbench.run.kernel_choices import KernelChoices
from glossbench.run.progress import Progress
from glossbench.run.rates import measure_memory
from glossbench.run.results import Results
from glossbench.run.store import Store
from glossbench.shading.kernels.backend import choosing
from glossbench.study.cells import Cell, to_text
from glossbench.study.study import Study


@dataclass(frozen=True)
class Task:
    """One cell of a run.

    Attributes:
        place: its place among the cells of the study.
        known: its keys, which are computed once, where the run began.
        rerun_failed: try it again if it has failed before.
    """

    place: int
    cell: Cell
    known: Identity
    rerun_failed: bool = False


@dataclass(frozen=True)
class Settings:
    """What all batches of a run share.

    Attributes:
        run: identifies the run; what a process keeps from one batch to the next is of one run.
        study: the study without its items, which the tasks hold.
        code: hash of the code that measures cells, which must be the same on all machines.
        folder: the working folder of the run, from which items name their files.
    """

    run: str
    study: Study
    code: str
    folder: Path
    use_cache: bool = True
    fail_fast: bool = False

    @staticmethod
    def of(run: str, study: Study, code: str, use_cache: bool, fail_fast: bool) -> "Settings":
        """The settings of a run that begins here."""
        bare = replace(study, lights=(), materials=(), views=(), methods=(), claims=(), exclude=())
        return Settings(run, bare, code, Path.cwd(), use_cache, fail_fast)


@dataclass(frozen=True)
class Batch:
    """Cells of one light, material and view, which one process runs one after another.

    Attributes:
        is_first: stop after the first cell that is done: the reference, on which the other cells depend, is there then.
        has_reference: the reference was made in this run.
    """

    settings: Settings
    tasks: tuple[Task, ...]
    is_first: bool = False
    has_reference: bool = False


Row = dict[str, Any]
Kept = dict[str, Executor]  # by run


def plan(tasks: Iterable[Task]) -> list[list[Task]]:
    """The tasks by light, material and view: lights stay together, and what ended a process before comes last."""
    groups: dict[tuple[Any, ...], list[Task]] = {}
    for task in sorted(tasks, key=lambda task: task.known.ended):
        items = (task.cell.light, task.cell.material, task.cell.view)
        groups.setdefault((task.known.ended, *map(to_text, items)), []).append(task)
    return list(groups.values())


def execute(
    batch: Batch,
    store: Store,
    progress: Progress = Progress(),  # noqa: B008  it is frozen
    tell: Callable[[Task, Row], None] = lambda task, row: None,
    kept: Kept | None = None,
) -> list[Row]:
    """Run the cells of a batch, and return their rows in the order of its tasks.

    Args:
        tell: called with each cell that is done, and its row.
        kept: of this process: light, stages and reference of its last batch, which often serve the next one.

    Raises:
        InputError: this machine has another version of glossbench.
    """
    settings = batch.settings
    kept = {} if kept is None else kept
    if settings.run not in kept:
        kept.clear()
        kept[settings.run] = _begin(settings, store, progress)
    executor = kept[settings.run]
    rows = []
    with settled(), choosing(KernelChoices(store).choose):
        for task in batch.tasks:
            if batch.has_reference:
                executor.references.trust(task.known.reference_key)
            rows.append(executor.run(task.cell, task.known, task.rerun_failed))
            tell(task, rows[-1])
            if batch.is_first and rows[-1]["status"] == "done":
                break
    progress.spent(measure_memory(task.cell for task in batch.tasks))
    return rows


def _begin(settings: Settings, store: Store, progress: Progress) -> Executor:
    if settings.folder.is_dir():
        os.chdir(settings.folder)
    executor = Executor(settings.study, Results(store), progress, settings.use_cache, settings.fail_fast)
    if executor.keys.code != settings.code:
        raise InputError("a worker has another version of glossbench than the machine on which the run began")
    return executor
