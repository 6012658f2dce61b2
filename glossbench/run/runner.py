"""Run a study cell by cell. Each cell is stored on disk, so that a killed run continues where it stopped."""

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas
import pyarrow.parquet  # noqa: F401  before plug-ins run: what they patch of it is put back (process_state)

from glossbench.atomic import interrupted_by_signals
from glossbench.envmap.lights.light import Light
from glossbench.errors import InputError
from glossbench.findings.verdicts import judge
from glossbench.options import copy_of
from glossbench.plugins import find_origin
from glossbench.process.leftovers import end_children, find_children
from glossbench.process.state import is_foreign
from glossbench.process.surroundings import settled
from glossbench.provenance import collect_provenance
from glossbench.run.cell_keys import Identity
from glossbench.run.executor import Executor, Progress
from glossbench.run.kernel_calls import bound_pairs, calls_of
from glossbench.run.kernel_choices import KernelChoices
from glossbench.run.manifest import make_entry
from glossbench.run.results import Results
from glossbench.run.study_lights import StudyLights
from glossbench.shading.kernels.backend import EAGER_RATE, choosing
from glossbench.study.cells import Cell, group_views
from glossbench.study.study import Study

PATIENCE = 1.0  # seconds per method, to find the kernels that a run calls; shorter runs do not look for them


@settled()
@interrupted_by_signals()
def run_study(
    study: Study,
    folder: Path,
    *,
    use_cache: bool = True,
    rerun_failed: bool = False,
    fail_fast: bool = False,
    progress: Progress | None = None,
) -> Results:
    """Run all cells of a study that are not on disk, judge its claims, and write all results into `folder`.

    A cell that raises anything but KeyboardInterrupt has failed, and the run goes on. A cell that takes longer than the
    study's time limit has failed, too. If its code cannot be interrupted, this process ends with exit code 1, and the
    next run goes on with the next cell. A cell during which something else ended the process comes last in the next
    run.

    Args:
        use_cache: False computes all cells and references again.
        rerun_failed: try cells again that failed in an earlier run.
        fail_fast: raise what a cell raises, instead of storing its traceback as the result of the cell.

    Raises:
        InputError: the device is missing, a file cannot be read, the folder cannot be written, or it holds files that
            would be lost. Nothing is written then.
        WriteError: a write failed, for example because the disk is full. Finished cells are kept.
    """
    if not study.has_device():
        raise InputError("the study states device: cuda, but this machine has none; write device: cpu")
    progress = progress or Progress()
    cells = study.cells()
    results = Results(folder)
    executor = Executor(study, results, progress, use_cache, fail_fast)
    progress.doing("lights")
    own = _identify_own(cells, executor, rerun_failed or not use_cache)
    kept = {i for i, each in own.items() if use_cache and not rerun_failed and results.has_cell(each.key)}
    _read_files([cell for i, cell in enumerate(cells) if i not in kept], executor.lights)
    _check_own_study(study, results)
    results.create()
    started, source = datetime.now(UTC), executor.keys.code
    rows: dict[int, dict[str, Any]] = {}
    running = find_children()
    try:
        again = rerun_failed or not use_cache
        known = [own.get(i) or executor.keys.identify(cell, again) for i, cell in enumerate(cells)]
        entries = [
            make_entry(cell.make_record(key=each.key, seed=study.seed).to_row())
            for cell, each in zip(cells, known, strict=True)
        ]
        if fuller := results.begin(study.resolved(), entries, collect_provenance(study.device, started, source)):
            progress.note(fuller)
        progress.begin(len(cells))
        choices = KernelChoices(results.disk, again=not use_cache)
        # What plug-ins call is not known before they run, guarded, in their own cells.
        own_cells = [cells[i] for i in own if i not in kept]
        if study.device == "cpu" and bound_pairs(own_cells, study.reference) > PATIENCE * EAGER_RATE:
            progress.doing("kernels")
            choices.plan(calls_of(own_cells, study.reference, PATIENCE), progress.doing)
        with choosing(choices.choose):
            for i in sorted(range(len(cells)), key=lambda i: known[i].ended):  # cells that ended the process come last
                rows[i] = executor.run(cells[i], known[i], rerun_failed)
                progress.cell(rows[i])
    finally:
        end_children(but=running)
    in_order = [rows[i] for i in range(len(cells))]
    results.finish(
        study.resolved(),
        judge(study.claims, pandas.DataFrame(in_order)),
        in_order,
        collect_provenance(study.device, started, source, {name: find_origin(name) for name in study.plugins}),
    )
    return results


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
    path = results.folder / "study.yaml"
    if path.exists() and study.name == "study" and study.folder.resolve() == results.folder.resolve():
        if "study.yaml" not in results.disk.manifest.files or results.disk.is_altered("study.yaml"):
            raise InputError(
                f"{path} is the study itself, and its results would replace it: choose another folder with -o"
            )


def find_statuses(study: Study, folder: Path) -> list[str]:
    """The status of each cell of a study in a folder: done, skipped, failed or damaged; new if it is not there."""
    results = Results(folder)
    if not any((folder / "cells").glob("*.json")):
        return ["new"] * len(study.cells())
    keys = Executor(study, results, Progress()).keys
    return [_find_status(results, keys.identify(cell).key) for cell in study.cells()]


def _find_status(results: Results, key: str) -> str:
    if not results.has_cell(key):
        return "new"
    return "damaged" if results.find_cell_damage(key) else str(results.cell(key)["status"])
