"""Running a study: cell after cell, each remembered on disk, so that a killed run goes on from there."""

import json
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import torch

from glossbench.attempts import Attempt, remove_marks
from glossbench.cell_items import Made, Sources
from glossbench.claims import PLACES
from glossbench.digests import digest_of
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.lights import LIGHTS
from glossbench.errors import InputError, MethodError
from glossbench.ground_truth import Reference, compute_reference
from glossbench.items import Cell, Item
from glossbench.leftovers import children, end_children
from glossbench.measuring import measure
from glossbench.plugin_outputs import check_view, notes_of, reason_of
from glossbench.process_state import Restored, is_foreign
from glossbench.provenance import numerics_hash, provenance
from glossbench.results import Results, key_of
from glossbench.row_start import begin_row, failure
from glossbench.shading import Image
from glossbench.stage_cache import StageCache
from glossbench.study import Study
from glossbench.study_lights import Changed, StudyLights
from glossbench.time_limit import time_limit
from glossbench.verdicts import judge


@dataclass(frozen=True)
class Progress:
    """What a run tells while it goes on; each is a function that may do nothing.

    Attributes:
        begin: the number of cells.
        doing: what is under way, in a few words.
        cell: a cell is done, with its row.
    """

    begin: Callable[[int], None] = lambda n: None
    doing: Callable[[str], None] = lambda text: None
    cell: Callable[[dict[str, Any]], None] = lambda row: None


def run_study(
    study: Study,
    folder: Path,
    *,
    use_cache: bool = True,
    rerun_failed: bool = False,
    fail_fast: bool = False,
    progress: Progress | None = None,
) -> Results:
    """Execute all cells of a study that are not on disk, judge its claims, and leave all in `folder`.

    A cell that raises anything but KeyboardInterrupt has failed, and the run goes on. So has one that takes longer
    than the study's time limit; where its code cannot be interrupted this process ends with exit code 1, and the
    next run goes on with the next cell.

    Args:
        use_cache: False computes cells and references anew.
        rerun_failed: try again cells that failed in an earlier run.
        fail_fast: raise what a cell raises, instead of keeping its traceback as the cell's result.

    Raises:
        InputError: no such device, a light cannot be read, or the folder cannot be written; then nothing is.
    """
    if study.device == "cuda" and not torch.cuda.is_available():
        raise InputError("the study wants device: cuda, but there is none here; say device: cpu")
    progress = progress or Progress()
    cells = study.cells()
    results = Results(folder)
    lights = StudyLights(study.device, folder / "begun")
    progress.doing("lights")
    for item in study.lights:  # an image that cannot be read must stop the run before it writes
        if not is_foreign(LIGHTS.get(item.name)):
            lights.get(item)
    results.create()
    started = datetime.now(UTC)
    progress.begin(len(cells))
    executor = _Executor(study, results, lights, progress, use_cache, fail_fast)
    rows, running = [], children()
    try:
        for cell in cells:
            row = executor.run(cell, rerun_failed)
            rows.append(row)
            progress.cell(row)
    finally:
        end_children(but=running)
    results.finish(
        study.resolved(), judge(study.claims, pandas.DataFrame(rows)), rows, provenance(study.device, started)
    )
    return results


