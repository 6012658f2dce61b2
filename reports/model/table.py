"""A table as data: heads, and rows in parts, which page and print paint."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from .conditions import Cell


class Entry(NamedTuple):
    """What stands in one place of a table.

    Attributes:
        note: below it, smaller: between which ends it lies.
        sort: what its row sorts by; None comes last.
        span: how many columns it takes.
        hint: what the page says where the pointer is.
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
        column: of the results, whose it is; "" for what is of no column.
        group: what it shares with its neighbours, such as "new"; "" alone.
        role: of the column.
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
        names: what it is of, one for each head of a name.
        notes: below the first name, smaller.
        entries: of the other columns; none where there is an outcome.
        outcome: why it has no numbers but what was asked of it; "" where it has.
        cell: whose row it is; None for a row of something else.
        sort: what it sorts by, one for each column as far as it has any.
    """

    names: Sequence[str]
    entries: Sequence[Entry] = ()
    outcome: str = ""
    cell: Cell | None = None
    sort: Sequence[float | str | None] = ()
    notes: Sequence[str] = ()


class Part(NamedTuple):
    """Rows of one light, material and view; with how many more there are than a report has room for."""

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
        """Neighbours that share a group, with the place of each; a head without a group is alone."""
        found: list[tuple[str, list[tuple[int, Head]]]] = []
        for place, head in enumerate(self.every):
            if head.group and found and found[-1][0] == head.group:
                found[-1][1].append((place, head))
            else:
                found.append((head.group, [(place, head)]))
        return found
