"""Running a study: cell after cell, each remembered on disk, so that a killed run goes on from there."""

import json
import sys
import threading
import time
import traceback
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import torch

from glossbench.brdf.material import MATERIALS
from glossbench.costs import Costs
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.lights import LIGHTS
from glossbench.errors import CannotWrite, InputError, MethodError
from glossbench.ground_truth import Reference, compute_reference
from glossbench.items import Cell, Item
from glossbench.manifest import entry
from glossbench.measuring import measure
from glossbench.metrics import METRICS
from glossbench.plugins import origin
from glossbench.provenance import glossbench_version, numerics_hash, processor, provenance, source_hash
from glossbench.registry import Registry
from glossbench.results import Results, key_of
from glossbench.rows import with_names
from glossbench.scene.points import VIEWS
from glossbench.shading import METHODS, Image
from glossbench.stage_cache import StageCache
from glossbench.study import Study
from glossbench.surroundings import settled
from glossbench.time_limit import time_limit
from glossbench.verdicts import judge


@dataclass(frozen=True)
class Progress:
    """What a run tells while it goes on; each is a function that may do nothing.

    Attributes:
        begin: the number of cells.
        doing: what is under way, in a few words.
        cell: a cell is done, with its row.
        note: what is out of the ordinary, a line: a damaged file that is made again, a fuller study that stays.
    """

    begin: Callable[[int], None] = lambda n: None
    doing: Callable[[str], None] = lambda text: None
    cell: Callable[[dict[str, Any]], None] = lambda row: None
    note: Callable[[str], None] = lambda text: None


@settled()
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
        InputError: no such device, a file cannot be read, or the folder cannot be written or holds what would be
            lost; then nothing is written. CannotWrite: a full disk, say; the cells that are done are kept.
    """
    if not study.has_device():
        raise InputError("the study wants device: cuda, but there is none here; say device: cpu")
    progress = progress or Progress()
    cells = study.cells()
    lights = _Lights(study)
    progress.doing("lights")
    for item in study.lights:  # an image that cannot be read must stop the run before it writes
        lights.get(item)
    for registry, items in ((MATERIALS, study.materials), (VIEWS, study.views)):  # and other files alike
        for item in items:
            registry.create(item.name, item.options).open_files()
    results = Results(folder)
    _check_own_study(study, results)
    started = datetime.now(UTC)
    executor = _Executor(study, results, lights, progress, use_cache, fail_fast)
    identities = [executor.identity(cell) for cell in cells]
    if kept := results.begin(study.resolved(), identities, provenance(study.device, started)):
        progress.note(kept)
    progress.begin(len(cells))
    rows = []
    for cell, identity in zip(cells, identities, strict=True):
        row = executor.run(cell, identity, rerun_failed)
        rows.append(row)
        progress.cell(row)
    rows = with_names(rows)
    results.finish(
        study.resolved(),
        judge(study.claims, pandas.DataFrame(rows)),
        rows,
        provenance(study.device, started, {name: origin(name) for name in study.plugins}),
    )
    return results


def _check_own_study(study: Study, results: Results) -> None:
    """InputError where the results would take the place of the study's own file; that of a run may run again."""
    path = results.folder / "study.yaml"
    if path.exists() and study.name == "study" and study.folder.resolve() == results.folder.resolve():
        if "study.yaml" not in results.disk.manifest.files or results.disk.is_altered("study.yaml"):
            raise InputError(
                f"{path} is the study itself, which its results would take the place of: name another folder by -o"
            )


def kept_statuses(study: Study, folder: Path) -> list[str]:
    """Of each cell of a study what a folder has of it: done, skipped or failed; new where it has nothing."""
    results = Results(folder)
    if not any((folder / "cells").glob("*.json")):
        return ["new"] * len(study.cells())
    executor = _Executor(study, results, _Lights(study), Progress(), True, False)
    keys = [executor.identity(cell)["key"] for cell in study.cells()]
    return [str(results.cell(key)["status"]) if results.has_cell(key) else "new" for key in keys]


class _Lights:
    """The study's lights, one in memory at a time."""

    def __init__(self, study: Study) -> None:
        self._study = study
        self._item: Item | None = None
        self._light: CubeMap | None = None
        self._keys: dict[Item, str] = {}
        self.notes: dict[Item, tuple[str, ...]] = {}  # of all that were asked for
        self._digest = 0

    def get(self, item: Item) -> CubeMap:
        if self._light is None or self._item != item:
            light = LIGHTS.create(item.name, item.options)
            self._light = light.cubemap().to(self._study.device)
            self.notes[item] = light.notes()
            self._item = item
            self._keys[item] = self._light.key
            self._digest = _digest(self._light)
        return self._light

    def is_intact(self) -> bool:
        """Whether the light is what it was when it was made: arrays that share its memory can be written to unseen."""
        return self._light is None or _digest(self._light) == self._digest

    def forget(self) -> None:
        """Make the light anew when it is asked for again."""
        self._light = None

    def key(self, item: Item) -> str:
        if item not in self._keys:
            self.get(item)
        return self._keys[item]


