"""Run the cells of a study one after another: each is read from disk, or made, measured and written."""

import sys
import threading
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from typing import Any

import torch

from glossbench.columns import CellRecord
from glossbench.digests import compute_digest
from glossbench.errors import MethodError, WriteError
from glossbench.process.state import ProcessRestorer, is_foreign
from glossbench.process.time_limit import time_limit
from glossbench.provenance import read_processor, read_version
from glossbench.run.attempts import Attempt, remove_marks
from glossbench.run.cell_items import CellParts
from glossbench.run.cell_keys import AbandonedCell, CellKeys, Identity
from glossbench.run.light_stages import LightStages
from glossbench.run.manifest import make_entry
from glossbench.run.measuring import measure
from glossbench.run.progress import Progress
from glossbench.run.rates import measure_cell, measure_metrics, measure_stages
from glossbench.run.references import References
from glossbench.run.results import Results
from glossbench.run.study_lights import ChangedInput, StudyLights
from glossbench.shading.image import Image
from glossbench.shading.outputs import check_notes, check_reason, check_view, escape_surrogates
from glossbench.study.cells import Cell
from glossbench.study.study import Study


class Executor:
    """Runs one cell after another. It keeps light, stages and reference for the next cells, which often share them."""

    def __init__(
        self, study: Study, results: Results, progress: Progress, use_cache: bool = True, fail_fast: bool = False
    ) -> None:
        self.study, self.results, self.progress = study, results, progress
        self.use_cache, self.fail_fast = use_cache, fail_fast
        self.lights = StudyLights(study.device, results.store)
        self.keys = CellKeys(
            study, results, self.lights, lambda cell, key: self._guarded(cell, self._begin_record(cell, key))
        )
        self.references = References(study, results, progress, use_cache, self.keys.sources, self._guarded)
        self.stages = LightStages(progress.doing)
        self._stage_seconds = 0.0  # that the cell which runs now has spent on its stages
        self._metric_seconds = 0.0  # and on its metrics

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
            reference_seconds = self.references.seconds
            self._stage_seconds = self._metric_seconds = 0.0
            attempt.begin()
            with self._guarded(cell, record) if self.keys.sources.has_foreign(cell) else nullcontext():
                made = replace(CellParts.from_cell(cell), keys=known.keys)
                made.check_unchanged(cell)
            record, image, half_vectors = self._execute(cell, record, made)
        except BaseException as error:
            return self._write_failure(record, error)
        finally:
            attempt.end()
            self.stages.finish(cell)
        self.results.remove_cell(known.spelled)
        row = record.to_row()
        n_bytes = self.results.add_cell(row, image, half_vectors)
        if record.status == "done":
            reference_seconds = self.references.seconds - reference_seconds
            apart = reference_seconds + self._stage_seconds + self._metric_seconds
            self.progress.spent(measure_cell(cell, time.perf_counter() - began - apart, n_bytes))
            self.progress.spent(measure_stages(cell, self._stage_seconds))
            self.progress.spent(measure_metrics(cell, self.study.measured, self._metric_seconds))
        return row

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
        stages = self.stages.of(cell)
        truth = self.references.provide(cell, record, light, made)
        self.progress.doing(cell.method.name)
        stage_seconds = stages.seconds
        with self._guarded(cell, record):
            # What cells share, apart from the light and the stages; a plug-in may write into it unnoticed.
            shared = (truth, view.scene(), material.reflectance()) if self.keys.sources.has_foreign(cell) else ()
            before = compute_digest(*shared)
            record, image, half_vectors, self._metric_seconds = measure(
                record, method, cell.tune, self.study.measured, stages, light, material, view, truth
            )
            self._stage_seconds = stages.seconds - stage_seconds
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

    def _read_stored(self, cell: Cell, record: CellRecord) -> dict[str, Any] | None:
        """The row of a cell on disk if all its files are undamaged, else None. Makes its reference again if needed."""
        key = record.key
        if not (self.use_cache and self.results.has_cell(key)):
            return None
        if damage := self.results.find_cell_damage(key):
            self.progress.note(f"{damage}: this cell is computed again")
            return None
        stored = self.results.cell(key)
        if stored["status"] == "done" and not self.references.has(record.reference_key):
            self.references.provide(cell, record, self.lights.get(cell.light), CellParts.from_cell(cell))
        # The key does not include the name of an image file, nor a seed that nothing used.
        return stored | make_entry(record.to_row())

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

    def _forget(self) -> None:
        """Drop everything that cells share, because a plug-in may have damaged it."""
        self.stages.forget()
        self.references.forget()
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
