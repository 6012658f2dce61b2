"""Trials: every configuration under every condition, with what noise leaves open of the order of their errors.

A condition is a light, a material and a view. A configuration is a method with all its options; cells that differ only
in the seed of their random points are one configuration, with the mean of their errors e.

Under one condition two configurations are compared by d = log e_1 - log e_2. If group i of the reference is left out,
log e becomes z_i; if seed s is left out, z_s. With x_i = sqrt((G - 1) / G) (z_i - mean z) of G groups or seeds, the
variance of log e is the sum of x_i^2, and that of d is the sum of (x_1i - x_2i)^2: noise that both share cancels. A
reference, or a set of seeds, that only one of the two has adds its own squares.

Source: the jackknife and the degrees of freedom as in estimates.py, there for any number, here for logarithms.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from glossbench.columns import CONDITIONS
from glossbench.findings.costs import NEGLIGIBLE, read_named_cost
from glossbench.findings.estimates import CONFIDENCE, is_too_large
from glossbench.study.claims import SEED
from glossbench.study.labels import (
    distinguish_rows,
    identify,
    name_items,
    read_budget,
    read_stated,
    with_options,
)
from glossbench.truth.jackknife import jackknife

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Row = Mapping[str, Any]
TINY = 1e-300  # stands for an error of exactly 0, which has no logarithm
# Times within this factor count as equal. On a quiet machine the median of slowest over fastest run of shading is 1.13
# in quickstart and 1.18 in regular_sampling_table_1; stages have no recorded spread.
SPREAD = 1.2


class Condition(NamedTuple):
    """A light, a material and a view.

    Attributes:
        keys: the identities of the three.
        names: their names.
        n_pixels: pixels that show the surface; NaN if the results do not say.
    """

    keys: tuple[str, ...]
    names: tuple[str, ...]
    n_pixels: float = float("nan")

    @property
    def title(self) -> str:
        """The three names."""
        return ", ".join(self.names)


@dataclass(frozen=True, eq=False)
class Configuration:
    """A method with all its options.

    Attributes:
        name: the method with the options that distinguish it from other configurations.
        method: the name of the method.
        line: the name without the budget.
        budget: the value of the option that is the budget; None without one.
        cells: the cells with an image, one or one per seed, by the index of the condition.
        reasons: why there is no image, by the index of the condition.
    """

    name: str
    method: str
    line: str
    budget: float | None
    cells: Mapping[int, Sequence[Row]]
    reasons: Mapping[int, str]


class Order(NamedTuple):
    """Pairs (i, j) of configurations under one condition: the error of i is lower beyond noise, or equal."""

    lower: Mask
    equal: Mask


@dataclass(frozen=True, eq=False)
class Trials:
    """All configurations under all conditions, for one metric of which a lower absolute value is better."""

    metric: str
    configurations: Sequence[Configuration]
    conditions: Sequence[Condition]
    _costs: dict[str, Floats] = field(default_factory=dict)

    @cached_property
    def done(self) -> Mask:
        """Whether a configuration (row) has an image under a condition (column)."""
        return np.array([[n in each.cells for n in range(len(self.conditions))] for each in self.configurations], bool)

    @cached_property
    def log_errors(self) -> Floats:
        """Log of the error of each configuration under each condition, without the bias of noise; NaN without one."""
        found = np.full(self.done.shape, np.nan)
        for c, n in np.argwhere(self.done):
            found[c, n] = self._shifts[c, n].log_error
        return found

    @cached_property
    def at_floor(self) -> Mask:
        """Where the reference cannot resolve the error."""
        return np.array(
            [[any(row["at_noise_floor"] for row in each.cells.get(n, ())) for n in range(len(self.conditions))]
             for each in self.configurations], bool,
        )  # fmt: skip

    @cached_property
    def orders(self) -> list[Order]:
        """For each condition, the order of the errors as far as noise lets it be known."""
        return [self._compare(n) for n in range(len(self.conditions))]

    @cached_property
    def noise(self) -> list[tuple[Floats, Floats]]:
        """For each condition, of the difference of log errors of each pair: its variance, and degrees of freedom."""
        return [self._measure_noise(n) for n in range(len(self.conditions))]

    def cost(self, name: str) -> Floats:
        """A cost by its name in `COSTS` [ms or MB], like `log_errors`; NaN if it is unknown.

        An update or a memory that is negligible is 0.
        """
        if name not in self._costs:
            found = self._read_each(lambda row: read_named_cost(row, name))
            is_free = (found < NEGLIGIBLE[name]) & (name != "shade")
            self._costs[name] = np.where(is_free, 0.0, found)
        return self._costs[name]

    @cached_property
    def stages(self) -> Floats:
        """Time of all stages [ms], like `log_errors`."""
        return self._read_each(lambda row: 1e3 * sum(row["stage_seconds"].values()))

    def _read_each(self, read: Callable[[Row], float]) -> Floats:
        """A number of each configuration under each condition: the median over its seeds."""
        found = np.full(self.done.shape, np.nan)
        for c, n in np.argwhere(self.done):
            found[c, n] = np.median([read(row) for row in self.configurations[c].cells[n]])
        return found

    @cached_property
    def _shifts(self) -> dict[tuple[int, int], "_Shifts"]:
        return {(c, n): _measure_shifts(rows, self.metric)
                for c, each in enumerate(self.configurations) for n, rows in each.cells.items()}  # fmt: skip

    def _measure_noise(self, n: int) -> tuple[Floats, Floats]:
        shifts = [self._shifts.get((c, n)) for c in range(len(self.configurations))]
        sources = {key: len(shift) for each in shifts if each for key, shift in each.by_source.items()}
        total, squares = (np.zeros((len(shifts), len(shifts))) for _ in range(2))
        for source, size in sources.items():
            moved = np.array(
                [each.by_source.get(source, np.zeros(size)) if each else np.zeros(size) for each in shifts]
            )
            own = sum((x[:, None] - x[None, :]) ** 2 for x in moved.T)
            total += own
            squares += own**2 / (size - 1)
        return total, np.divide(total**2, squares, out=np.full_like(total, np.inf), where=squares > 0)

    def _compare(self, n: int) -> Order:
        difference = self.log_errors[:, n][:, None] - self.log_errors[:, n][None, :]
        variance, degrees = self.noise[n]
        half = np.where(variance > 0, stdtrit(degrees, 0.5 + CONFIDENCE / 2) * np.sqrt(variance), 0.0)
        floored = self.at_floor[:, n]
        equal = (floored[:, None] & floored[None, :]) | ((difference == 0) & (variance == 0))
        return Order((difference + half < 0) & ~equal, equal)


def find_factor(cost: str) -> float:
    """The factor within which two values of a cost are equal: times vary, sizes do not."""
    return 1.0 if cost == "memory" else SPREAD


class _Shifts(NamedTuple):
    """The log error of a configuration, and its shifts x by the groups of its reference and by its seeds."""

    log_error: float
    by_source: Mapping[tuple[Any, ...], Floats]


def read_trials(rows: Sequence[Row], metric: str, n_pixels: Mapping[str, float] | None = None) -> Trials:
    """The trials in the rows of a table.

    Args:
        rows: parsed rows.
        n_pixels: pixels that show the surface, by the key of the reference.
    """
    names = {kind: name_items(kind, rows) for kind in CONDITIONS}
    merged = [_without_seed(row) for row in rows]
    full = [
        with_options(row["method"], told) for row, (told, _) in zip(rows, distinguish_rows(merged, ""), strict=True)
    ]
    short = [with_options(row["method"], told) for row, (_, told) in zip(rows, distinguish_rows(merged), strict=True)]
    keys = [tuple(identify(kind, row) for kind in CONDITIONS) for row in rows]
    places = {key: n for n, key in enumerate(dict.fromkeys(keys))}
    pixels = {key: (n_pixels or {}).get(str(row["reference_key"]), np.nan) for key, row in zip(keys, rows, strict=True)}
    conditions = [
        Condition(key, tuple(names[kind][own] for kind, own in zip(CONDITIONS, key, strict=True)), pixels[key])
        for key in places
    ]
    found: dict[str, Configuration] = {}
    for row, key, name, line in zip(rows, keys, full, short, strict=True):
        own = found.setdefault(name, Configuration(name, row["method"], line, read_budget(row), {}, {}))
        _add_cell(own, places[key], row, metric)
    return Trials(metric, list(found.values()), conditions)


def _add_cell(configuration: Configuration, n: int, row: Row, metric: str) -> None:
    cells: Any = configuration.cells
    reasons: Any = configuration.reasons
    value = row.get(metric)
    if row["status"] == "done" and value is not None and np.isfinite(value):
        cells.setdefault(n, []).append(row)
    else:
        lines = str(row.get("reason") or f"without {metric}").strip().splitlines()
        reasons[n] = f"{row['status']}: {lines[-1]}"


def _without_seed(row: Row) -> dict[str, Any]:
    """The row of a configuration: options as stated, without the seed of random points."""
    options = {key: value for key, value in read_stated(row).items() if key != SEED or not row.get("is_random")}
    return {**row, "options": options, "tuned": {}, "tune": {}}


def _measure_shifts(rows: Sequence[Row], metric: str) -> _Shifts:
    stored = [np.abs(np.asarray(row["left_out"].get(metric) or [row[metric]], float)) for row in rows]
    values = np.array([each[: min(map(len, stored))] for each in stored])  # (seed, whole reference and groups)
    whole, *without = np.log(np.maximum(values.mean(axis=0), TINY)).tolist()
    shifts: dict[tuple[Any, ...], Floats] = {}
    bias = 0.0
    if without:
        bias, shift = jackknife(whole, without)[0], _scale(without)
        if is_too_large(bias, whole, is_log=True):  # at the noise floor: the standard error is the bias
            shift, bias = np.full(len(without), abs(bias) / len(without) ** 0.5), 0.0
        shifts["reference", str(rows[0].get("reference_key"))] = shift
    if len(rows) > 1:
        others = (values[:, 0].sum() - values[:, 0]) / (len(rows) - 1)
        seeds = tuple(row["options"].get(SEED) for row in rows)
        shifts["seeds", seeds] = _scale(np.log(np.maximum(others, TINY)).tolist())
    return _Shifts(whole - bias, shifts)


def _scale(left_out: Sequence[float]) -> Floats:
    n, values = len(left_out), np.asarray(left_out)
    return np.sqrt((n - 1) / n) * (values - values.mean())
