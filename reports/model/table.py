"""A table as data: heads, and rows in parts, which the page and print draw."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from .conditions import Cell


class Entry(NamedTuple):
    """One entry of a table.

    Attributes:
        note: smaller text below it: the ends of its interval.
        sort: the value by which rows are sorted; None comes last.
        span: number of columns that it covers.
        hint: text that the page shows at the pointer.
    """

    text: str
    note: str = ""
    is_best: bool = False
    sort: float | str | None = None
    span: int = 1
    hint: str = ""


@dataclass(frozen=True)
class Head:
    """The head of a column.

    Attributes:
        column: the column of the results that it shows; "" if it shows none.
        group: the title that it shares with its neighbours, such as "new"; "" if it shares none.
        role: the role of the column.
    """

    title: str
    unit: str = ""
    column: str = ""
    group: str = ""
    role: str = ""
    is_number: bool = True


class Row(NamedTuple):
    """One row.

    Attributes:
        names: its names, one for each head of a name.
        notes: smaller text below the first name.
        entries: the entries of the other columns; none if there is an outcome.
        outcome: why it has no results; "" if it has results.
        cell: the cell that it shows; None for a row of something else.
        sort: the values by which it is sorted, one for each column, or none.
    """

    names: Sequence[str]
    entries: Sequence[Entry] = ()
    outcome: str = ""
    cell: Cell | None = None
    sort: Sequence[float | str | None] = ()
    notes: Sequence[str] = ()


class Part(NamedTuple):
    """Rows of one light, material and view, and the number of rows that were left out."""

    title: str
    rows: Sequence[Row]
    left_out: int = 0


@dataclass(frozen=True)
class Table:
    """Heads of names, heads of the other columns, and rows in parts."""

    names: Sequence[Head]
    heads: Sequence[Head]
    parts: Sequence[Part]

    @property
    def every(self) -> list[Head]:
        """All heads."""
        return [*self.names, *self.heads]

    @property
    def groups(self) -> list[tuple[str, list[tuple[int, Head]]]]:
        """Neighbouring heads that share a group, each with its index; a head without a group is alone."""
        found: list[tuple[str, list[tuple[int, Head]]]] = []
        for place, head in enumerate(self.every):
            if head.group and found and found[-1][0] == head.group:
                found[-1][1].append((place, head))
            else:
                found.append((head.group, [(place, head)]))
        return found
