"""Methods in words: what the docstring of each that a study used says, with its equation and its source."""

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from glossbench.documentation import documentation
from glossbench.findings.columns import Column
from glossbench.metrics import METRICS
from glossbench.shading.method import METHODS

from .notation import Run, runs


class Description(NamedTuple):
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
    """What a metric is: its unit, and the formula of its number in plain text."""

    name: str
    unit: str
    formula: str


def defined(names: Sequence[str], columns: Mapping[str, Column]) -> list[Definition]:
    """The metrics of these names; of one whose plug-in is not installed here, the unit that the run wrote down."""
    return [
        Definition(name, columns[name].unit, METRICS.get(name).formula if name in METRICS.names() else "")
        for name in names
    ]


def described(names: Sequence[str]) -> list[Description]:
    """The methods of these names, in this order; one whose plug-in is not installed here says so."""
    return [_described(name) for name in dict.fromkeys(names)]


def _described(name: str) -> Description:
    if name not in METHODS.names():
        return Description(name, "", [runs("Of a plug-in that is not installed here.")], "")
    cls = METHODS.get(name)
    equation = str(getattr(cls, "equation", ""))
    paragraphs = [" ".join(part.split()) for part in re.split(r"\n\s*\n", documentation(cls))]
    text = [part for part in paragraphs if not part.startswith(("Attributes:", "Args:", "Source:"))]
    source = next((part.removeprefix("Source:").strip() for part in paragraphs if part.startswith("Source:")), "")
    if equation and text:
        text[0] = _after_formulas(text[0])
    return Description(name, equation, [runs(part) for part in text if part], source)


def _after_formulas(text: str) -> str:
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
