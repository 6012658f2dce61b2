"""Decisions: the configurations that fit what a user needs, best first, as far as the cells of results say.

A time is that of one frame: shading, and the stages that a change in each frame makes necessary again. Times and sizes
are the largest over the conditions, so that a configuration fits under each of them. Errors are compared by the mean of
their logarithms over conditions: the ratio of two configurations is a geometric mean. Its 95 % interval contains the
interval of the bootstrap over conditions (ranks.py) and that of the noise of the references.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import exp, inf, isnan
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from glossbench.columns import CONDITIONS
from glossbench.findings.costs import NEGLIGIBLE, read_named_cost
from glossbench.findings.estimates import CONFIDENCE
from glossbench.findings.ranks import Mean, average, draw_weights
from glossbench.findings.trials import SPREAD, Configuration, Floats, Row, Trials, find_factor

LIGHT = CONDITIONS.index("light")


@dataclass(frozen=True)
class Need:
    """What a user needs of a method.

    Attributes:
        changes: what changes in each frame, of the names in `CHANGES`.
        milliseconds: most time of a frame [ms].
        megabytes: most memory of the state [MB].
        n_pixels: pixels that are shaded; None for those that were measured.
    """

    changes: tuple[str, ...] = ()
    milliseconds: float = inf
    megabytes: float = inf
    n_pixels: float | None = None


@dataclass(frozen=True, eq=False)
class Choice:
    """A configuration that can be compared: it has an image and known costs under all conditions.

    Attributes:
        index: its index among the configurations of the trials.
        shade, update: times of the condition with the largest sum [ms].
        slowest: the index of this condition.
        megabytes: largest memory of its state [MB]; NaN if unknown.
        is_stated: whether its time was stated by its author, not measured with the others.
    """

    index: int
    configuration: Configuration
    shade: float
    update: float
    slowest: int
    megabytes: float
    is_stated: bool

    @property
    def milliseconds(self) -> float:
        """Time of a frame [ms]."""
        return self.shade + self.update

    def fits(self, need: Need) -> bool:
        """Whether its time and memory are within the limits; an unknown memory is not within a limit."""
        slack = 1 + 1e-9  # a limit that was printed with few digits and typed again is kept
        is_small = need.megabytes == inf or self.megabytes <= slack * need.megabytes
        return self.milliseconds <= slack * need.milliseconds and is_small


@dataclass(frozen=True, eq=False)
class Choices:
    """The configurations that can be compared under some conditions, the lowest error first.

    Attributes:
        places: the indices of the conditions.
        left_out: the other configurations, each with the reason.
    """

    trials: Trials
    need: Need
    places: Sequence[int]
    all: Sequence[Choice]
    left_out: Mapping[str, str]
    _ratios: dict[int, "_LogRatios"] = field(default_factory=dict)

    @property
    def fitting(self) -> list[Choice]:
        """Those within the limits."""
        return [each for each in self.all if each.fits(self.need)]

    def mean_error(self, choice: Choice) -> float:
        """The geometric mean of the error over the conditions."""
        return exp(self.trials.log_errors[choice.index, self.places].mean())

    def compare(self, choice: Choice, other: Choice) -> Mean:
        """The ratio of their errors, with its 95 % interval."""
        return Mean(*(float(np.exp(each[choice.index])) for each in self._compare_all(other.index)))

    def is_better(self, choice: Choice, other: Choice) -> bool:
        """Whether its error is lower with certainty."""
        return bool(self._compare_all(other.index).high[choice.index] < 0)

    def find_front(self, cost: str) -> list[Choice]:
        """The choices that no other one beats: to be better, at a largest cost that is not higher."""
        largest, factor = self.trials.cost(cost)[:, self.places].max(axis=1), find_factor(cost)
        return [
            each
            for each in self.all
            if not ((self._compare_all(each.index).high < 0) & (largest <= factor * largest[each.index])).any()
        ]

    def find_steps(self) -> list[Choice]:
        """The choice for each budget of time, within the limit of memory: the cheapest one, then each that is better.

        Times within the factor `SPREAD` count as equal: of such choices the better one is taken.
        """
        steps: list[Choice] = []
        fitting = [each for each in self.all if each.fits(Need(megabytes=self.need.megabytes))]
        for each in sorted(fitting, key=lambda choice: choice.milliseconds):
            if not steps:
                steps.append(each)
            elif self.is_better(each, steps[-1]):
                near = each.milliseconds <= SPREAD * steps[-1].milliseconds
                steps = [*steps[: -1 if near else None], each]
        return steps

    @cached_property
    def _weights(self) -> Floats:
        return draw_weights([self.trials.conditions[n] for n in self.places])

    def _compare_all(self, other: int) -> "_LogRatios":
        """The log ratio of each configuration's error to that of another one; NaN for those that cannot be compared."""
        if other not in self._ratios:
            errors = self.trials.log_errors[:, self.places]
            known = [each.index for each in self.all]
            means = average(errors[known] - errors[other], self._weights)
            mean, low, high = (np.full(len(errors), np.nan) for _ in range(3))
            mean[known], low[known], high[known] = np.array(means).T
            half = self._measure_noise(other)
            self._ratios[other] = _LogRatios(mean, np.minimum(low, mean - half), np.maximum(high, mean + half))
        return self._ratios[other]

    def _measure_noise(self, other: int) -> Floats:
        """Half of the 95 % interval of each mean log ratio to another configuration, by the noise of the references."""
        noise = [self.trials.noise[n] for n in self.places]
        variances = np.array([variance[:, other] for variance, _ in noise])
        squares = np.array([variance[:, other] ** 2 / degrees[:, other] for variance, degrees in noise]).sum(axis=0)
        total = variances.sum(axis=0)
        degrees = np.divide(total**2, squares, out=np.full_like(total, np.inf), where=squares > 0)
        return stdtrit(degrees, 0.5 + CONFIDENCE / 2) * np.sqrt(total) / len(noise)


