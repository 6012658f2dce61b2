"""Citations: the literature that the sources of methods, materials, lights, views and metrics refer to, as BibTeX."""

import re
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

from glossbench.brdf.material import MATERIALS
from glossbench.documentation import documentation
from glossbench.envmap.lights.light import LIGHTS
from glossbench.metrics import METRICS
from glossbench.scene.points import VIEWS
from glossbench.shading.method import METHODS

REGISTRIES: dict[str, Any] = {
    "method": METHODS, "material": MATERIALS, "light": LIGHTS, "view": VIEWS, "metric": METRICS
}  # fmt: skip


class Citation(NamedTuple):
    """A work, and what cites it.

    Attributes:
        key: the first author's family name and the year.
        bibtex: the whole entry.
        cited_by: names, in order; "the study" for its own source.
    """

    key: str
    bibtex: str
    cited_by: Sequence[str]


@cache
def references() -> dict[str, str]:
    """The entries of references.bib by key."""
    text = (files("glossbench.data") / "references.bib").read_text(encoding="utf-8")
    return {match[1]: match[0] for match in re.finditer(r"^@\w+\{([\w-]+),.*?^\}", text, re.DOTALL | re.MULTILINE)}


def cited_in(text: str) -> list[str]:
    """Keys of the works that a text names as "Family 2014", "Family et al. 2014" or "Family and Other 2014"."""
    found = []
    for key in references():
        family, year = re.fullmatch(r"(.*?)(\d{4})", key).groups()  # type: ignore[union-attr]
        others = r"(?: et al\.|,? and [A-Z][\w-]+|, [A-Z][\w-]+)*"
        match = re.search(rf"\b{family}\b{others} {year}\b", text, re.IGNORECASE)
        if match:
            found.append((match.start(), key))
    return [key for _, key in sorted(found)]


def source_of(kind: str, name: str) -> str:
    """What the docstring of something registered says after "Source:"; "" without, or where it is not installed."""
    registry = REGISTRIES[kind]
    if name not in registry.names():
        return ""
    paragraphs = re.split(r"\n\s*\n", documentation(registry.get(name)))
    return next((" ".join(p.removeprefix("Source:").split()) for p in paragraphs if p.startswith("Source:")), "")


def cited_by(used: Sequence[tuple[str, str]], study_source: str = "") -> list[Citation]:
    """The works that these (kind, name) and the source of a study refer to, in this order."""
    named: dict[str, list[str]] = {}
    for name, text in [*((name, source_of(kind, name)) for kind, name in used), ("the study", study_source)]:
        for key in cited_in(text):
            named.setdefault(key, []).append(name)
    return [Citation(key, references()[key], names) for key, names in named.items()]
