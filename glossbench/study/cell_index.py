"""Which cells fit an exclusion or a claim: decided once for each item and value, not for each cell."""

import json
from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from glossbench.columns import CONDITIONS
from glossbench.study.claims import BUDGET, agrees, list_names

Mask = NDArray[np.bool_]
Named = tuple[str, Mapping[str, Any]]  # a name and options
KINDS = (*CONDITIONS, "method")
_ABSENT = object()


class CellIndex:
    """Cells as positions in lists of lights, materials, views and methods.

    Args:
        items: by kind, the names and options of the items.
        codes: by kind, for each cell the position of its item.
    """

    def __init__(self, items: Mapping[str, Sequence[Named]], codes: Mapping[str, NDArray[np.intp]]) -> None:
        self.codes = codes
        self._columns = {kind: _Columns(items[kind]) for kind in KINDS}
        self._all = np.ones(len(codes["method"]), bool)

    @classmethod
    def from_product(cls, items: Mapping[str, Sequence[Named]]) -> Self:
        """All combinations light x material x view x method; the method varies fastest."""
        counts = [len(items[kind]) for kind in KINDS]
        codes = np.unravel_index(np.arange(np.prod(counts, dtype=int)), counts)
        return cls(items, dict(zip(KINDS, codes, strict=True)))

    @classmethod
    def from_rows(cls, rows: Iterable[Mapping[str, Any]]) -> Self:
        """Cells from rows of results.

        A row has the names of its items and their options: `light_options` and so on, and `options` for the method.
        """
        items: dict[str, list[Named]] = {kind: [] for kind in KINDS}
        codes: dict[str, list[int]] = {kind: [] for kind in KINDS}
        known: dict[tuple[str, str, str], int] = {}
        for row, kind in product(rows, KINDS):
            options = row["options" if kind == "method" else f"{kind}_options"]
            key = (kind, row[kind], json.dumps(options, sort_keys=True))
            if key not in known:
                known[key] = len(items[kind])
                items[kind].append((row[kind], options))
            codes[kind].append(known[key])
        return cls(items, {kind: np.array(of_kind, np.intp) for kind, of_kind in codes.items()})

    def is_called(self, kind: str, wanted: Any) -> Mask:
        """Cells whose item fits a name, {name: {option: value}}, or any one in a list of these."""
        columns, fits = self._columns[kind], np.zeros(0, bool)
        for one in wanted if isinstance(wanted, list) else [wanted]:
            name, stated = next(iter(one.items())) if isinstance(one, dict) else (one, {})
            each = columns.find_named(name)
            for option, value in stated.items():
                each = each & columns.find_agreeing(option, value)
            fits = each | fits if fits.size else each
        return fits[self.codes[kind]] if fits.size else ~self._all

    def find_excluded(self, entry: Mapping[str, Any]) -> Mask:
        """Cells that have all values of an entry of `exclude`.

        An option is looked for in the method, then in the material, the view and the light.
        """
        fits = self._all
        for key, wanted in entry.items():
            if key in KINDS:
                fits = fits & self.is_called(key, wanted)
                continue
            left, found = self._all, ~self._all
            for kind in ("method", "material", "view", "light"):
                columns, codes = self._columns[kind], self.codes[kind]
                if columns.find_holding(key).any():
                    found = found | (left & columns.find_agreeing(key, wanted)[codes])
                    left = left & ~columns.find_holding(key)[codes]
            fits = fits & found
        return fits

    def find_within(self, where: Mapping[str, Any], of_methods: Iterable[str]) -> Mask:
        """Cells that fit `where`. An option that only the other method has does not restrict a cell.

        A short name means an option of a method, else of the material; a full name, such as "light.seed",
        "material.alpha" or "view.resolution", means the option of that light, material or view.

        Args:
            of_methods: the options of all methods that the claim is about.
        """
        fits = self._all
        for key, wanted in where.items():
            if key in CONDITIONS:
                each = self.is_called(key, wanted)
            elif (of := key.partition(".")[0]) in CONDITIONS:
                each = self._columns[of].find_agreeing(key.partition(".")[2], wanted)[self.codes[of]]
            elif key in of_methods:
                columns = self._columns["method"]
                each = (~columns.find_holding(key) | columns.find_agreeing(key, wanted))[self.codes["method"]]
            else:
                each = self._columns["material"].find_agreeing(key, wanted)[self.codes["material"]]
            fits = fits & each
        return fits

    def group_cells(
        self, kinds: Sequence[str], options: Sequence[str], budgets: Mapping[str, str] | None = None
    ) -> NDArray[np.intp]:
        """A number for each cell. Cells with the same items of some kinds and equal options have the same number.

        Args:
            options: of the method; BUDGET stands for the budget of each method, "material.alpha" for a parameter of
                the material.
            budgets: by method, the option that is its budget.
        """
        number = np.zeros(len(self._all), np.intp)
        columns = [(self.codes[kind], self._columns[kind].n) for kind in kinds]
        for option in options:
            of, _, own = option.partition(".")
            kind, own = (of, own) if of in CONDITIONS else ("method", option)
            column = (
                self._columns[kind].find_budget(budgets or {})
                if option == BUDGET
                else self._columns[kind].find_column(own)
            )
            columns.append((column.codes[self.codes[kind]] + 1, len(column.distinct) + 1))
        for codes, n in columns:
            number = number * n + codes
        return number

    def list_values(self, key: str, cells: Mask) -> list[Any]:
        """The values of an option, or the names of a kind, in the given cells: in their order, each once."""
        if key in KINDS:
            return self._columns[key].list_names(np.unique(self.codes[key][cells]))
        found: list[Any] = []
        of, _, option = key.partition(".")
        if of in CONDITIONS:
            return self._columns[of].list_values(option, np.unique(self.codes[of][cells]))
        for kind in ("method", "material"):
            found = found or self._columns[kind].list_values(key, np.unique(self.codes[kind][cells]))
        return found


