"""Selections: of many cells or lines those that a report has room for."""

from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import TypeVar

from .conditions import Cell, Group

Item = TypeVar("Item")
MOST_PICTURES = 72  # of a report


def choose_cells(groups: Sequence[Group], most: int) -> list[list[Cell]]:
    """The cells of each group that are drawn: all; if those are more than `most`, fewer budgets of each line.

    First the smallest, middle and largest budget are kept, then the largest alone, then of the lines some, evenly.
    """
    kept: list[list[Cell]] = []
    for n_budgets in (None, 3, 1):
        kept = [
            [cell for _, line in groupby(group.done, key=lambda cell: cell.index) for cell in _thin(line, n_budgets)]
            for group in groups
        ]
        if sum(map(len, kept)) <= most:
            return kept
    share = max(1, most // max(1, sum(map(bool, kept))))
    return [pick_evenly(cells, share) for cells in kept]


def pick_evenly(items: Sequence[Item], most: int) -> list[Item]:
    """At most so many of some, at even distances, from the first to the last."""
    if len(items) <= most:
        return list(items)
    return [items[round(i * (len(items) - 1) / max(1, most - 1))] for i in range(most)]


def choose_middle_budgets(group: Group) -> list[Cell]:
    """Of each line of a group the cell with the middle budget, the lower of two."""
    lines = [list(members) for _, members in groupby(group.done, key=lambda cell: cell.index)]
    return [line[(len(line) - 1) // 2] for line in lines]


def _thin(line: Iterable[Cell], n_budgets: int | None) -> list[Cell]:
    cells = list(line)
    if n_budgets is None:
        return cells
    picked = {len(cells) - 1} if n_budgets == 1 else {0, len(cells) // 2, len(cells) - 1}
    return [cells[i] for i in sorted(picked)]