class _Executor:
    """Runs one cell after another; stages and the reference, which neighbours share, it keeps meanwhile."""

    def __init__(
        self, study: Study, results: Results, lights: StudyLights, progress: Progress, use_cache: bool, fail_fast: bool
    ) -> None:  # fmt: skip
        self.study, self.results, self.lights, self.progress = study, results, lights, progress
        self.use_cache, self.fail_fast = use_cache, fail_fast
        self._code = numerics_hash()
        self._sources = Sources(study.metrics)
        self._fresh: set[str] = set()  # keys of references made by this run
        self._truth: tuple[str, Reference] | None = None
        self._stages_light: Item | None = None
        self._forget()

    def run(self, cell: Cell, rerun_failed: bool) -> dict[str, Any]:
        """The row of a cell: read from disk, or made and written."""
        sources, is_foreign_cell = self._sources.of(cell), self._sources.any_foreign(cell)
        common = [self._code, self.study.reference.model_dump(), self.study.device]
        items = {kind: [getattr(cell, kind).name, getattr(cell, kind).spelled()] for kind in (*PLACES, "method")}
        # Under this is kept what fails before the cell's own key is known, or ends the process.
        spelled = key_of([common, sources, items])
        row = self._row(cell, spelled, "")
        attempt = Attempt(self.results.folder / "begun", spelled)
        if (stored := self._stored(row, rerun_failed)) is not None:
            return stored
        try:
            if attempt.is_hopeless and not self.results.has_cell(spelled):
                return self._written(row | failure(f"{attempt.told}; --rerun-failed tries again"))
            try:
                with self._guarded(cell, row) if is_foreign_cell else nullcontext():
                    if is_foreign_cell:
                        attempt.begin()
                    made = Made.of(cell)
                    light_key = self.lights.key(cell.light) or self.lights.get(cell.light).key
            except BaseException as error:
                if isinstance(error, InputError) and not is_foreign_cell:  # a file that was there before
                    raise
                return self._failed(row, error)
            stated = ([*items[k], key] for k, key in zip(("material", "view", "method"), made.keys, strict=True))
            material, view, method = stated
            reference_key = key_of([common, light_key, *(sources[place] for place in PLACES), material, view])
            row = self._row(cell, key_of([reference_key, method, sources["method"], sources["metrics"]]), reference_key)
            if (stored := self._stored(row, rerun_failed)) is not None:
                return stored
            attempt.begin()
            try:
                columns, image, half_vectors = self._execute(cell, row, made)
            except BaseException as error:
                return self._failed(row, error)
            self.results.remove_cell(spelled)
            return self._written(row | columns, image, half_vectors)
        finally:
            attempt.end()

    def _written(self, row: dict[str, Any], image: Image | None = None, half_vectors: Any = None) -> dict[str, Any]:
        self.results.add_cell(row, image, half_vectors)
        return row

    def _failed(self, row: dict[str, Any], error: BaseException) -> dict[str, Any]:
        """The row of a cell that raised, written; some of what is raised ends the run."""
        self._forget()
        if isinstance(error, KeyboardInterrupt | Changed) or (self.fail_fast and isinstance(error, Exception)):
            raise error
        if self.fail_fast:
            raise MethodError(f"{row['method']} raised {error!r}") from error
        return self._written(row | failure("".join(traceback.format_exception(error))))

    def _execute(self, cell: Cell, row: dict[str, Any], made: Made) -> tuple[dict[str, Any], Image | None, Any]:
        """What is new in the row of a cell, its image and its pattern."""
        material, view, method = made.material, made.view, made.method
        with self._guarded(cell, row):
            reason = reason_of(method.name, method.supports(material, view.scene()))
            if reason is not None:
                return {"status": "skipped", "reason": reason}, None, None
            if is_foreign(type(view)):
                check_view(view)
            light = self.lights.get(cell.light)
        if self._stages_light != cell.light:  # stages of another light are of no use any more
            self._stages, self._stages_light = StageCache(self.progress.doing), cell.light
        truth = self._reference(cell, row, light, made)
        self.progress.doing(cell.method.name)
        with self._guarded(cell, row):
            # What cells share beside the light and the stages; a plug-in may write into it unseen.
            shared = (truth, view.scene(), material.reflectance()) if self._sources.any_foreign(cell) else ()
            before = digest_of(*shared)
            columns, image, half_vectors = measure(
                method, cell.method.tune, self.study.metrics, self._stages, light, material, view, truth
            )
            notes = [note for each in (material, view, method) for note in notes_of(each.name, each.notes())]
            made.check_unchanged()
            if not self.lights.is_intact():
                raise MethodError(f"{method.name} writes into the light, which others read")
            if digest_of(*shared) != before:
                raise MethodError(
                    f"{method.name} writes into the scene, the material or the reference, which others read"
                )
        columns |= {
            "notes": json.dumps(notes),
            "reference_noise": truth.noise,
            "reference_peak_noise": float(truth.standard_error.max()),
            "reference_target": self.study.reference.relative_error * truth.mean,
            "reference_mean": truth.mean,
            "reference_samples": truth.n_samples,
            "at_noise_floor": bool(columns["rms"] < 2 * truth.noise),
            "reference_seconds": self.results.reference_numbers(row["reference_key"])["seconds"],
        }
        return columns, image, half_vectors

    def _reference(self, cell: Cell, row: dict[str, Any], light: CubeMap, made: Made) -> Reference:
        """The truth as it is on disk: float32, so that a resumed run compares with the same numbers."""
        key = row["reference_key"]
        if self._truth is not None and self._truth[0] == key:
            return self._truth[1]
        if not self.results.has_reference(key) or not (self.use_cache or key in self._fresh):
            options = self.study.reference
            started = time.perf_counter()
            with ExitStack() as limits:

                def begin_round() -> None:
                    limits.close()  # the limit is for each round, and plug-ins alone: a reference may take long
                    if self._sources.foreign_inputs(cell):
                        limits.enter_context(self._guarded(cell, row))

                def tell(noise: float, n_samples: int) -> None:
                    target = f"{100 * options.relative_error:.2g} %"
                    self.progress.doing(
                        f"reference: noise {100 * noise:.2g} % (target {target}), {n_samples} samples a pixel"
                    )
                    begin_round()

                self.progress.doing("reference")
                begin_round()
                truth = compute_reference(
                    light, made.material, made.view, options.relative_error, options.max_samples, options.seed, tell,
                    self.results.folder / "references" if self.use_cache else None,
                )  # fmt: skip
                made.check_unchanged()
            if not torch.isfinite(truth.radiance).all():
                raise MethodError(f"the reference of {cell.material.name} is not finite everywhere")
            self.results.add_reference(key, truth, time.perf_counter() - started)
            self._fresh.add(key)
        stored = Reference(
            torch.from_numpy(self.results.reference(key).astype(np.float64)),
            torch.from_numpy(self.results.standard_error(key).astype(np.float64)),
            torch.from_numpy(self.results.mask(key)),
            int(self.results.reference_numbers(key)["n_samples"]),
        )
        self._truth = (key, stored)
        return stored

    def _stored(self, row: dict[str, Any], rerun_failed: bool) -> dict[str, Any] | None:
        """The row on disk that may stand for this one."""
        if not self.use_cache or not self.results.has_cell(row["key"]):
            return None
        stored = self.results.cell(row["key"])
        if rerun_failed and stored["status"] == "failed":
            return None
        # The key does not tell what an image file was called, nor a seed that nothing took.
        return stored | {column: row[column] for column in ("light_options", "seed")}

    @contextmanager
    def _guarded(self, cell: Cell, row: dict[str, Any]) -> Iterator[None]:
        """What runs under the time limit; where plug-ins take part, the process is afterwards as it was."""
        limit = time_limit(self.study.time_limit, partial(self._give_up, row, threading.get_ident()))
        with Restored("a plug-in") if self._sources.any_foreign(cell) else nullcontext(), limit:
            yield

    def _give_up(self, row: dict[str, Any], thread: int) -> None:
        """Write the row of a cell that cannot be interrupted, with where it is, before the process ends."""
        reason = f"took more than the time limit of {self.study.time_limit:g} s, and could not be interrupted"
        stack = "".join(traceback.format_stack(sys._current_frames()[thread]))
        self.results.add_cell(row | failure(f"{stack}TimeoutError: {reason}\n"), None, None)
        remove_marks(self.results.folder / "begun")
        print(f"error: {row['method']} {reason}; the same command goes on with the next cell", file=sys.__stderr__)

    def _row(self, cell: Cell, key: str, reference_key: str) -> dict[str, Any]:
        study, light_key = self.study, self.lights.key(cell.light)
        return begin_row(cell, key, reference_key, light_key, study.metrics, study.device, study.seed, self._code)

    def _forget(self) -> None:
        """Let go of all that cells share: a plug-in may have spoilt it."""
        self._stages, self._stages_light = StageCache(self.progress.doing), None
        self._truth = None
        self.lights.forget()
        for module in [
            m for name, m in sys.modules.items() if name.startswith(("glossbench.scene", "glossbench.brdf"))
        ]:
            for member in vars(module).values():
                if callable(getattr(member, "cache_clear", None)):
                    member.cache_clear()
