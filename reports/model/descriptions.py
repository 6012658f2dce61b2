"""Descriptions of methods and metrics as the run recorded them, with equations and sources."""

import re
from collections.abc import Sequence
from typing import NamedTuple

from glossbench.findings.descriptions import Descriptions

from .notation import Run, split_runs

ABSENT = "It belongs to a plug-in that is not installed here."
INSTALLED = "The results do not describe their methods; these descriptions are those of the installed methods."


class MethodText(NamedTuple):
    """The description of a method in a report.

    Attributes:
        equation: in the notation of typst; "" if the class does not state one.
        text: the docstring before its attributes, as paragraphs of runs, without the formula that the equation shows.
        source: the source of the method, and how it differs from it.
    """

    name: str
    equation: str
    text: list[list[Run]]
    source: str


class Definition(NamedTuple):
    """A metric: its unit, and its formula in plain text; "" if it is not known."""

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
    """The methods with these names, in this order; the text of an unknown method says that it is unknown."""
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
    """A paragraph without the formulas at its beginning, which the equation already shows."""
    begin = depth = 0
    for end, letter in enumerate(text, 1):
        depth += (letter in "([") - (letter in ")]")
        if depth == 0 and letter in ",:." and text[end : end + 1] in (" ", ""):
            if not re.search(r" [~=] ", text[begin:end]):
                rest = text[begin:]
                return f"with {rest}" if rest[0].islower() else rest
            begin = end + 1
    return ""
