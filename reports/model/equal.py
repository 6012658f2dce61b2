"""Equal time and equal error: interpolated error of each line at round times, and time at round errors."""

from collections.abc import Callable, Sequence
from math import exp, floor, inf, log, log10
from typing import NamedTuple

import numpy as np

from .axes import Place
from .lines import MeasuredLine, make_axis
from .panels import Axis, Floats

FEWEST_COLUMNS, MOST_COLUMNS = 3, 6
DIGITS = ((1, 2, 5), (1, 1.5, 2, 3, 4, 5, 7))  # the second is used if the first gives too few columns


class Value(NamedTuple):
    """An interpolated value of a line, by the median, the fastest (low) and the slowest (high) time of its runs.

    `high` is infinite if the slowest run takes too long.
    """

    middle: float
    low: float
    high: float

    @property
    def has_spread(self) -> bool:
        """Whether the value differs between the fastest and the slowest run."""
        return self.low < self.high


class EqualTable(NamedTuple):
    """Rows are the lines that have points, columns are times or errors.

    Attributes:
        at: the heads of the columns.
        rows: one value per column; None beyond the points of a line, because nothing is extrapolated.
        best: for each column, the index of the line with the lowest value. None if its interval overlaps with that of
            another line, or if a line without a value in this column has a point at least as low.
    """

    at: Sequence[float]
    lines: Sequence[MeasuredLine]
    rows: Sequence[Sequence[Value | None]]
    best: Sequence[int | None]

    @property
    def is_open(self) -> bool:
        """Whether a column has no best line because the times of runs overlap."""
        return None in self.best

    @property
    def has_points(self) -> bool:
        """Whether a line has only one budget."""
        return any(len(line.x) == 1 for line in self.lines)


class EqualTables(NamedTuple):
    """The two tables of one place over samples (counted from 1) and one metric; one table may be None."""

    number: int
    place: Place
    metric: str
    axis: Axis
    by_time: EqualTable | None
    by_error: EqualTable | None


class Curve(NamedTuple):
    """The points of a line, sorted by time: log of the median, fastest and slowest time, and log error."""

    time: Floats
    low: Floats
    high: Floats
    error: Floats

    def interpolate_error(self, time: float) -> Value | None:
        """Linear interpolation between points. A single point has its error at any time that is long enough."""
        at = log(time)
        if not len(self.time) or at < self.time[0] or (len(self.time) > 1 and at > self.time[-1]):
            return None
        # With the fastest runs the error at this time is lower; the slowest run may need more than this time.
        middle, low, high = (exp(float(np.interp(at, t, self.error))) for t in (self.time, self.low, self.high))
        return Value(middle, min(low, middle), max(high, middle) if at >= self.high[0] else inf)

    def time_at(self, error: float) -> Value | None:
        """The shortest time at which a segment reaches this error; None if the first point is already below it.

        A single point has its time for any error that is not below its own.
        """
        wanted = log(error)
        if len(self.time) == 1 and self.error[0] <= wanted:
            return Value(*(exp(float(t[0])) for t in (self.time, self.low, self.high)))
        if len(self.time) < 2 or self.error[0] < wanted:
            return None
        for i, (e0, e1) in enumerate(zip(self.error[:-1].tolist(), self.error[1:].tolist(), strict=True)):
            if e1 <= wanted <= e0:
                share = (e0 - wanted) / (e0 - e1) if e0 > e1 else 0.0
                times = (float(t[i] + share * (t[i + 1] - t[i])) for t in (self.time, self.low, self.high))
                return Value(*map(exp, times))
        return None

    def find_least_error(self, time: float) -> float:
        """The lowest error of the points that take at most this time; infinite without such a point."""
        return exp(self.error[self.time <= log(time)].min(initial=inf))

    def find_least_time(self, error: float) -> float:
        """The shortest time of the points with at most this error; infinite without such a point."""
        return exp(self.time[self.error <= log(error)].min(initial=inf))


def make_equal_tables(number: int, place: Place, metric: str, lines: Sequence[MeasuredLine]) -> EqualTables | None:
    """Both tables of a place and metric; None if no two lines can be compared."""
    axis = make_axis(place, metric)
    by_time, by_error = compare_errors(lines, axis), compare_times(lines, axis)
    return EqualTables(number, place, metric, axis, by_time, by_error) if by_time or by_error else None