class _LogRatios(NamedTuple):
    mean: Floats
    low: Floats
    high: Floats


def choose(trials: Trials, need: Need, places: Sequence[int] | None = None) -> Choices:
    """The configurations that can be compared under some conditions, by default under all."""
    at = list(range(len(trials.conditions))) if places is None else list(places)
    found, left_out = [], {}
    for index, configuration in enumerate(trials.configurations):
        reason = _find_obstacle(trials, configuration, need, at)
        if reason:
            left_out[configuration.name] = reason
        else:
            found.append(_make_choice(trials, index, need, at))
    found.sort(key=lambda choice: float(trials.log_errors[choice.index, at].mean()))
    return Choices(trials, need, at, found, left_out)


def _find_obstacle(trials: Trials, configuration: Configuration, need: Need, places: Sequence[int]) -> str:
    """Why a configuration cannot be compared; "" if it can."""
    missing = [n for n in places if n not in configuration.cells]
    if missing:
        reason = configuration.reasons.get(missing[0], "no such cell")
        return f"{len(missing)} of {len(places)} conditions have no image; {reason}"
    rows = [row for n in places for row in configuration.cells[n]]
    unknown = [cost for cost in ("shade", *need.changes) if any(isnan(read_named_cost(row, cost)) for row in rows)]
    if unknown:
        return (
            "its shading time is not known"
            if unknown[0] == "shade"
            else f"its update for a new {unknown[0]} is not known"
        )
    return ""


def _make_choice(trials: Trials, index: int, need: Need, places: Sequence[int]) -> Choice:
    configuration = trials.configurations[index]
    times: list[tuple[float, float]] = []
    for n in places:
        rows, pixels = configuration.cells[n], trials.conditions[n].n_pixels
        scale = 1.0 if need.n_pixels is None else need.n_pixels / pixels
        shade = float(np.median([read_named_cost(row, "shade") for row in rows]))
        times.append((scale * shade, float(np.median([_read_update(row, need.changes) for row in rows]))))
    slowest = max(range(len(places)), key=lambda i: sum(times[i]))
    rows = [row for n in places for row in configuration.cells[n]]
    memory = max(read_named_cost(row, "memory") for row in rows)
    is_stated = any(row.get("shade_runs") == 0 for row in rows)
    return Choice(index, configuration, *times[slowest], places[slowest], memory, is_stated)


def _read_update(row: Row, changes: Sequence[str]) -> float:
    """Time of the stages that must be redone [ms].

    For several changes it is an upper bound, because results do not say which stages two changes share.
    """
    if not changes:
        return 0.0
    parts = [read_named_cost(row, change) for change in changes]
    stages = 1e3 * sum(row["stage_seconds"].values())
    total = min(sum(parts), stages) if len(parts) > 1 else parts[0]
    return 0.0 if total < NEGLIGIBLE[changes[0]] else total
