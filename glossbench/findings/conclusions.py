"""Conclusions: the verdict on a claim, and a sentence about it, from the cases of the claim."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from glossbench.findings.comparisons import EQUAL, FAILS, HOLDS, NOISE, UNTESTED, Case
from glossbench.findings.extent import describe_extent
from glossbench.findings.where_words import make_shortener, split_where

Numbers = Mapping[str, Any]  # one case as JSON types


def conclude(cases: list[Case], quantity: str, notes: Counter[str], sides: Sequence[str]) -> tuple[str, str]:
    """(verdict on a claim, sentence with the counts and the extreme numbers)."""
    failed = notes.pop("cells failed", 0) if cases else 0
    left_out = "".join(f"; {what}: {count}" for what, count in sorted(notes.items()) if count)
    if not cases:
        why = left_out.removeprefix("; ") or "the run has no cell of this claim"
        return UNTESTED, f"Not tested: {why}."
    count = Counter(case.verdict for case in cases)
    verdict = _decide(cases)
    others = "".join(f", {count[word]} {word}" for word in (EQUAL, NOISE) if count[word])
    numbers = [case.as_numbers() for case in cases]
    span = describe_span(numbers)
    first = f"Judged without {failed} of its cells, which failed. " if failed else ""
    counted = f"{first}Holds in {count[HOLDS]} of {len(cases)} cases{others}"
    told = "".join(f" {text}." for text in (*describe_readings(cases), describe_extent(numbers)) if text)
    return verdict, f"{counted}; {quantity}: {span}{_describe_seeds(cases, sides)}{left_out}.{told}"


def _decide(cases: Sequence[Case]) -> str:
    found = {case.verdict for case in cases}
    return next(verdict for verdict in (FAILS, HOLDS, EQUAL, NOISE) if verdict in found)


def describe_readings(cases: Sequence[Case]) -> list[str]:
    """By verdict, the readings of a claim that have it: "Holds by k 1: points r2 (0.36 to 0.4), halton (0.5 to 0.53)".

    Readings that differ in the last option alone are together. In brackets are the lowest and the highest number of the
    cases of the reading.
    """
    readings: dict[tuple[str, ...], list[Case]] = {}
    for case in cases:
        if case.reading:
            readings.setdefault(case.reading, []).append(case)
    told: dict[str, dict[str, list[str]]] = {}
    for (*first, last), of_reading in readings.items():
        numbers = sorted(case.found.value for case in of_reading)
        ends = " to ".join(dict.fromkeys(f"{number:.3g}" for number in (numbers[0], numbers[-1])))
        alike = told.setdefault(_decide(of_reading), {}).setdefault(", ".join(first), [])
        name, _, value = last.partition(" ")
        alike.append(f"{value if alike else f'{name} {value}'} ({ends})")
    found = []
    for verdict in (HOLDS, FAILS, EQUAL, NOISE):
        groups = [": ".join(filter(None, (first, ", ".join(last)))) for first, last in told.get(verdict, {}).items()]
        found += [f"{verdict.capitalize()} by {'; '.join(groups)}"] if groups else []
    return found


def describe_span(cases: Sequence[Numbers]) -> str:
    """The lowest and the highest number of a claim, each with its 95 % interval, and in which cases they are found.

    A case is named only by the words that not all cases share.
    """
    finite = [case for case in cases if case["value"] is not None]
    if not finite:
        return "infinite"
    low, high = (pick(finite, key=lambda case: case["value"]) for pick in (min, max))
    others = f"; not finite in {len(cases) - len(finite)} of {len(cases)} cases" if len(finite) < len(cases) else ""
    if low["value"] == high["value"]:
        return _format_number(low) + others
    names = zip(("lowest", "highest"), _distinguish([low, high], cases), strict=True)
    where = "".join(f"; {end} for {name}" for end, name in names if name)
    return f"{_format_number(low)} to {_format_number(high)}{where}{others}"


def _format_number(case: Numbers) -> str:
    """The number of a case and, if noise changes it, its 95 % interval; an end that is not finite is stored as None."""
    low, value, high = ("?" if case[key] is None else f"{case[key]:.4g}" for key in ("low", "value", "high"))
    return value if case["low"] == case["value"] == case["high"] else f"{value} [{low}, {high}]"


def _distinguish(named: Sequence[Numbers], cases: Sequence[Numbers]) -> list[str]:
    """For each named case, the words of its `where` that not all cases share."""
    words = [split_where(str(case["where"])) for case in cases]
    shared, shorten = set.intersection(*map(set, words)), make_shortener(words)
    found = []
    for case in named:
        own = words[next(i for i, each in enumerate(cases) if each is case)]
        found.append(", ".join(shorten(word) for word in own if word not in shared))
    return found


def _describe_seeds(cases: Sequence[Case], sides: Sequence[str]) -> str:
    """The number of seeds of random points on each side, in words; "" if no points are random."""
    told, least = [], 2
    for side, numbers in zip(sides, zip(*(case.seeds for case in cases), strict=True), strict=True):
        low, high = min(numbers), max(numbers)
        if high:
            told.append(f"{high if low == high else f'{low} to {high}'} of {side}")
            least = min(least, low or 1)
    unknown = " (the spread of a single seed is not known)" if least == 1 else ""
    return f"; seeds: {', '.join(told)}{unknown}" if told else ""
