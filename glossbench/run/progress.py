"""The progress of a run, for those who watch it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from glossbench.run.rates import Spent


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
