"""Methods and metrics in words: what the run that made the results knew of them, with equations and sources."""

import re
from collections.abc import Sequence
from typing import NamedTuple

from glossbench.findings.descriptions import Descriptions

from .notation import Run, split_runs

ABSENT = "Of a plug-in that is not installed here."
INSTALLED = "The results do not say what the run knew of its methods: these are the words of what is installed here."


class MethodText(NamedTuple):
    """A method as a report tells of it.

    Attributes:
        equation: in the notation of typst; "" where the class states none.
        text: what the docstring says before its attributes, paragraphs of runs; without the clause that the equation
            says.
        source: where it comes from, and how it differs from that.
    """

    name: str
    equation: str
    text: list[list[Run]]
    source: str


class Definition(NamedTuple):
    """What a metric is: its unit, and the formula of its number in plain text, "" where that is not known."""

    name: str
    unit: str
    formula: str


def define_metrics(names: Sequence[str], known: Descriptions) -> list[Definition]:
    """The metrics of these columns."""
    found = []
    for name in names:
        of = known.find("metric", name) or known.find("metric", name.partition(" ")[0])
        found.append(Definition(name, "" if of is None or of.unit == "1" else of.unit, of.formula if of else ""))
    return found


def describe_methods(names: Sequence[str], known: Descriptions) -> list[MethodText]:
    """The methods of these names, in this order; one that is not known says so."""
    return [_describe_method(name, known) for name in dict.fromkeys(names)]


def _describe_method(name: str, known: Descriptions) -> MethodText:
    found = known.find("method", name)
    if found is None:
        return MethodText(name, "", [split_runs(ABSENT)], "")
    paragraphs = [" ".join(part.split()) for part in re.split(r"\n\s*\n", found.text)]
    text = [part for part in paragraphs if not part.startswith(("Attributes:", "Args:", "Source:"))]
    if found.equation and text:
        text[0] = _remove_formulas(text[0])
    return MethodText(name, found.equation, [split_runs(part) for part in text if part], found.source)


def _remove_formulas(text: str) -> str:
    """A paragraph without the clauses at its beginning that are formulas, which the equation says."""
    begin = depth = 0
    for end, letter in enumerate(text, 1):
        depth += (letter in "([") - (letter in ")]")
        if depth == 0 and letter in ",:." and text[end : end + 1] in (" ", ""):
            if not re.search(r" [~=] ", text[begin:end]):
                rest = text[begin:]
                return f"with {rest}" if rest[0].islower() else rest
            begin = end + 1
    return ""
