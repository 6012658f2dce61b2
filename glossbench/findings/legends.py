"""Legends: one sentence for each word of a table or a verdict that a reader may not know."""

from collections.abc import Mapping, Sequence
from typing import Any

from glossbench.columns import CONDITIONS
from glossbench.findings.comparisons import EQUAL, NOISE
from glossbench.findings.descriptions import Descriptions, describe_options
from glossbench.study.labels import distinguish_rows, find_differing
from glossbench.study.registries import REGISTRIES

WITHIN_NOISE = (
    "the 95 % interval contains what the number is compared with, so the reference is not accurate enough to say on "
    "which side it is"
)
WITHIN_MARGIN = "the two differ by less than the claim's margin, with certainty"
INTERVAL = (
    "in 95 of 100 cases it contains the number that a perfect reference would give; it comes from the error of the "
    "reference and, if a method has several seeds, from their spread"
)
FLOOR = (
    "the RMS error is below twice the noise of the reference, so the reference is not accurate enough to measure it; "
    "all such cells are equally good"
)


def explain_verdicts(claims: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """The meaning of "within noise", "equal" and an interval, as far as a verdict or one of its numbers has them."""
    words = {claim["verdict"] for claim in claims} | {word for claim in claims for word in _list_verdicts(claim)}
    said = {word: text for word, text in ((EQUAL, WITHIN_MARGIN), (NOISE, WITHIN_NOISE)) if word in words}
    has_interval = any(case.get("low") != case.get("high") for claim in claims for case in claim.get("numbers") or ())
    return said | ({"[low, high]": INTERVAL} if has_interval else {})


def explain_table(
    rows: Sequence[Mapping[str, Any]], with_decided: bool = True, descriptions: Descriptions | None = None
) -> dict[str, str]:
    """The meaning of "floor", if a cell is there, and of the options that distinguish the names of a table.

    Args:
        with_decided: whether names also hold the options that the budget determines.
        descriptions: those of the results, if they have their own; default: what is installed here.
    """
    said = {"floor": FLOOR} if any(row["at_noise_floor"] for row in rows) else {}
    found: dict[str, dict[str, str]] = {}  # option -> its description -> the name that has it
    for kind, name, option in _find_distinguishing_options(rows, with_decided):
        if text := _find_options(kind, name, descriptions).get(option):
            found.setdefault(option, {}).setdefault(text, name)
    for option, texts in found.items():
        said |= {option if len(texts) == 1 else f"{option} of {name}": text for text, name in texts.items()}
    return said


def _find_options(kind: str, name: str, descriptions: Descriptions | None) -> Mapping[str, str]:
    if descriptions is not None:
        found = descriptions.find(kind, name)
        return found.options if found else {}
    return describe_options(REGISTRIES[kind].get(name)) if name in REGISTRIES[kind].names() else {}


def _list_verdicts(claim: Mapping[str, Any]) -> list[str]:
    return [str(case.get("verdict", "")) for case in claim.get("numbers") or ()]


def _find_distinguishing_options(rows: Sequence[Mapping[str, Any]], with_decided: bool) -> list[tuple[str, str, str]]:
    """(kind, name, option) for each option in the names of a table, once."""
    found: dict[tuple[str, str, str], None] = {}
    for kind in CONDITIONS:
        alike: dict[str, list[Mapping[str, Any]]] = {}
        for row in rows:
            alike.setdefault(row[kind], []).append(row[f"{kind}_options"])
        found |= {(kind, name, key): None for name, every in alike.items() for key in find_differing(every)}
    for row, (options, line) in zip(rows, distinguish_rows(rows), strict=True):
        found |= {("method", str(row["method"]), option): None for option in (options if with_decided else line)}
    return list(found)