def compare_errors(lines: Sequence[MeasuredLine], axis: Axis) -> EqualTable | None:
    """The error of each line at round shading times [ms]; None if no two lines share a time."""
    curves = [_make_curve(line, axis) for line in lines]
    ends = [(c.time[0], c.time[-1]) for c in curves if len(c.time)]
    return _make_table(ends, lines, curves, Curve.interpolate_error, Curve.find_least_error)


def compare_times(lines: Sequence[MeasuredLine], axis: Axis) -> EqualTable | None:
    """The shortest shading time [ms] at which each line reaches round errors; None if no two lines share an error."""
    curves = [_make_curve(line, axis) for line in lines]
    ends = [(c.error.min(), c.error[0]) for c in curves if len(c.error)]
    table = _make_table(ends, lines, curves, Curve.time_at, Curve.find_least_time)
    return table and EqualTable(table.at[::-1], table.lines, [row[::-1] for row in table.rows], table.best[::-1])


def _make_curve(line: MeasuredLine, axis: Axis) -> Curve:
    """The curve through the points that the reference resolves."""
    time, error = line.costs["shade"], line.errors
    low, high = line.spread or (time, time)
    use = np.isfinite(error) & (error > 0) & (time > 0) & (low > 0) & ~line.at_floor & axis.is_log
    order = np.argsort(time[use], kind="stable")
    return Curve(*(np.log(each[use][order]) for each in (time, low, high, error)))


def _make_table(
    ends: Sequence[tuple[float, float]], lines: Sequence[MeasuredLine], curves: Sequence[Curve],
    value_at: Callable[[Curve, float], Value | None], least_at: Callable[[Curve, float], float],
) -> EqualTable | None:  # fmt: skip
    """A table of columns in which at least two lines have a value; of many columns, some at even distances.

    Args:
        least_at: the lowest value among the points of a line: a line without an interpolated value may be lower than
            the best.
    """
    with_points = [(line, curve) for line, curve in zip(lines, curves, strict=True) if len(curve.time)]
    columns: dict[float, list[Value | None]] = {}
    for digits in DIGITS:
        columns = {at: [value_at(curve, at) for _, curve in with_points] for at in _round_values(ends, digits)}
        columns = {at: found for at, found in columns.items() if sum(value is not None for value in found) > 1}
        if len(columns) >= FEWEST_COLUMNS:
            break
    shared = list(columns)
    if len(shared) > MOST_COLUMNS:
        shared = [shared[round(i * (len(shared) - 1) / (MOST_COLUMNS - 1))] for i in range(MOST_COLUMNS)]
    if not shared:
        return None
    rows = [[columns[at][i] for at in shared] for i in range(len(with_points))]
    best = [_find_best(columns[at], [least_at(curve, at) for _, curve in with_points]) for at in shared]
    return EqualTable(shared, [line for line, _ in with_points], rows, best)


def _find_best(column: Sequence[Value | None], least: Sequence[float]) -> int | None:
    """The index of the lowest value; None if its interval overlaps another, or a line without a value is lower."""
    (first, best), *others = sorted(
        ((i, value) for i, value in enumerate(column) if value is not None), key=lambda pair: pair[1]
    )
    unseen = [reached for value, reached in zip(column, least, strict=True) if value is None]
    return first if all(best.high < other for other in (*unseen, *(value.low for _, value in others))) else None


def _round_values(ends: Sequence[tuple[float, float]], digits: Sequence[float]) -> list[float]:
    """Round values (digits times powers of ten) within the union of the log intervals, and the next one above.

    The next one gives a column for points that no interval contains.
    """
    if not ends:
        return []
    low, high = exp(min(low for low, _ in ends)), exp(max(high for _, high in ends))
    powers = range(floor(log10(low)), floor(log10(high)) + 2)
    values = [value for power in powers for digit in digits if low <= (value := float(f"{digit}e{power}"))]
    within = [value for value in values if value <= high]
    return [*within, values[len(within)]]
