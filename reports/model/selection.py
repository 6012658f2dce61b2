"""Selections: the cells or lines, of many, for which a report has room."""

from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import TypeVar

from .conditions import Cell, Group

Item = TypeVar("Item")
MOST_PICTURES = 72  # in a report


def choose_cells(groups: Sequence[Group], most: int) -> list[list[Cell]]:
    """The cells of each group that are drawn: all or, if there are more than `most`, fewer budgets of each line.

    The first of these that is small enough: smallest, middle and largest budget; largest budget; some lines, evenly.
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
    """At most this many items, at even distances, from the first to the last."""
    if len(items) <= most:
        return list(items)
    return [items[round(i * (len(items) - 1) / max(1, most - 1))] for i in range(most)]


def choose_middle_budgets(group: Group) -> list[Cell]:
    """For each line of a group, the cell with the middle budget, or the lower of two middle ones."""
    lines = [list(members) for _, members in groupby(group.done, key=lambda cell: cell.index)]
    return [line[(len(line) - 1) // 2] for line in lines]


def _thin(line: Iterable[Cell], n_budgets: int | None) -> list[Cell]:
    cells = list(line)
    if n_budgets is None:
        return cells
    picked = {len(cells) - 1} if n_budgets == 1 else {0, len(cells) // 2, len(cells) - 1}
    return [cells[i] for i in sorted(picked)]
