"""The stages that cells of one light share, as long as later cells need them."""

from collections.abc import Callable, Iterable

from glossbench.process.state import is_foreign
from glossbench.shading.method import Method
from glossbench.shading.stage_cache import StageCache
from glossbench.study.cells import Cell, to_text


class LightStages:
    """The stages of the light of the present cell; those of another light are not needed any more.

    Args:
        tell: called with the names of the method and the stage when a stage begins.
    """

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell
        self._coming: dict[int, tuple[Cell, str]] | None = None  # by id: cells to compute, the texts of their lights
        self._stages, self._light = StageCache(self._tell, later=self._list_methods), ""

    def expect(self, cells: Iterable[Cell]) -> None:
        """These cells will be computed. Large stages that none of them needs are then dropped early."""
        self._coming = {id(cell): (cell, to_text(cell.light)) for cell in cells}

    def finish(self, cell: Cell) -> None:
        """This cell needs no stage any more."""
        if self._coming is not None:
            self._coming.pop(id(cell), None)

    def of(self, cell: Cell) -> StageCache:
        """The stages of its light."""
        light = to_text(cell.light)
        if light != self._light:
            self.forget()
            self._light = light
        return self._stages

    def forget(self) -> None:
        """Drop all stages."""
        self._stages, self._light = StageCache(self._tell, later=self._list_methods), ""

    def _list_methods(self) -> list[Method] | None:
        """The different methods of the cells of this light that are not done yet.

        None if these are not known, or if it is not known what they read: the options of a method that is tuned, or
        those of a plug-in, whose code may fail.
        """
        if self._coming is None:
            return None
        cells = [cell for cell, light in self._coming.values() if light == self._light]
        if any(cell.tune or is_foreign(type(cell.method)) for cell in cells):
            return None
        return list({to_text(cell.method): cell.method for cell in cells}.values())
