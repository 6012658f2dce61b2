"""Differences: what changed, cell by cell, from the table of one result to that of another.

An error is worse or better if the ratio after / before lies outside the margin, and noise does not explain it:

    p = 2 P(T > |log ratio - log edge| / s),    edge = 1 + margin or 1 - margin, whichever is nearer to the ratio,

where T has Student's t distribution, and s is the standard error of log ratio, by the jackknife. With the logarithm, an
exchange of the two results exchanges worse and better. Of many cells without a difference, one in twenty would have
p < 0.05. Therefore the p of all cells are adjusted together (`scipy.stats.false_discovery_control`), and are compared
with 0.05 after that: of 20 pairs of results without any difference, one has a number that is called worse or better.

Two references are one if their mean, noise and largest noise agree. Their noise is then shared, and cancels in the
ratio. All other references are independent.

Source: Benjamini and Hochberg 1995 (adjustment).
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas
import scipy

from glossbench.columns import parse_row
from glossbench.findings.columns import Column
from glossbench.findings.comparisons import EQUAL, NOISE, Row, keep_finite
from glossbench.findings.estimates import CONFIDENCE, Estimate, Floats, Sample, estimate
from glossbench.findings.matching import Match, match_cells
from glossbench.findings.times import SLOWER, compare_times, explain_untimed
from glossbench.study.claims import MARGIN, SEED

WORSE, BETTER = "worse", "better"
EDGES = math.log1p(-MARGIN), math.log1p(MARGIN)
FINGERPRINT = ("reference_mean", "reference_noise", "reference_peak_noise")
# Another processor rounds sums of float32 differently, by about 1e-7; other random numbers change a standard error by
# tens of percent.
SAME_REFERENCE = 1e-5


class Change(NamedTuple):
    """One number of one cell in two results.

    Attributes:
        before: the row of the first result; of cells that differ only in the seed of random points, the first row.
        after: the row of the second result.
        column: a metric, or shade_seconds.
        a: the number of the first result; of several seeds the mean.
        b: the number of the second result.
        log_ratio: log(|b| / |a|).
        shares_noise: whether the two have the same references.
        has_noise: whether the noise of both is known.
        is_one_seed: whether the points are random and have a single seed, so that their spread is not known.
    """

    before: Row
    after: Row
    column: str
    a: float
    b: float
    log_ratio: Estimate
    verdict: str = NOISE
    shares_noise: bool = False
    has_noise: bool = False
    is_one_seed: bool = False

    @property
    def ratio(self) -> float:
        """|b| / |a|, without the bias that noise causes."""
        return _exponentiate(self.log_ratio.value)

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the ratio."""
        low, high = self.log_ratio.interval
        return _exponentiate(low), _exponentiate(high)


class Differences(NamedTuple):
    """What changed from one result to another.

    Attributes:
        errors: each metric of each cell that both results have, the worst first.
        times: shading times that can be compared, the slowest first.
        untimed: why other shading times cannot be compared, with the number of cells.
        broken: (before, after) of cells that were done, and are skipped or failed now.
        repaired: (before, after) of cells that are done now, and were not.
        match: which cells both results have, and which only one has.
        metrics: the metrics that are compared; those that only one result has.
    """

    errors: Sequence[Change]
    times: Sequence[Change]
    untimed: Mapping[str, int]
    broken: Sequence[tuple[Row, Row]]
    repaired: Sequence[tuple[Row, Row]]
    match: Match
    metrics: tuple[Sequence[str], Sequence[str]]

    @property
    def is_worse(self) -> bool:
        """Whether an error is worse, or a cell is not done any more."""
        return bool(self.broken) or any(each.verdict == WORSE for each in self.errors)

    @property
    def is_slower(self) -> bool:
        """Whether a shading time is longer."""
        return any(each.verdict == SLOWER for each in self.times)


def find_differences(
    before: pandas.DataFrame, after: pandas.DataFrame, columns: tuple[Mapping[str, Column], Mapping[str, Column]]
) -> Differences:
    """What changed between two tables of cells.

    Args:
        columns: the columns of each table, by name.
    """
    match = match_cells(*([parse_row(row) for row in cells.to_dict("records")] for cells in (before, after)))
    held = [
        [name for name, column in own.items() if column.role == "error" and column.type is float and name in cells]
        for own, cells in zip(columns, (before, after), strict=True)
    ]
    metrics = [name for name in held[1] if name in held[0]]
    errors: list[Change] = []
    times: list[Change] = []
    untimed: Counter[str] = Counter()
    broken: list[tuple[Row, Row]] = []
    repaired: list[tuple[Row, Row]] = []
    for pair in match.pairs:
        a, b = ([row for row in rows if row["status"] == "done"] for rows in pair)
        if a and b:
            errors += [each for name in metrics if (each := _compare_errors(a, b, name))]
            if reason := explain_untimed(a, b):
                untimed[reason] += 1
            else:
                times.append(_compare_times(a, b))
        elif a or b:
            (broken if a else repaired).append(((a or pair[0])[0], (b or pair[1])[0]))
    errors = _decide(errors, columns[1])
    return Differences(
        _sort(errors, columns[1]), sorted(times, key=lambda each: -each.ratio), untimed, broken, repaired, match,
        (metrics, sorted(set(held[0]) ^ set(held[1]))),
    )  # fmt: skip


