"""Run a study cell by cell. Each cell is stored on disk, so that a killed run continues where it stopped."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from uuid import uuid4

import pandas
import pyarrow.parquet  # noqa: F401  before plug-ins run: what they patch of it is put back (process_state)

from glossbench.atomic import interrupted_by_signals
from glossbench.envmap.lights.light import Light
from glossbench.errors import InputError
from glossbench.findings.verdicts import judge
from glossbench.memory import read_capacity
from glossbench.options import copy_of
from glossbench.plugins import find_origin
from glossbench.process.leftovers import end_children, find_children
from glossbench.process.state import is_foreign
from glossbench.process.surroundings import settled
from glossbench.provenance import collect_provenance
from glossbench.run.attempts import FOLDER as MARKS
from glossbench.run.batches import Settings, Task, plan
from glossbench.run.cell_keys import Identity
from glossbench.run.executor import Executor
from glossbench.run.folder import Folder
from glossbench.run.kernel_calls import bound_pairs, calls_of
from glossbench.run.kernel_choices import KernelChoices
from glossbench.run.manifest import make_entry
from glossbench.run.on_dask import check_address, run_on_dask
from glossbench.run.progress import Progress
from glossbench.run.rates import Spent, check_fits, measure_memory, remember
from glossbench.run.reservation import reserved
from glossbench.run.results import Results
from glossbench.run.study_lights import StudyLights
from glossbench.run.travel import Plugins
from glossbench.shading.kernels.backend import EAGER_RATE, choosing
from glossbench.study.cells import Cell, group_views
from glossbench.study.study import Study

PATIENCE = 1.0  # seconds per method, to find the kernels that a run calls; shorter runs do not look for them


@settled()
@interrupted_by_signals()
def run_study(
    study: Study,
    where: Path | str,
    *,
    use_cache: bool = True,
    rerun_failed: bool = False,
    fail_fast: bool = False,
    dask: str | None = None,
    progress: Progress | None = None,
) -> Results:
    """Run all cells of a study that are not on disk, judge its claims, and write all results to `where`.

    A cell that raises anything but KeyboardInterrupt has failed, and the run goes on. A cell that takes longer than the
    study's time limit has failed, too. If its code cannot be interrupted, this process ends with exit code 1, and the
    next run goes on with the next cell. A cell during which something else ended the process comes last in the next
    run.

    Args:
        where: a folder, or an address of fsspec, such as s3://bucket/results.
        use_cache: False computes all cells and references again.
        rerun_failed: try cells again that failed in an earlier run.
        fail_fast: raise what a cell raises, instead of storing its traceback as the result of the cell.
        dask: run the cells on workers of Dask: local:N for N processes of this machine, or the address of a scheduler.

    Raises:
        InputError: the device is missing, a file cannot be read, the store cannot be written, it holds files that
            would be lost, or another run writes to it. Nothing is written then.
        WriteError: a write failed, for example because the disk is full. Finished cells are kept.
    """
    if not study.has_device():
        raise InputError("the study states device: cuda, but this machine has none; write device: cpu")
    results = Results(where)
    n_local = 0 if dask is None else check_address(dask)
    if dask is not None and results.store.address.startswith("memory:"):
        raise InputError("the memory of one process is not a store for workers of Dask: choose a folder with -o")
    spent: list[Spent] = []
    progress = replace(progress or Progress(), spent=spent.append)
    cells = study.cells()
    again = rerun_failed or not use_cache
    executor = Executor(study, results, progress, use_cache, fail_fast)
    progress.doing("lights")
    own = _identify_own(cells, executor, again)
    kept = {i for i, each in own.items() if use_cache and not rerun_failed and executor.keys.is_stored(each.key)}
    new = [cell for i, cell in enumerate(cells) if i not in kept]
    is_here = dask is None or n_local > 0
    check_fits(new, max(1, n_local), study.memory, read_capacity() if is_here else None)
    _read_files(new, executor.lights)
    _check_own_study(study, results)
    results.create()
    started, source = datetime.now(UTC), executor.keys.code
    rows: dict[int, dict[str, Any]] = {}
    with _tidied(results):
        known = [own.get(i) or executor.keys.identify(cell, again) for i, cell in enumerate(cells)]
        entries = [
            make_entry(cell.make_record(key=each.key, seed=study.seed).to_row())
            for cell, each in zip(cells, known, strict=True)
        ]
        if fuller := results.begin(study.resolved(), entries, collect_provenance(study.device, started, source)):
            progress.note(fuller)
        progress.begin(len(cells))
        choices = KernelChoices(results.store, again=not use_cache)
        # What plug-ins call is not known before they run, guarded, in their own cells.
        own_cells = [cells[i] for i in own if i not in kept]
        if study.device == "cpu" and bound_pairs(own_cells, study.reference) > PATIENCE * EAGER_RATE:
            progress.doing("kernels")
            choices.plan(calls_of(own_cells, study.reference, PATIENCE), progress.doing)
        tasks = [Task(i, *each, rerun_failed) for i, each in enumerate(zip(cells, known, strict=True))]
        try:
            if dask is not None and not all(results.has_cell(each.key) and not again for each in known):
                # A cell whose key is not known has failed here already.
                groups = plan(task for task in tasks if task.known.error is None)
                settings = Settings.of(uuid4().hex, study, source, use_cache, fail_fast)
                rows = run_on_dask(dask, groups, settings, Plugins.of(study), results.store, progress)
                tasks = [task for task in tasks if task.known.error is not None]
            with choosing(choices.choose):
                tasks.sort(key=lambda task: task.known.ended)  # cells that ended the process come last
                executor.stages.expect(task.cell for task in tasks if task.place not in kept)
                for task in tasks:
                    rows[task.place] = executor.run(task.cell, task.known, rerun_failed)
                    progress.cell(rows[task.place])
        finally:
            choices.gather()
        if dask is None and spent:
            spent.append(measure_memory(cells))
        remember(spent)
        in_order = [rows[i] for i in range(len(cells))]
        results.finish(
            study.resolved(),
            judge(study.claims, pandas.DataFrame(in_order)),
            in_order,
            collect_provenance(study.device, started, source, {name: find_origin(name) for name in study.plugins}),
        )
    return results


@contextmanager
def _tidied(results: Results) -> Iterator[None]:
    """A block in which the store belongs to this run; then no process and no mark of it is left."""
    running = find_children()
    try:
        with reserved(results.store):
            yield
    finally:
        end_children(but=running)
        results.store.prune(MARKS)


def _identify_own(cells: Sequence[Cell], executor: Executor, again: bool) -> dict[int, Identity]:
    """By position, the identities of the cells without plug-ins. To find them, nothing is made or written."""
    foreign = executor.keys.sources.has_foreign
    return {i: executor.keys.identify(cell, again) for i, cell in enumerate(cells) if not foreign(cell)}


def _read_files(cells: Iterable[Cell], lights: StudyLights) -> None:
    """Read the files of cells, so that a file that cannot be read is found before anything is written.

    The files of plug-ins are not read here.
    """
    items = {id(item): item for cell in cells for item in (cell.light, cell.material, cell.view)}
    for item in items.values():
        if is_foreign(type(item)):
            continue
        if isinstance(item, Light):
            lights.get(item)
        else:
            copy_of(item).open_files()
    for candidate, views in group_views(cells):
        if not is_foreign(type(candidate.method)):
            method = copy_of(candidate.method)
            method.open_files()
            method.check_views(views)


def _check_own_study(study: Study, results: Results) -> None:
    """InputError if the results would replace the file of the study; a study.yaml that a run wrote may be run again."""
    if not isinstance(results.store, Folder):
        return
    path = results.store.root / "study.yaml"
    if path.exists() and study.name == "study" and study.folder.resolve() == results.store.root.resolve():
        if "study.yaml" not in results.disk.manifest.files or results.disk.is_altered("study.yaml"):
            raise InputError(
                f"{path} is the study itself, and its results would replace it: choose another folder with -o"
            )


def find_statuses(study: Study, where: Path | str) -> list[str]:
    """The status of each cell of a study in a store: done, skipped, failed or damaged; new if it is not there."""
    results = Results(where)
    if not results.store.list("cells/"):
        return ["new"] * len(study.cells())
    keys = Executor(study, results, Progress()).keys
    return [_find_status(results, keys.identify(cell).key) for cell in study.cells()]


def _find_status(results: Results, key: str) -> str:
    if not results.has_cell(key):
        return "new"
    return "damaged" if results.find_cell_damage(key) else str(results.cell(key)["status"])
