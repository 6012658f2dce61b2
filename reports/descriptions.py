"""Methods in words: what the docstring of each that a study used says, with its equation and its source."""

import re
from collections.abc import Sequence
from inspect import cleandoc
from typing import NamedTuple

from glossbench.shading import METHODS

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


def described(names: Sequence[str]) -> list[Description]:
    """The methods of these names, in this order; one whose plug-in is not installed here says so."""
    return [_described(name) for name in dict.fromkeys(names)]


def _described(name: str) -> Description:
    if name not in METHODS.names():
        return Description(name, "", [runs("Of a plug-in that is not installed here.")], "")
    cls = METHODS.get(name)
    equation = str(getattr(cls, "equation", ""))
    paragraphs = [" ".join(part.split()) for part in re.split(r"\n\s*\n", cleandoc(cls.__doc__ or ""))]
    text = [part for part in paragraphs if not part.startswith(("Attributes:", "Args:", "Source:"))]
    source = next((part.removeprefix("Source:").strip() for part in paragraphs if part.startswith("Source:")), "")
    if equation and text:
        text[0] = _after_first_clause(text[0])
    return Description(name, equation, [runs(part) for part in text if part], source)


def _after_first_clause(text: str) -> str:
    """A sentence from the first comma or colon on that is in no brackets: before it stands the formula."""
    depth = 0
    for i, letter in enumerate(text):
        depth += (letter in "([") - (letter in ")]")
        if depth == 0 and letter in ",:" and text[i + 1 : i + 2] == " ":
            return text[i + 2 :]
        if depth == 0 and letter == "." and text[i + 1 : i + 2] in (" ", ""):
            return text[i + 2 :]
    return ""