def _compare_errors(before: Sequence[Row], after: Sequence[Row], column: str) -> Change | None:
    """A metric of a cell, or of its seeds, not judged yet; None if it is not finite."""
    pair = [[row for row in rows if keep_finite(row.get(column)) is not None] for rows in (before, after)]
    if not all(pair):
        return None
    names: list[Row] = []  # a row of each reference that has been met
    sides = [[_make_sample(row, column, names) for row in rows] for rows in pair]
    a, b = (float(np.mean([row[column] for row in rows])) for rows in pair)
    shares = [{sample.reference for sample in side} for side in sides]
    seeds = [[sample.seed for sample in side] for side in sides]
    return Change(
        pair[0][0], pair[1][0], column, a, b, estimate(_divide_sizes, sides, is_log=True),
        shares_noise=shares[0] == shares[1],
        has_noise=all(len(sample.values) > 1 for side in sides for sample in side),
        is_one_seed=any(own[0] is not None and len(own) == 1 for own in seeds),
    )  # fmt: skip


def _make_sample(row: Row, column: str, names: list[Row]) -> Sample:
    """The metric of a cell; its reference is named by the first row that has this reference."""
    found = next((i for i, other in enumerate(names) if _has_same_reference(row, other)), len(names))
    if found == len(names):
        names.append(row)
    seed = row["options"].get(SEED) if row.get("is_random") else None
    return Sample(row["left_out"].get(column) or [row[column]], str(found), seed)


def _has_same_reference(a: Row, b: Row) -> bool:
    values = [[keep_finite(row.get(name)) for name in FINGERPRINT] for row in (a, b)]
    return None not in values[0] + values[1] and all(
        math.isclose(x, y, rel_tol=SAME_REFERENCE) for x, y in zip(*values, strict=True) if x is not None
    )


def _divide_sizes(sides: Sequence[Floats]) -> float:
    """log(|b| / |a|), each the mean over seeds; 0 / 0 is 1."""
    a, b = (float(np.abs(side).mean()) for side in sides)
    if a == b:
        return 0.0
    return math.log(b / a) if a and b else math.copysign(math.inf, b - a)


def _exponentiate(value: float) -> float:
    return math.exp(value) if value < 700 else math.inf


def _decide(changes: Sequence[Change], columns: Mapping[str, Column]) -> list[Change]:
    """The changes of errors with their verdicts, each under the noise of all."""
    p = np.array([_compute_p(each.log_ratio) for each in changes])
    has_noise = np.array([0 < each.log_ratio.standard_error < math.inf for each in changes], bool)
    if has_noise.any():  # a number without noise is no test
        p[has_noise] = scipy.stats.false_discovery_control(p[has_noise])
    found = []
    for each, chance in zip(changes, p, strict=True):
        if chance <= 1 - CONFIDENCE:
            verdict = WORSE if (each.log_ratio.value > 0) == columns[each.column].lower_is_better else BETTER
        elif _is_inside(each.log_ratio) and not any(map(each.log_ratio.is_unresolved, EDGES)):
            verdict = EQUAL
        else:
            verdict = NOISE
        found.append(each._replace(verdict=verdict))
    return found


def _is_inside(log_ratio: Estimate) -> bool:
    return EDGES[0] <= log_ratio.value <= EDGES[1]


def _compute_p(log_ratio: Estimate) -> float:
    """The chance that noise alone moves a ratio this far out of the margin; 1 if it is inside."""
    if _is_inside(log_ratio) or log_ratio.standard_error == math.inf:
        return 1.0
    if log_ratio.standard_error == 0:
        return 0.0
    distance = min(abs(log_ratio.value - edge) for edge in EDGES)
    return 2 * float(scipy.special.stdtr(log_ratio.degrees, -distance / log_ratio.standard_error))


def _sort(changes: Sequence[Change], columns: Mapping[str, Column]) -> list[Change]:
    """The changes of errors, those that became worse by the largest factor first."""
    return sorted(changes, key=lambda each: -each.ratio if columns[each.column].lower_is_better else each.ratio)


def _compare_times(before: Sequence[Row], after: Sequence[Row]) -> Change:
    a, b, verdict = compare_times(before, after)
    return Change(before[0], after[0], "shade_seconds", a, b, Estimate(math.log(b / a)), verdict)