class _Executor:
    """Runs one cell after another; stages and the reference, which neighbours share, it keeps meanwhile."""

    def __init__(
        self,
        study: Study,
        results: Results,
        lights: _Lights,
        progress: Progress,
        use_cache: bool,
        fail_fast: bool,
    ) -> None:
        self.study, self.results, self.lights, self.progress = study, results, lights, progress
        self.use_cache, self.fail_fast = use_cache, fail_fast
        self._code = numerics_hash()
        self._source: Callable[[Any], str] = cache(source_hash)  # once a run: files may change meanwhile
        self._whole: dict[str, bool] = {}  # by key of a reference, whether it is on disk as it was written
        self._stages = StageCache(self.progress.doing)
        self._stages_light: Item | None = None
        self._truth: tuple[str, Reference] | None = None
        self._metrics = [[name, source_hash(METRICS.get(name))] for name in study.metrics]
        self._meanings: dict[int, list[Any]] = {}

    def identity(self, cell: Cell) -> dict[str, Any]:
        """The row of a cell under its keys, with nothing measured yet."""
        reference_key = self._reference_key(cell)
        key = key_of([reference_key, self._stated(METHODS, cell.method), self._metrics])
        return self._identity(cell, key, reference_key)

    def run(self, cell: Cell, row: dict[str, Any], rerun_failed: bool) -> dict[str, Any]:
        """The row of a cell: read from disk, or made and written.

        Args:
            row: its identity.
        """
        stored = self._stored(cell, row)
        if stored is not None and not (rerun_failed and stored["status"] == "failed"):
            return stored
        row = dict(row)
        try:
            done, image, half_vectors = self._execute(cell, row)
            row |= done
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a plug-in may leave by SystemExit, too
            if isinstance(error, CannotWrite) and error.path.is_relative_to(self.results.folder):
                raise  # no fault of the cell's
            self._stages, self._truth = StageCache(self.progress.doing), None
            self.lights.forget()
            if self.fail_fast and isinstance(error, Exception):
                raise
            if self.fail_fast:
                raise MethodError(f"{cell.method.name} raised {error!r}") from error
            row |= _failed(traceback.format_exc())
            image, half_vectors = None, None
        self.results.add_cell(row, image, half_vectors)
        return row

    def _reference_key(self, cell: Cell) -> str:
        light = [self.lights.key(cell.light), self._source(LIGHTS.get(cell.light.name))]
        return key_of(
            [self._code, light, self._stated(MATERIALS, cell.material), self._stated(VIEWS, cell.view),
             self.study.reference.model_dump(), self.study.device]
        )  # fmt: skip

    def _require_same_files(self, cell: Cell, reference_key: str) -> None:
        """InputError where a file was replaced since its key was taken: numbers of it would be kept under that key."""
        if self._reference_key(cell) != reference_key:
            raise InputError("a file of the material or the view changed while the study ran; run it again")

    def _stated(self, registry: Registry[Any], item: Item) -> list[Any]:
        """All that makes an item what it is: name, options as stated and what they mean, and its class's source."""
        meaning = registry.create(item.name, item.options).key()
        return [item.name, item.spelled(), meaning, self._source(registry.get(item.name))]

    def _stored(self, cell: Cell, row: dict[str, Any]) -> dict[str, Any] | None:
        """The row of a cell on disk, where all its files are as they were written; its reference is, or is made so."""
        key = row["key"]
        if not (self.use_cache and self.results.has_cell(key)):
            return None
        if damage := self.results.damage_of_cell(key):
            self.progress.note(f"{damage}: this cell is computed again")
            return None
        stored = self.results.cell(key)
        if stored["status"] == "done" and not self._has_reference(row["reference_key"]):
            self._reference(cell, row["reference_key"], self.lights.get(cell.light))
        # The key does not tell what an image file was called, nor a seed that nothing took.
        return stored | entry(row)

    def _has_reference(self, key: str) -> bool:
        """Whether a reference is on disk as it was written; looked at once a run."""
        if key not in self._whole:
            is_there = self.use_cache and self.results.has_reference(key)
            damage = self.results.damage_of_reference(key) if is_there else ""
            if damage:
                self.progress.note(f"{damage}: this reference is computed again")
            self._whole[key] = is_there and not damage
        return self._whole[key]

    def _give_up(self, row: dict[str, Any], thread: int) -> None:
        """Write the row of a cell that cannot be interrupted, with where it is, before the process ends."""
        reason = f"took more than the time limit of {self.study.time_limit:g} s, and could not be interrupted"
        stack = "".join(traceback.format_stack(sys._current_frames()[thread]))
        self.results.add_cell(row | _failed(f"{stack}TimeoutError: {reason}\n"), None, None)
        print(f"error: {row['method']} {reason}; the same command goes on with the next cell", file=sys.__stderr__)

    def _identity(self, cell: Cell, key: str, reference_key: str) -> dict[str, Any]:
        """The columns that every cell has, with nothing measured yet."""
        nothing = float("nan")
        costs = Costs()
        return {
            "key": key, "reference_key": reference_key,
            "light": cell.light.name, "material": cell.material.name,
            "view": cell.view.name, "method": cell.method.name,
            "light_options": cell.light.json, "material_options": cell.material.json,
            "view_options": cell.view.json, "options": json.dumps(cell.method.options, sort_keys=True),
            "tuned": "{}", "status": "done", "reason": "", "notes": "[]",
            **dict.fromkeys([*self.study.metrics, "rms"], nothing),
            "reference_noise": nothing, "reference_peak_noise": nothing, "reference_target": nothing,
            "reference_mean": nothing, "reference_samples": 0,
            "tune": json.dumps({cell.method.tune.option: cell.method.spelled()[cell.method.tune.option]}
                               if cell.method.tune else {}),
            "at_noise_floor": False,
            "n_samples": 0, "stage_seconds": json.dumps(costs.stage_seconds),
            "update_seconds": json.dumps(costs.update_seconds), "shade_seconds": nothing, "state_bytes": 0,
            "reference_seconds": nothing,
            "version": glossbench_version(), "torch": torch.__version__, "device": self.study.device,
            "processor": processor(), "seed": self.study.seed, "light_key": self.lights.key(cell.light),
            "code": self._code[:20],
        }  # fmt: skip

    def _execute(self, cell: Cell, row: dict[str, Any]) -> tuple[dict[str, Any], Image | None, Any]:
        """What is new in the row of a cell, its image and its pattern."""
        thread = threading.get_ident()
        limit = partial(time_limit, self.study.time_limit, lambda: self._give_up(row, thread))
        material = MATERIALS.create(cell.material.name, cell.material.options)
        view = VIEWS.create(cell.view.name, cell.view.options)
        with limit():
            method = METHODS.create(cell.method.name, cell.method.options)
            reason = method.supports(material, view.scene())
        if reason:
            return {"status": "skipped", "reason": str(reason)}, None, None
        light = self.lights.get(cell.light)
        if self._stages_light != cell.light:  # stages of another light are of no use any more
            self._stages, self._stages_light = StageCache(self.progress.doing), cell.light
        truth = self._reference(cell, row["reference_key"], light)
        self.progress.doing(cell.method.name)
        with limit():
            columns, image, half_vectors = measure(
                method, cell.method.tune, self.study.metrics, self._stages, light, material, view, truth
            )
        self._require_same_files(cell, row["reference_key"])
        if not self.lights.is_intact():
            raise MethodError(f"{method.name} writes into the light, which others read")
        columns |= {
            "notes": json.dumps([*self.lights.notes[cell.light], *material.notes(), *view.notes(), *method.notes()]),
            "reference_noise": truth.noise,
            "reference_peak_noise": float(truth.standard_error.max()),
            "reference_target": self.study.reference.relative_error * truth.mean,
            "reference_mean": truth.mean,
            "reference_samples": truth.n_samples,
            "at_noise_floor": bool(columns["rms"] < 2 * truth.noise),
            "reference_seconds": self.results.reference_numbers(row["reference_key"])["seconds"],
        }
        return columns, image, half_vectors

    def _reference(self, cell: Cell, key: str, light: CubeMap) -> Reference:
        """The truth as it is on disk: float32, so that a resumed run compares with the same numbers."""
        if self._truth is not None and self._truth[0] == key:
            return self._truth[1]
        if not self._has_reference(key):
            options = self.study.reference
            started = time.perf_counter()

            def tell(noise: float, n_samples: int) -> None:
                target = f"{100 * options.relative_error:.2g} %"
                self.progress.doing(
                    f"reference: noise {100 * noise:.2g} % (target {target}), {n_samples} samples a pixel"
                )

            material = MATERIALS.create(cell.material.name, cell.material.options)
            view = VIEWS.create(cell.view.name, cell.view.options)
            self.progress.doing("reference")
            truth = compute_reference(
                light, material, view, options.relative_error, options.max_samples, options.seed, tell,
                self.results.folder / "references" if self.use_cache else None,
            )  # fmt: skip
            self._require_same_files(cell, key)
            self.results.add_reference(key, truth, time.perf_counter() - started)
            self._whole[key] = True
        stored = Reference(
            torch.from_numpy(self.results.reference(key).astype(np.float64)),
            torch.from_numpy(self.results.standard_error(key).astype(np.float64)),
            torch.from_numpy(self.results.mask(key)),
            int(self.results.reference_numbers(key)["n_samples"]),
        )
        self._truth = (key, stored)
        return stored


def _failed(reason: str) -> dict[str, Any]:
    """Columns of a cell that failed; half a character, which a name of a file may hold, is escaped."""
    return {"status": "failed", "reason": reason.encode("utf-8", "backslashreplace").decode()}


def _digest(light: CubeMap) -> int:
    return zlib.crc32(light.faces.cpu().numpy().data)
