"""Conclusions: the verdict on a claim, and a sentence about it, from the cases of the claim."""

from collections import Counter
from collections.abc import Sequence

from glossbench.findings.comparisons import EQUAL, FAILS, HOLDS, NOISE, UNTESTED, Case
from glossbench.findings.estimates import Estimate


def conclude(cases: list[Case], quantity: str, notes: Counter[str], sides: Sequence[str]) -> tuple[str, str]:
    """(verdict on a claim, sentence with the counts and the extreme numbers)."""
    failed = notes.pop("cells failed", 0) if cases else 0
    left_out = "".join(f"; {what}: {count}" for what, count in sorted(notes.items()) if count)
    if not cases:
        why = left_out.removeprefix("; ") or "the run has no cell that it is about"
        return UNTESTED, f"Not tested: {why}."
    count = Counter(case.verdict for case in cases)
    verdict = next(v for v in (FAILS, HOLDS, EQUAL, NOISE) if count[v])
    others = "".join(f", {count[word]} {word}" for word in (EQUAL, NOISE) if count[word])
    low, high = (pick(cases, key=lambda case: case.found.value) for pick in (min, max))
    span = f"{_format_number(low.found)} ({low.where})"
    if len(cases) > 1:
        span = f"from {span} to {_format_number(high.found)} ({high.where})"
    first = f"Judged without {failed} of its cells, which failed. " if failed else ""
    counted = f"{first}Holds in {count[HOLDS]} of {len(cases)} cases{others}"
    return verdict, f"{counted}; {quantity}: {span}{_describe_seeds(cases, sides)}{left_out}."


def _format_number(found: Estimate) -> str:
    """A number and, if noise changes it, its 95 % interval."""
    if not found.standard_error:
        return f"{found.value:.4g}"
    return "{:.4g} [{:.4g}, {:.4g}]".format(found.value, *found.interval)


def _describe_seeds(cases: Sequence[Case], sides: Sequence[str]) -> str:
    """The number of seeds of random points on each side, in words; "" if no points are random."""
    told, least = [], 2
    for side, numbers in zip(sides, zip(*(case.seeds for case in cases), strict=True), strict=True):
        low, high = min(numbers), max(numbers)
        if high:
            told.append(f"{high if low == high else f'{low} to {high}'} of {side}")
            least = min(least, low or 1)
    unknown = " (one alone does not tell its spread)" if least == 1 else ""
    return f"; seeds: {', '.join(told)}{unknown}" if told else ""
