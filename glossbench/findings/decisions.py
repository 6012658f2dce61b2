"""Decisions: the configurations that fit what a user needs, best first, as far as the cells of results say.

A time is that of one frame: shading, and the stages that a change in each frame makes necessary again. Times and sizes
are the largest over the conditions, so that a configuration fits under each of them. Errors are compared by the mean of
their logarithms over conditions: the ratio of two configurations is a geometric mean. Its 95 % interval contains the
interval of the bootstrap over conditions (ranks.py) and that of the noise of the references.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import exp, inf
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from glossbench.columns import CONDITIONS
from glossbench.findings.estimates import CONFIDENCE
from glossbench.findings.ranks import Mean, average, draw_weights
from glossbench.findings.trials import SPREAD, Configuration, Floats, Trials, find_factor

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
        """Whether the 95 % interval of the ratio of their errors is below 1."""
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
    shade, update = _measure_times(trials, need)
    memory = trials.cost("memory")
    found, left_out = [], {}
    for index, each in enumerate(trials.configurations):
        missing = [n for n in at if not trials.done[index, n]]
        if missing:
            reason = each.reasons.get(missing[0], "no such cell")
            left_out[each.name] = f"{len(missing)} of {len(at)} conditions have no image; {reason}"
        elif np.isnan(shade[index, at]).any():
            left_out[each.name] = "its shading time is not known"
        elif np.isnan(update[index, at]).any():
            left_out[each.name] = f"its update for a new {' and '.join(need.changes)} is not known"
        else:
            slowest = at[int(np.argmax((shade + update)[index, at]))]
            times = float(shade[index, slowest]), float(update[index, slowest])
            is_stated = any(row.get("shade_runs") == 0 for n in at for row in each.cells[n])
            found.append(Choice(index, each, *times, slowest, float(memory[index, at].max()), is_stated))
    found.sort(key=lambda choice: float(trials.log_errors[choice.index, at].mean()))
    return Choices(trials, need, at, found, left_out)


def _measure_times(trials: Trials, need: Need) -> tuple[Floats, Floats]:
    """(shading, update) of each configuration under each condition [ms].

    For several changes the update is an upper bound, because results do not say which stages two changes share.
    """
    shade = trials.cost("shade")
    if need.n_pixels is not None:
        shade = shade * need.n_pixels / np.array([each.n_pixels for each in trials.conditions])
    update = np.array([trials.cost(change) for change in need.changes] or [0.0 * shade]).sum(axis=0)
    return shade, np.minimum(update, trials.stages) if len(need.changes) > 1 else update
