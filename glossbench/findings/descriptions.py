"""Descriptions of the methods, materials, lights, views and metrics of a run, stored in its `described.json`.

A report prints these texts of the run, not those of the version that makes the report.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields
from inspect import cleandoc
from typing import Any

from glossbench.documentation import read_documentation
from glossbench.errors import InputError
from glossbench.findings.citations import extract_source, find_cited, load_references
from glossbench.options import Options
from glossbench.study.registries import REGISTRIES

KEYS = {"light": "light", "material": "material", "view": "view", "methods": "method", "metrics": "metric"}


@dataclass(frozen=True)
class Description:
    """One method, material, light, view or metric in words.

    Attributes:
        text: its docstring, without indentation.
        source: the text after "Source:" in the docstring.
        options: by name, the description of each option in the docstring, one sentence.
        equation: equation of a method, in typst's notation; "" if there is none.
        formula: formula of a metric.
        map_formula: formula of a metric, for one pixel.
        unit: unit of a metric; "1" if it has none.
    """

    kind: str
    name: str
    text: str = ""
    source: str = ""
    options: Mapping[str, str] = field(default_factory=dict)
    equation: str = ""
    formula: str = ""
    map_formula: str = ""
    unit: str = ""


@dataclass(frozen=True)
class Descriptions:
    """Everything that a study names, in words.

    Attributes:
        described: the descriptions, in the order of the study.
        references: by key, the BibTeX entries of the works that these, and the source of the study itself, cite.
        is_of_run: whether the run wrote them; else they come from what is installed here.
    """

    described: tuple[Description, ...]
    references: Mapping[str, str]
    is_of_run: bool = True

    def find(self, kind: str, name: str) -> Description | None:
        """The description of a name of a kind; None if it is not known."""
        return next((each for each in self.described if (each.kind, each.name) == (kind, name)), None)

    def as_dict(self) -> dict[str, Any]:
        """The contents of `described.json`."""
        return {"described": [asdict(each) for each in self.described], "references": dict(self.references)}

    @classmethod
    def from_dict(cls, stated: Any) -> "Descriptions":
        """The descriptions in the contents of `described.json`; InputError if these are something else."""
        known = {each.name for each in fields(Description)}
        try:
            own = [{key: value for key, value in each.items() if key in known} for each in stated["described"]]
            return cls(tuple(Description(**each) for each in own), dict(stated["references"]))
        except (TypeError, KeyError, AttributeError, ValueError):
            raise InputError("described.json does not hold descriptions") from None


def describe_study(study: Mapping[str, Any], is_of_run: bool = True) -> Descriptions:
    """The descriptions of everything that a resolved study names and that is installed here."""
    named = dict.fromkeys((kind, name) for key, kind in KEYS.items() for name in _list_names(study.get(key, ())))
    found = tuple(
        describe(kind, REGISTRIES[kind].get(name)) for kind, name in named if name in REGISTRIES[kind].names()
    )
    cited = {
        key for text in (*(each.source for each in found), str(study.get("source", ""))) for key in find_cited(text)
    }
    return Descriptions(found, {key: text for key, text in load_references().items() if key in cited}, is_of_run)


def describe(kind: str, cls: type[Options]) -> Description:
    """A class in words."""
    stated = {key: str(getattr(cls, key, "")) for key in ("equation", "formula", "map_formula", "unit")}
    text = read_documentation(cls)
    return Description(kind, cls.name, text, extract_source(text), describe_options(cls), **stated)


def describe_options(cls: type[Options]) -> dict[str, str]:
    """By name, the first sentence about each option under "Attributes:" in the docstring of a class."""
    described: dict[str, str] = {}
    for part in re.split(r"\n\s*\n", cleandoc(cls.__doc__ or "")):
        if not part.startswith("Attributes:"):
            continue
        for entry in re.split(r"\n {4}(?! )", part)[1:]:
            names, colon, text = entry.partition(": ")
            sentence = re.split(r"(?<=[^.])\.(?: |$)|; ", " ".join(text.split()))[0]
            described |= {name.strip(): sentence for name in names.split(",") if colon}
    return described


def _list_names(items: Iterable[Any]) -> Iterable[str]:
    return (item if isinstance(item, str) else next(iter(item)) for item in items)
