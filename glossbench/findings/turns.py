"""Turns: what would change the answer of a decision, and to what."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import ceil, floor, inf, log10
from typing import NamedTuple

from glossbench.columns import CONDITIONS
from glossbench.findings.decisions import Choice, Choices, choose
from glossbench.findings.ranks import Mean
from glossbench.findings.trials import Trials
from glossbench.shading.method import CHANGES


class Turn(NamedTuple):
    """Another need, or other conditions, with another answer.

    Attributes:
        when: in words, such as "with 2.4 ms".
        choice: the answer.
        ratio: its error over that of the present answer, if there is one that can be compared.
    """

    when: str
    choice: Choice
    ratio: Mean | None


def find_turns(choices: Choices, by_metric: Mapping[str, Trials]) -> list[Turn]:
    """What would change the answer.

    Args:
        by_metric: the trials of the other metrics of the results.
    """
    first = next(iter(choices.fitting), None)
    return [
        *_with_other_limits(choices, first),
        *_with_other_changes(choices, first),
        *_under_parts(choices, first),
        *_by_metrics(choices, first, by_metric),
    ]


def _with_other_limits(choices: Choices, first: Choice | None) -> Iterator[Turn]:
    """The cheapest better choice beyond each limit, and the next choice if the limit were below the present one."""
    need = choices.need
    better = [each for each in choices.all if first is None or choices.is_better(each, first)]
    freed = {"ms": replace(need, milliseconds=inf), "MB": replace(need, megabytes=inf)}
    found = 0
    for unit, other in freed.items():
        beyond = [each for each in better if each.fits(other) and not each.fits(need)]
        if beyond:
            each = min(beyond, key=lambda choice: _size(choice, unit))
            found += 1
            yield _turn(choices, f"with {_round_up(_size(each, unit))} {unit}", each, first)
    if first is None and not found and choices.all:
        each = min(choices.all, key=lambda choice: choice.milliseconds)
        sizes = f"{_round_up(each.milliseconds)} ms and {_round_up(each.megabytes)} MB"
        yield _turn(choices, f"with {sizes}", each, first)
    limited = ["ms", *(["MB"] if need.megabytes < inf else [])]
    if first is None:
        return
    for unit in limited:
        smaller = [each for each in choices.fitting if _size(each, unit) < _size(first, unit)]
        if smaller:
            yield _turn(choices, f"with less than {_round(_size(first, unit))} {unit}", smaller[0], first)


def _with_other_changes(choices: Choices, first: Choice | None) -> Iterator[Turn]:
    need = choices.need
    for change in CHANGES:
        is_now = change in need.changes
        changes = tuple(each for each in need.changes if each != change) if is_now else (*need.changes, change)
        other = choose(choices.trials, replace(need, changes=changes), choices.places)
        if answer := _find_other(other, first):
            when = f"if the {change} {'did not change' if is_now else 'changed in each frame, too'}"
            yield _turn(other, when, answer, first)


def _under_parts(choices: Choices, first: Choice | None) -> Iterator[Turn]:
    """Each light, material or view alone, if the answer is another one there."""
    for at, kind in enumerate(CONDITIONS):
        names = list(dict.fromkeys(choices.trials.conditions[n].names[at] for n in choices.places))
        for name in names if len(names) > 1 else ():
            places = [n for n in choices.places if choices.trials.conditions[n].names[at] == name]
            other = choose(choices.trials, choices.need, places)
            if answer := _find_other(other, first):
                yield _turn(other, f"for the {kind} {name} alone", answer, first)


def _by_metrics(choices: Choices, first: Choice | None, by_metric: Mapping[str, Trials]) -> Iterator[Turn]:
    for metric, trials in by_metric.items():
        other = choose(trials, choices.need, choices.places)
        if answer := _find_other(other, first):
            yield _turn(other, f"by {metric}", answer, first)


def _find_other(other: Choices, first: Choice | None) -> Choice | None:
    """The answer of other choices, if the present one does not fit, or is worse."""
    answer = next(iter(other.fitting), None)
    if answer is None or first is None:
        return answer
    same = _find(other.fitting, first)
    return answer if same is None or other.is_better(answer, same) else None


def _turn(choices: Choices, when: str, choice: Choice, first: Choice | None) -> Turn:
    same = _find(choices.all, first) if first else None
    return Turn(when, choice, choices.compare(choice, same) if same else None)


def _find(choices: Sequence[Choice], wanted: Choice) -> Choice | None:
    """The choice of the same configuration, which is another object in the choices of another need."""
    return next((each for each in choices if each.configuration.name == wanted.configuration.name), None)


def _size(choice: Choice, unit: str) -> float:
    return choice.milliseconds if unit == "ms" else choice.megabytes


def _round_up(value: float) -> str:
    """A number with 2 digits that is not below the value."""
    if not 0 < value < inf:
        return f"{value:g}"
    step = 10.0 ** (floor(log10(value)) - 1)
    return _round(ceil(value / step - 1e-9) * step)


def _round(value: float) -> str:
    return f"{float(f'{value:.3g}'):,g}"
