"""Run the cells of a study one after another: each is read from disk, or made, measured and written."""

import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import torch

from glossbench.columns import CellRecord
from glossbench.digests import compute_digest
from glossbench.envmap.cubemap import CubeMap
from glossbench.errors import MethodError, WriteError
from glossbench.process.state import ProcessRestorer, is_foreign
from glossbench.process.time_limit import time_limit
from glossbench.provenance import read_processor, read_version
from glossbench.run.attempts import Attempt, remove_marks
from glossbench.run.cell_items import CellParts
from glossbench.run.cell_keys import AbandonedCell, CellKeys, Identity
from glossbench.run.folder import Folder
from glossbench.run.manifest import make_entry
from glossbench.run.measuring import measure
from glossbench.run.rates import Spent, measure_cell, measure_metrics, measure_reference, measure_stages
from glossbench.run.results import Results
from glossbench.run.study_lights import ChangedInput, StudyLights
from glossbench.shading.image import Image
from glossbench.shading.method import Method
from glossbench.shading.outputs import check_notes, check_reason, check_view, escape_surrogates
from glossbench.shading.stage_cache import StageCache
from glossbench.study.cells import Cell, to_text
from glossbench.study.study import Study
from glossbench.truth.reference import Reference, compute_reference


@dataclass(frozen=True)
class Progress:
    """Functions that a run calls to report its progress; by default each does nothing.

    Attributes:
        begin: called at the start, with the number of cells.
        doing: called with the present work, in a few words.
        cell: called when a cell is done, with its row.
        note: called with one line about something unusual: a damaged file is made again, or the folder keeps a study
            with more cells.
        spent: called with what a cell or a reference took, for predictions.
    """

    begin: Callable[[int], None] = lambda n: None
    doing: Callable[[str], None] = lambda text: None
    cell: Callable[[dict[str, Any]], None] = lambda row: None
    note: Callable[[str], None] = lambda text: None
    spent: Callable[[Spent], None] = lambda spent: None