class _Columns:
    """The items of one kind, with one column per option; a column is made at its first use."""

    def __init__(self, items: Sequence[Named]) -> None:
        self._items, self.n = items, len(items)
        self._made: dict[str, _Column] = {}
        positions: dict[str, list[int]] = {}
        for i, (name, options) in enumerate(items):
            for each in list_names(name, options):
                positions.setdefault(each, []).append(i)
        self._none = np.zeros(len(items), bool)
        self._named = {name: np.isin(np.arange(len(items)), of_name) for name, of_name in positions.items()}

    def find_named(self, name: str) -> Mask:
        return self._named.get(name, self._none)

    def find_holding(self, option: str) -> Mask:
        return self.find_column(option).held

    def find_agreeing(self, option: str, wanted: Any) -> Mask:
        column = self.find_column(option)
        agrees_with = np.zeros(len(column.distinct) + 1, bool)  # the last entry is for items without the option
        agrees_with[column.find_agreeing(wanted)] = True
        return agrees_with[column.codes]

    def list_names(self, positions: Iterable[int]) -> list[str]:
        return list(dict.fromkeys(self._items[i][0] for i in positions))

    def list_values(self, option: str, positions: Iterable[int]) -> list[Any]:
        column = self.find_column(option)
        return [column.distinct[c] for c in dict.fromkeys(column.codes[i] for i in positions) if c >= 0]

    def find_budget(self, budgets: Mapping[str, str]) -> "_Column":
        return _Column([options.get(budgets.get(name, ""), _ABSENT) for name, options in self._items])

    def find_column(self, option: str) -> "_Column":
        if option not in self._made:
            self._made[option] = _Column([options.get(option, _ABSENT) for _, options in self._items])
        return self._made[option]


class _Column:
    """The distinct values of an option, and for each item the position of its value, or -1 if it has none.

    A scalar is found by a dictionary, not by a comparison with each value.
    """

    def __init__(self, values: list[Any]) -> None:
        self.distinct: list[Any] = []
        self._alike: dict[tuple[bool, Any], list[int]] = {}
        known: dict[str, int] = {}
        codes = []
        for value in values:
            if value is _ABSENT:
                codes.append(-1)
                continue
            key = json.dumps(value, sort_keys=True)
            if key not in known:
                known[key] = len(self.distinct)
                if (scalar := _read_scalar(value)) is not None:
                    self._alike.setdefault(scalar, []).append(known[key])
                self.distinct.append(value)
            codes.append(known[key])
        self._all_scalar = not any(isinstance(value, list | dict) for value in self.distinct)
        self.codes = np.array(codes, np.intp)
        self.held = self.codes >= 0

    def find_agreeing(self, wanted: Any) -> list[int]:
        if isinstance(wanted, dict) or (isinstance(wanted, list) and not self._all_scalar):
            return [i for i, value in enumerate(self.distinct) if agrees(wanted, value)]
        each = wanted if isinstance(wanted, list) else [wanted]
        scalars = ((isinstance(one, bool), one) for one in each if not isinstance(one, list | dict))
        return [i for scalar in scalars for i in self._alike.get(scalar, [])]


def _read_scalar(value: Any) -> tuple[bool, Any] | None:
    """(is it a Boolean, the value) of a scalar, or of a list whose components are all equal; else None.

    The Boolean flag distinguishes True from 1, which compare equal.
    """
    if isinstance(value, list):
        parts = {_read_scalar(part) for part in value}
        return next(iter(parts)) if len(parts) == 1 else None
    return None if isinstance(value, dict) else (isinstance(value, bool), value)
