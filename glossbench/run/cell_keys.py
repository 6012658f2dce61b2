"""The keys of a study's cells: a hash of everything that determines a cell, known before anything is measured."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import cached_property
from typing import Any, NamedTuple

from glossbench.columns import CONDITIONS
from glossbench.errors import InputError
from glossbench.options import Options
from glossbench.provenance import compute_code_hash
from glossbench.run.attempts import FOLDER, OUR_TRIES, TRIES, Attempt
from glossbench.run.cell_files import make_key
from glossbench.run.cell_items import CellParts, Sources
from glossbench.run.results import Results
from glossbench.run.study_lights import ChangedInput, StudyLights
from glossbench.study.cells import Candidate, Cell
from glossbench.study.study import Study


class AbandonedCell(Exception):
    """A cell that is not tried again, because it ended the process too often."""


class Identity(NamedTuple):
    """The keys of a cell.

    Attributes:
        key: key of the cell on disk.
        spelled: key of what the study states about the cell, without the keys that plug-ins return. A cell that fails
            before its own key is known, or that ends the process, is stored under this key.
        reference_key: key of its reference; empty if `key` is `spelled`.
        light_key: key of its light; empty if it is not known.
        keys: keys of its material, view and method.
        error: why its own key is not known.
        ended: how often the process ended in this cell.
        tries: how often it may end the process before it is passed over.
    """

    key: str
    spelled: str
    reference_key: str = ""
    light_key: str = ""
    keys: tuple[str, ...] = ()
    error: BaseException | None = None
    ended: int = 0
    tries: int = TRIES


class CellKeys:
    """Finds the keys of cells. The key of an item is computed once per run, unless the item comes from a plug-in.

    Args:
        guard: (cell, key) -> the context manager in which the code of plug-ins runs.
    """

    def __init__(
        self, study: Study, results: Results, lights: StudyLights,
        guard: Callable[[Cell, str], AbstractContextManager[None]],
    ) -> None:  # fmt: skip
        self.sources = Sources(study.measured)
        # Includes the tuning, shading and metrics that it calls.
        self.code = compute_code_hash("glossbench.run.measuring")
        self._common = [compute_code_hash("glossbench.truth.reference"), study.reference.model_dump(), study.device]
        self._results, self._lights, self._guard = results, lights, guard
        self._study = study  # keeps its items alive, so that each id belongs to one of them
        self._known: dict[int, str] = {}
        self._spelled: dict[int, list[Any]] = {}

    def identify(self, cell: Cell, again: bool = False) -> Identity:
        """The identity of a cell.

        Args:
            again: try a cell again that failed before its own key was known.

        Raises:
            InputError: a file cannot be read, or has changed.
        """
        sources, is_foreign = self.sources.list_by_kind(cell), self.sources.has_foreign(cell)
        items = {kind: self._state_item(item) for kind, item in _collect_items(cell).items()}
        spelled = make_key([self.code, self._common, sources, items])
        is_there = self.is_stored(spelled) and not self._results.find_cell_damage(spelled)
        if is_there and not again:
            return Identity(spelled, spelled)
        tries = TRIES if is_foreign else OUR_TRIES
        tried = Attempt(self._results.store, spelled, tries, self._marks)
        # A second mark, which is removed before the cell begins.
        attempt = Attempt(self._results.store, f"{spelled}_key", marks=self._marks)
        for each in (tried, attempt):
            if each.is_hopeless and not is_there:
                each.end()
                return Identity(spelled, spelled, error=AbandonedCell(f"{each.told}; --rerun-failed tries again"))
        try:
            with self._guard(cell, spelled) if is_foreign else nullcontext():
                if is_foreign:
                    attempt.begin()
                keys = self._compute_keys(cell, is_foreign)
                light_key = self._lights.key(cell.light)
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt | ChangedInput) or (
                isinstance(error, InputError) and not is_foreign
            ):
                raise
            return Identity(spelled, spelled, error=error)
        finally:
            attempt.end()
        stated = [[*items[kind], key] for kind, key in zip(("material", "view", "method"), keys, strict=True)]
        reference_key = make_key([self._common, light_key, *(sources[place] for place in CONDITIONS), *stated[:2]])
        key = make_key([reference_key, self.code, stated[2], sources["method"], sources["metrics"]])
        return Identity(key, spelled, reference_key, light_key, keys, ended=tried.ended, tries=tries)

    def is_stored(self, key: str) -> bool:
        """Whether a cell was in the store when the first cell was identified."""
        return f"cells/{key}.json" in self._cells

    # Both are listed once: to ask an object store for each of 10,000 cells would take minutes.

    @cached_property
    def _cells(self) -> frozenset[str]:
        return frozenset(self._results.store.list("cells/"))

    @cached_property
    def _marks(self) -> frozenset[str]:
        return frozenset(self._results.store.list(f"{FOLDER}/"))

    def _compute_keys(self, cell: Cell, is_foreign: bool) -> tuple[str, ...]:
        if is_foreign:
            return CellParts.from_cell(cell).keys
        items = cell.material, cell.view, cell.method
        for item in items:
            if id(item) not in self._known:
                self._known[id(item)] = item.key()
        return tuple(self._known[id(item)] for item in items)

    def _state_item(self, item: Options | Candidate) -> list[Any]:
        if id(item) not in self._spelled:
            self._spelled[id(item)] = [item.name, item.as_dict()]
        return self._spelled[id(item)]


def _collect_items(cell: Cell) -> dict[str, Options | Candidate]:
    return {"light": cell.light, "material": cell.material, "view": cell.view, "method": cell.candidate}