class Executor:
    """Runs one cell after another. It keeps stages and the reference for the next cells, which often share them."""

    def __init__(
        self, study: Study, results: Results, progress: Progress, use_cache: bool = True, fail_fast: bool = False
    ) -> None:
        self.study, self.results, self.progress = study, results, progress
        self.use_cache, self.fail_fast = use_cache, fail_fast
        self.lights = StudyLights(study.device, results.store)
        self.keys = CellKeys(
            study, results, self.lights, lambda cell, key: self._guarded(cell, self._begin_record(cell, key))
        )
        self._reference_seconds = 0.0  # that the cell which runs now has spent on its reference
        self._stage_seconds = 0.0  # on its stages
        self._metric_seconds = 0.0  # and on its metrics
        self._whole: dict[str, bool] = {}  # key of a reference -> whether it is on disk, undamaged
        self._truth: tuple[str, Reference] | None = None
        self._stages_light = ""
        self._coming: dict[int, tuple[Cell, str]] | None = None  # by id: cells to compute, the keys of their lights
        self._forget()

    def expect(self, cells: Iterable[Cell]) -> None:
        """These cells will be computed. Large stages that none of them needs are then dropped early."""
        self._coming = {id(cell): (cell, to_text(cell.light)) for cell in cells}

    def run(self, cell: Cell, known: Identity, rerun_failed: bool) -> dict[str, Any]:
        """The row of a cell: read from disk, or made and written.

        Raises:
            ChangedInput: a file has changed since the run began.
            WriteError: the store of the results cannot be written.
        """
        self.lights.learn(cell.light, known.light_key)
        record = self._begin_record(cell, known.key, known.reference_key)
        stored = self._read_stored(cell, record)
        if stored is not None and not (rerun_failed and stored["status"] == "failed"):
            return stored
        attempt = Attempt(self.results.store, known.spelled, known.tries)
        try:
            if known.error is not None:
                raise known.error
            if attempt.is_hopeless:
                raise AbandonedCell(f"{attempt.told}; --rerun-failed tries again")
            began = time.perf_counter()
            self._reference_seconds = self._stage_seconds = self._metric_seconds = 0.0
            attempt.begin()
            with self._guarded(cell, record) if self.keys.sources.has_foreign(cell) else nullcontext():
                made = replace(CellParts.from_cell(cell), keys=known.keys)
                made.check_unchanged(cell)
            record, image, half_vectors = self._execute(cell, record, made)
        except BaseException as error:
            return self._write_failure(record, error)
        finally:
            attempt.end()
            if self._coming is not None:
                self._coming.pop(id(cell), None)
        self.results.remove_cell(known.spelled)
        row = record.to_row()
        n_bytes = self.results.add_cell(row, image, half_vectors)
        if record.status == "done":
            apart = self._reference_seconds + self._stage_seconds + self._metric_seconds
            self.progress.spent(measure_cell(cell, time.perf_counter() - began - apart, n_bytes))
            self.progress.spent(measure_stages(cell, self._stage_seconds))
            self.progress.spent(measure_metrics(cell, self.study.measured, self._metric_seconds))
        return row

    def trust(self, reference_key: str) -> None:
        """Take a reference as whole, because this run has just made it."""
        self._whole[reference_key] = True

    def _write_without_image(self, record: CellRecord) -> dict[str, Any]:
        row = record.to_row()
        self.results.add_cell(row, None, None)
        return row

    def _write_failure(self, record: CellRecord, error: BaseException) -> dict[str, Any]:
        """Write and return the row of a cell that raised; some exceptions end the run instead."""
        self._forget()
        if isinstance(error, WriteError) and f"{error.path}".startswith(f"{self.results.store.address}/"):
            raise error  # the store is at fault, not the cell
        if isinstance(error, KeyboardInterrupt | ChangedInput) or (self.fail_fast and isinstance(error, Exception)):
            raise error
        if self.fail_fast:
            raise MethodError(f"{record.method} raised {error!r}") from error
        told = str(error) if isinstance(error, AbandonedCell) else "".join(traceback.format_exception(error))
        return self._write_without_image(_make_failure(record, told))

    def _execute(self, cell: Cell, record: CellRecord, made: CellParts) -> tuple[CellRecord, Image | None, Any]:
        """(record of a cell with all measurements, its image, its pattern)."""
        material, view, method = made.material, made.view, made.method
        with self._guarded(cell, record) if self.keys.sources.has_foreign(cell) else nullcontext():
            reason = check_reason(method.name, method.supports(material, view.scene()))
            if reason is not None:
                return replace(record, status="skipped", reason=reason), None, None
            if is_foreign(type(view)):
                check_view(view)
            light = self.lights.get(cell.light)
        if self._stages_light != to_text(cell.light):  # stages of another light are not needed any more
            self._stages, self._stages_light = self._new_stages(), to_text(cell.light)
        truth = self._provide_reference(cell, record, light, made)
        self.progress.doing(cell.method.name)
        stage_seconds = self._stages.seconds
        with self._guarded(cell, record):
            # What cells share, apart from the light and the stages; a plug-in may write into it unnoticed.
            shared = (truth, view.scene(), material.reflectance()) if self.keys.sources.has_foreign(cell) else ()
            before = compute_digest(*shared)
            record, image, half_vectors, self._metric_seconds = measure(
                record, method, cell.tune, self.study.measured, self._stages, light, material, view, truth
            )
            self._stage_seconds = self._stages.seconds - stage_seconds
            notes = [note for each in (material, view, method) for note in check_notes(each.name, each.notes())]
            notes = [*self.lights.notes(cell.light), *notes]
            made.check_unchanged(cell)
            if not self.lights.is_intact():
                raise MethodError(f"{method.name} writes into the light, which other cells read")
            if compute_digest(*shared) != before:
                raise MethodError(
                    f"{method.name} writes into the scene, the material or the reference, which other cells read"
                )
        record = replace(
            record, notes=notes, reference_noise=truth.noise, reference_peak_noise=float(truth.standard_error.max()),
            reference_target=self.study.reference.relative_error * truth.mean, reference_mean=truth.mean,
            reference_samples=truth.n_samples, reference_method=truth.method,
            reference_seconds=self.results.reference_numbers(record.reference_key)["seconds"],
        )  # fmt: skip
        return record, image, half_vectors

    def _provide_reference(self, cell: Cell, record: CellRecord, light: CubeMap, made: CellParts) -> Reference:
        """The reference as read from disk, in float32, so that a resumed run compares with the same numbers."""
        key = record.reference_key
        if self._truth is not None and self._truth[0] == key:
            return self._truth[1]
        if not self._has_reference(key):
            options = self.study.reference
            started = time.perf_counter()
            with ExitStack() as limits:

                def begin_round() -> None:
                    limits.close()  # the limit is per round, and only for plug-ins: a reference may take long
                    if self.keys.sources.has_foreign_inputs(cell):
                        limits.enter_context(self._guarded(cell, record))

                def tell(noise: float, n_samples: int) -> None:
                    target = f"{100 * options.relative_error:.2g} %"
                    self.progress.doing(
                        f"reference: noise {100 * noise:.2g} % (target {target}), {n_samples} samples per pixel"
                    )
                    begin_round()

                self.progress.doing("reference")
                begin_round()
                # Only a folder keeps the partial sums of a reference.
                store = self.results.store
                checkpoint = store.root / "references" if self.use_cache and isinstance(store, Folder) else None
                truth = compute_reference(
                    light, made.material, made.view, options.relative_error, options.max_samples, options.seed, tell,
                    checkpoint, options.method,
                )  # fmt: skip
                made.check_unchanged(cell)
            if not torch.isfinite(truth.radiance).all():
                raise MethodError(f"the reference of {cell.material.name} is not finite everywhere")
            n_bytes = self.results.add_reference(key, truth, time.perf_counter() - started)
            self._reference_seconds = time.perf_counter() - started
            self.progress.spent(measure_reference(cell, options, self._reference_seconds, n_bytes))
            self._whole[key] = True
        stored = Reference(
            torch.from_numpy(self.results.reference(key).astype(np.float64)),
            torch.from_numpy(self.results.standard_error(key).astype(np.float64)),
            torch.from_numpy(self.results.mask(key)),
            int(self.results.reference_numbers(key)["n_samples"]),
            torch.from_numpy(self.results.deviates(key)),
            str(self.results.reference_numbers(key)["method"]),
        )
        self._truth = (key, stored)
        return stored

    def _read_stored(self, cell: Cell, record: CellRecord) -> dict[str, Any] | None:
        """The row of a cell on disk if all its files are undamaged, else None. Makes its reference again if needed."""
        key = record.key
        if not (self.use_cache and self.results.has_cell(key)):
            return None
        if damage := self.results.find_cell_damage(key):
            self.progress.note(f"{damage}: this cell is computed again")
            return None
        stored = self.results.cell(key)
        if stored["status"] == "done" and not self._has_reference(record.reference_key):
            self._provide_reference(cell, record, self.lights.get(cell.light), CellParts.from_cell(cell))
        # The key does not include the name of an image file, nor a seed that nothing used.
        return stored | make_entry(record.to_row())

    def _has_reference(self, key: str) -> bool:
        """Whether a reference is on disk, undamaged; checked once per run."""
        if key not in self._whole:
            is_there = self.use_cache and self.results.has_reference(key)
            damage = self.results.find_reference_damage(key) if is_there else ""
            if damage:
                self.progress.note(f"{damage}: this reference is computed again")
            self._whole[key] = is_there and not damage
        return self._whole[key]

    @contextmanager
    def _guarded(self, cell: Cell, record: CellRecord) -> Iterator[None]:
        """A context with the time limit. If plug-ins take part, it restores the state of the process at its end."""
        limit = time_limit(self.study.time_limit, partial(self._give_up, record, threading.get_ident()))
        with ProcessRestorer("a plug-in") if self.keys.sources.has_foreign(cell) else nullcontext(), limit:
            yield

    def _give_up(self, record: CellRecord, thread: int) -> None:
        """Write the row of a cell that cannot be interrupted, with its stack, before the process ends."""
        reason = f"took more than the time limit of {self.study.time_limit:g} s, and could not be interrupted"
        stack = "".join(traceback.format_stack(sys._current_frames()[thread]))
        self._write_without_image(_make_failure(record, f"{stack}TimeoutError: {reason}\n"))
        remove_marks(self.results.store)
        print(f"error: {record.method} {reason}; the same command goes on with the next cell", file=sys.__stderr__)

    def _begin_record(self, cell: Cell, key: str, reference_key: str = "") -> CellRecord:
        """The record of a cell before anything is measured."""
        return cell.make_record(
            key=key, reference_key=reference_key, light_key=self.lights.known_key(cell.light),
            metrics=dict.fromkeys(self.study.measured, float("nan")), code=self.keys.code[:20],
            version=read_version(), torch=str(torch.__version__), device=self.study.device, processor=read_processor(),
            seed=self.study.seed,
        )  # fmt: skip

    def _new_stages(self) -> StageCache:
        return StageCache(self.progress.doing, later=self._list_methods)

    def _list_methods(self) -> list[Method] | None:
        """The different methods of the cells of this light that are not done yet.

        None if these are not known, or if it is not known what they read: the options of a method that is tuned, or
        those of a plug-in, whose code may fail.
        """
        if self._coming is None:
            return None
        cells = [cell for cell, light in self._coming.values() if light == self._stages_light]
        if any(cell.tune or is_foreign(type(cell.method)) for cell in cells):
            return None
        return list({to_text(cell.method): cell.method for cell in cells}.values())

    def _forget(self) -> None:
        """Drop everything that cells share, because a plug-in may have damaged it."""
        self._stages, self._stages_light = self._new_stages(), ""
        self._truth = None
        self.lights.forget()
        for module in [
            m for name, m in sys.modules.items() if name.startswith(("glossbench.scene", "glossbench.brdf"))
        ]:
            for member in vars(module).values():
                if callable(getattr(member, "cache_clear", None)):
                    member.cache_clear()


def _make_failure(record: CellRecord, reason: str) -> CellRecord:
    """The record of a cell that failed; lone surrogates, which the name of a file may contain, are escaped."""
    return replace(record, status="failed", reason=escape_surrogates(reason))
