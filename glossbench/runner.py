"""Running a study: cell after cell, each remembered on disk, so that a killed run goes on from there."""

import json
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import torch

from glossbench.brdf.material import MATERIALS
from glossbench.costs import Costs
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.lights import LIGHTS
from glossbench.errors import InputError
from glossbench.ground_truth import Reference, compute_reference
from glossbench.items import Cell, Item
from glossbench.metrics import METRICS
from glossbench.provenance import glossbench_version, numerics_hash, processor, provenance, source_hash
from glossbench.registry import Registry
from glossbench.results import Results, key_of
from glossbench.scene.points import VIEWS
from glossbench.shading import METHODS, Image, Method, StageCache, shade
from glossbench.study import Study
from glossbench.tuning import tune_option
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
    lights = _Lights(study)
    progress.doing("lights")
    for item in study.lights:  # an image that cannot be read must stop the run before it writes
        lights.get(item)
    results = Results(folder)
    results.create()
    started = datetime.now(UTC)
    progress.begin(len(cells))
    executor = _Executor(study, results, lights, progress, use_cache, fail_fast)
    rows = []
    for cell in cells:
        row = executor.run(cell, rerun_failed)
        rows.append(row)
        progress.cell(row)
    results.finish(
        study.resolved(), judge(study.claims, pandas.DataFrame(rows)), rows, provenance(study.device, started)
    )
    return results


class _Lights:
    """The study's lights, one in memory at a time."""

    def __init__(self, study: Study) -> None:
        self._study = study
        self._item: Item | None = None
        self._light: CubeMap | None = None
        self._keys: dict[Item, str] = {}

    def get(self, item: Item) -> CubeMap:
        if self._light is None or self._item != item:
            self._light = LIGHTS.create(item.name, item.options).cubemap().to(self._study.device)
            self._item = item
            self._keys[item] = self._light.key
        return self._light

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
        self._fresh: set[str] = set()  # keys of references made by this run
        self._stages = StageCache()
        self._stages_light: Item | None = None
        self._truth: tuple[str, Reference] | None = None

    def run(self, cell: Cell, rerun_failed: bool) -> dict[str, Any]:
        """The row of a cell: read from disk, or made and written."""
        light = [self.lights.key(cell.light), source_hash(LIGHTS.get(cell.light.name))]
        reference_key = key_of(
            [self._code, light, _stated(MATERIALS, cell.material), _stated(VIEWS, cell.view),
             self.study.reference.model_dump(), self.study.device]
        )  # fmt: skip
        metrics = [[name, source_hash(METRICS.get(name))] for name in self.study.metrics]
        key = key_of([reference_key, _stated(METHODS, cell.method), metrics])
        row = self._identity(cell, key, reference_key)
        if self.use_cache and self.results.has_cell(key):
            stored = self.results.cell(key)
            if not (rerun_failed and stored["status"] == "failed"):
                # The key does not tell what an image file was called, nor a seed that nothing took.
                return stored | {column: row[column] for column in ("light_options", "seed")}
        try:
            done, image, half_vectors = self._execute(cell, reference_key)
            row |= done
        except Exception:
            if self.fail_fast:
                raise
            row |= {"status": "failed", "reason": traceback.format_exc()}
            image, half_vectors = None, None
        self.results.add_cell(row, image, half_vectors)
        return row

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
            "tuned": "{}", "status": "done", "reason": "",
            **dict.fromkeys([*self.study.metrics, "rms"], nothing),
            "reference_noise": nothing, "reference_peak_noise": nothing, "reference_target": nothing,
            "reference_mean": nothing, "reference_samples": 0,
            "at_noise_floor": False,
            "n_samples": 0, "stage_seconds": json.dumps(costs.stage_seconds),
            "update_seconds": json.dumps(costs.update_seconds), "shade_seconds": nothing, "state_bytes": 0,
            "reference_seconds": nothing,
            "version": glossbench_version(), "torch": torch.__version__, "device": self.study.device,
            "processor": processor(), "seed": self.study.seed, "light_key": self.lights.key(cell.light),
            "code": self._code[:20],
        }  # fmt: skip

    def _execute(self, cell: Cell, reference_key: str) -> tuple[dict[str, Any], Image | None, Any]:
        material = MATERIALS.create(cell.material.name, cell.material.options)
        view = VIEWS.create(cell.view.name, cell.view.options)
        method = METHODS.create(cell.method.name, cell.method.options)
        reason = method.supports(material, view.scene())
        if reason:
            return {"status": "skipped", "reason": reason}, None, None
        light = self.lights.get(cell.light)
        if self._stages_light != cell.light:  # stages of another light are of no use any more
            self._stages, self._stages_light = StageCache(), cell.light
        truth = self._reference(cell, reference_key, light)
        self.progress.doing(cell.method.name)

        def shaded(candidate: Method, time_it: bool) -> Image:
            return shade(candidate, light, material, view, cache=self._stages, time_it=time_it)

        tuned: dict[str, float] = {}
        if cell.method.tune is not None:
            tune = cell.method.tune
            metric = METRICS.create(tune.metric, {})
            best = tune_option(tune, lambda x: metric(shaded(replace(method, **{tune.option: x}), False), truth))
            tuned = {tune.option: best}
            method = replace(method, **tuned)
        image = shaded(method, True)
        rms = METRICS.create("rms", {})(image, truth)
        numbers = self.results.reference_numbers(reference_key)
        half_vectors = method.half_vectors(material)
        row = {
            "tuned": json.dumps(tuned),
            "options": json.dumps(method.as_dict(), sort_keys=True),
            **{name: METRICS.create(name, {})(image, truth) for name in self.study.metrics},
            "rms": rms,
            "reference_noise": truth.noise,
            "reference_peak_noise": float(truth.standard_error.max()),
            "reference_target": self.study.reference.relative_error * truth.mean,
            "reference_mean": truth.mean,
            "reference_samples": truth.n_samples,
            "at_noise_floor": bool(rms < 2 * truth.noise),
            "n_samples": image.costs.n_samples,
            "stage_seconds": json.dumps(image.costs.stage_seconds),
            "update_seconds": json.dumps(image.costs.update_seconds),
            "shade_seconds": image.costs.shade_seconds,
            "state_bytes": image.costs.state_bytes,
            "reference_seconds": numbers["seconds"],
        }
        return row, image, None if half_vectors is None else half_vectors.cpu().numpy()

    def _reference(self, cell: Cell, key: str, light: CubeMap) -> Reference:
        """The truth as it is on disk: float32, so that a resumed run compares with the same numbers."""
        if self._truth is not None and self._truth[0] == key:
            return self._truth[1]
        if not self.results.has_reference(key) or not (self.use_cache or key in self._fresh):
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
                light, material, view, options.relative_error, options.max_samples, options.seed, tell
            )
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


def _stated(registry: Registry[Any], item: Item) -> list[Any]:
    """All that makes an item what it is: name, options as stated and what they mean, and the source of its class."""
    meaning = registry.create(item.name, item.options).key()
    return [item.name, item.spelled(), meaning, source_hash(registry.get(item.name))]
