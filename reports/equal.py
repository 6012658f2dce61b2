"""Equal time and equal error: what each line would reach at round times and errors, between the points it has."""

from collections.abc import Callable, Sequence
from math import exp, floor, log, log10
from typing import NamedTuple

import numpy as np

from .lines import Axis, Floats, Line

FEWEST_COLUMNS, MOST_COLUMNS = 3, 6
DIGITS = ((1, 2, 5), (1, 1.5, 2, 3, 4, 5, 7))  # the second where the first gives too few columns
Value = float | None


class Table(NamedTuple):
    """Rows are lines, columns are times or errors.

    Attributes:
        at: the heads of the columns.
        rows: a value a column, None beyond the points of a line: nothing is extrapolated.
        best: of each column the lowest value, where two lines or more have one.
    """

    at: Sequence[float]
    lines: Sequence[Line]
    rows: Sequence[Sequence[Value]]
    best: Sequence[Value]


class Curve(NamedTuple):
    """Log time and log error of the points of a line, in order of time."""

    time: Floats
    error: Floats

    def error_at(self, time: float) -> Value:
        """Straight between neighbouring points."""
        if len(self.time) < 2 or not self.time[0] <= log(time) <= self.time[-1]:
            return None
        return exp(float(np.interp(log(time), self.time, self.error)))

    def time_at(self, error: float) -> Value:
        """The least time from which on a segment reaches so low an error; None too where the first point is below."""
        wanted = log(error)
        if len(self.time) < 2 or self.error[0] < wanted:
            return None
        for (t0, t1), (e0, e1) in zip(_neighbours(self.time), _neighbours(self.error), strict=True):
            if e1 <= wanted <= e0:
                share = (e0 - wanted) / (e0 - e1) if e0 > e1 else 0.0
                return exp(t0 + share * (t1 - t0))
        return None


def error_at_time(lines: Sequence[Line], axis: Axis) -> Table | None:
    """The error of each line at round shading times [ms]; None where no two lines share one."""
    curves = [_curve(line, axis) for line in lines]
    ends = [(c.time[0], c.time[-1]) for c in curves if len(c.time) > 1]
    return _table(ends, lines, lambda time: [curve.error_at(time) for curve in curves])


def time_at_error(lines: Sequence[Line], axis: Axis) -> Table | None:
    """The least shading time [ms] at which each line comes down to round errors; None where no two lines share one."""
    curves = [_curve(line, axis) for line in lines]
    ends = [(c.error.min(), c.error[0]) for c in curves if len(c.time) > 1]
    table = _table(ends, lines, lambda error: [curve.time_at(error) for curve in curves])
    return table and Table(table.at[::-1], table.lines, [row[::-1] for row in table.rows], table.best[::-1])


def _curve(line: Line, axis: Axis) -> Curve:
    """Of the points that the reference resolves."""
    time, error = line.costs["shade"], line.errors
    use = np.isfinite(error) & (error > 0) & (time > 0) & ~line.at_floor & axis.is_log
    order = np.argsort(time[use], kind="stable")
    return Curve(np.log(time[use][order]), np.log(error[use][order]))


def _table(
    ends: Sequence[tuple[float, float]], lines: Sequence[Line], values_at: Callable[[float], list[Value]]
) -> Table | None:
    """Columns that two lines or more have a value in, thinned evenly; lines that have one in any."""
    columns: dict[float, list[Value]] = {}
    for digits in DIGITS:
        columns = {at: values_at(at) for at in _round_values(ends, digits)}
        columns = {at: found for at, found in columns.items() if sum(value is not None for value in found) > 1}
        if len(columns) >= FEWEST_COLUMNS:
            break
    shared = list(columns)
    if len(shared) > MOST_COLUMNS:
        shared = [shared[round(i * (len(shared) - 1) / (MOST_COLUMNS - 1))] for i in range(MOST_COLUMNS)]
    kept = [i for i in range(len(lines)) if any(columns[at][i] is not None for at in shared)]
    if not kept:
        return None
    best = [min(value for value in columns[at] if value is not None) for at in shared]
    return Table(shared, [lines[i] for i in kept], [[columns[at][i] for at in shared] for i in kept], best)


def _round_values(ends: Sequence[tuple[float, float]], digits: Sequence[float]) -> list[float]:
    """Digits times powers of ten between the ends of the log intervals, all of them together."""
    if not ends:
        return []
    low, high = exp(min(low for low, _ in ends)), exp(max(high for _, high in ends))
    powers = range(floor(log10(low)), floor(log10(high)) + 1)
    return [value for power in powers for digit in digits if low <= (value := float(f"{digit}e{power}")) <= high]


def _neighbours(values: Floats) -> list[tuple[float, float]]:
    return list(zip(values[:-1].tolist(), values[1:].tolist(), strict=True))
