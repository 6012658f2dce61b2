"""The references of a run: each is read from the store of the results, or computed and written."""

import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack

import numpy as np
import torch

from glossbench.columns import CellRecord
from glossbench.envmap.cubemap import CubeMap
from glossbench.errors import MethodError
from glossbench.run.cell_items import CellParts, Sources
from glossbench.run.folder import Folder
from glossbench.run.progress import Progress
from glossbench.run.rates import measure_reference
from glossbench.run.results import Results
from glossbench.study.cells import Cell
from glossbench.study.study import Study
from glossbench.truth.reference import Reference, compute_reference


class References:
    """The references of a run. The last one is kept for the next cells, which often share it.

    Args:
        guard: the context in which code of plug-ins runs for a cell.

    Attributes:
        seconds: that computing references has taken so far.
    """

    def __init__(
        self,
        study: Study,
        results: Results,
        progress: Progress,
        use_cache: bool,
        sources: Sources,
        guard: Callable[[Cell, CellRecord], AbstractContextManager[None]],
    ) -> None:
        self._study, self._results, self._progress, self._use_cache = study, results, progress, use_cache
        self._sources, self._guard = sources, guard
        self._whole: dict[str, bool] = {}  # by key: whether it is in the store, undamaged
        self._last: tuple[str, Reference] | None = None
        self.seconds = 0.0

    def provide(self, cell: Cell, record: CellRecord, light: CubeMap, made: CellParts) -> Reference:
        """The reference as read from disk, in float32, so that a resumed run compares with the same numbers."""
        key = record.reference_key
        if self._last is not None and self._last[0] == key:
            return self._last[1]
        if not self.has(key):
            options = self._study.reference
            started = time.perf_counter()
            with ExitStack() as limits:

                def begin_round() -> None:
                    limits.close()  # the limit is per round, and only for plug-ins: a reference may take long
                    if self._sources.has_foreign_inputs(cell):
                        limits.enter_context(self._guard(cell, record))

                def tell(noise: float, n_samples: int) -> None:
                    target = f"{100 * options.relative_error:.2g} %"
                    self._progress.doing(
                        f"reference: noise {100 * noise:.2g} % (target {target}), {n_samples} samples per pixel"
                    )
                    begin_round()

                self._progress.doing("reference")
                begin_round()
                # Only a folder keeps the partial sums of a reference.
                store = self._results.store
                checkpoint = store.root / "references" if self._use_cache and isinstance(store, Folder) else None
                truth = compute_reference(
                    light, made.material, made.view, options.relative_error, options.max_samples, options.seed, tell,
                    checkpoint, options.method,
                )  # fmt: skip
                made.check_unchanged(cell)
            if not torch.isfinite(truth.radiance).all():
                raise MethodError(f"the reference of {cell.material.name} is not finite everywhere")
            n_bytes = self._results.add_reference(key, truth, time.perf_counter() - started)
            seconds = time.perf_counter() - started
            self.seconds += seconds
            self._progress.spent(measure_reference(cell, options, seconds, n_bytes))
            self._whole[key] = True
        stored = Reference(
            torch.from_numpy(self._results.reference(key).astype(np.float64)),
            torch.from_numpy(self._results.standard_error(key).astype(np.float64)),
            torch.from_numpy(self._results.mask(key)),
            int(self._results.reference_numbers(key)["n_samples"]),
            torch.from_numpy(self._results.deviates(key)),
            str(self._results.reference_numbers(key)["method"]),
        )
        self._last = (key, stored)
        return stored

    def trust(self, reference_key: str) -> None:
        """Take a reference as whole, because this run has just made it."""
        self._whole[reference_key] = True

    def has(self, key: str) -> bool:
        """Whether a reference is on disk, undamaged; checked once per run."""
        if key not in self._whole:
            is_there = self._use_cache and self._results.has_reference(key)
            damage = self._results.find_reference_damage(key) if is_there else ""
            if damage:
                self._progress.note(f"{damage}: this reference is computed again")
            self._whole[key] = is_there and not damage
        return self._whole[key]

    def forget(self) -> None:
        """Read the next one from the store again."""
        self._last = None
