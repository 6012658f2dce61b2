"""Citations: the literature that methods, materials, lights, views and metrics name as their sources, as BibTeX."""

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import NamedTuple

from glossbench.documentation import read_documentation
from glossbench.study.registries import REGISTRIES


class Citation(NamedTuple):
    """A work, and what cites it.

    Attributes:
        key: the first author's family name and the year.
        bibtex: the whole entry.
        cited_by: names of what cites it, in order; "the study" for the source of the study itself.
    """

    key: str
    bibtex: str
    cited_by: Sequence[str]


@cache
def load_references() -> dict[str, str]:
    """The entries of references.bib by key."""
    text = (files("glossbench.data") / "references.bib").read_text(encoding="utf-8")
    return {match[1]: match[0] for match in re.finditer(r"^@\w+\{([\w-]+),.*?^\}", text, re.DOTALL | re.MULTILINE)}


def find_cited(text: str, known: Mapping[str, str] | None = None) -> list[str]:
    """Keys of the works that a text names as "Family 2014", "Family et al. 2014" or "Family and Other 2014".

    Args:
        known: entries by key; those of references.bib by default.
    """
    found = []
    for key in load_references() if known is None else known:
        family, year = key[:-4], key[-4:]
        others = r"(?: et al\.|,? and [A-Z][\w-]+|, [A-Z][\w-]+)*"
        match = re.search(rf"\b{family}\b{others} {year}\b", text, re.IGNORECASE)
        if match:
            found.append((match.start(), key))
    return [key for _, key in sorted(found)]


def find_source(kind: str, name: str) -> str:
    """The text after "Source:" in the docstring of a registered class; "" if there is none, or it is not installed."""
    registry = REGISTRIES[kind]
    return extract_source(read_documentation(registry.get(name))) if name in registry.names() else ""


def extract_source(text: str) -> str:
    """The text after "Source:" in a docstring; "" if there is none."""
    paragraphs = re.split(r"\n\s*\n", text)
    return next((" ".join(p.removeprefix("Source:").split()) for p in paragraphs if p.startswith("Source:")), "")


def collect_citations(used: Sequence[tuple[str, str]], study_source: str = "") -> list[Citation]:
    """The works that the installed classes (kind, name), and then the source of a study, refer to, in this order."""
    return collect_citations_of_sources(
        [(name, find_source(kind, name)) for kind, name in used], study_source, load_references()
    )


def collect_citations_of_sources(
    sources: Iterable[tuple[str, str]], study_source: str, known: Mapping[str, str]
) -> list[Citation]:
    """The works that some sources, and then the source of a study, refer to, in this order.

    Args:
        sources: (name of the class, text of its source).
        known: BibTeX entries by key.
    """
    named: dict[str, list[str]] = {}
    for name, text in [*sources, ("the study", study_source)]:
        for key in find_cited(text, known):
            named.setdefault(key, []).append(name)
    return [Citation(key, known[key], names) for key, names in named.items()]
