"""Rows of the table of results: their values, and names from the options that tell them apart."""

import json
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np

KINDS = ("light", "material", "view")
JSON = (*(f"{kind}_options" for kind in KINDS), "options", "tuned", "stage_seconds", "update_seconds", "notes")


def parsed(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row with None for what is missing and values for what is JSON."""
    parsed = {key: None if isinstance(v, float) and np.isnan(v) else v for key, v in row.items()}
    for key in JSON:
        parsed[key] = json.loads(parsed.get(key) or "{}")
    return parsed


def told_apart(rows: Sequence[Mapping[str, Any]], over: str = "samples") -> tuple[list[str], list[str]]:
    """Options that tell the cells of one method apart, beside that which a plot is over; and without what it decides.

    Tuned options tell nothing, nor do those that are the number of samples by another name, where that is plotted over.
    """
    options = [row["options"] for row in rows]
    aside = {over} | {key for row in rows for key in row["tuned"]}
    if over == "samples":
        done = [(row["options"], row["n_samples"]) for row in rows if row["status"] == "done"]
        aside |= {key for key in _differing(options) if done and all(each.get(key) == n for each, n in done)}
    told = [key for key in _differing(options) if key not in aside]
    return told, [key for key in told if not _follows(key, over, options)]


def identity(kind: str, row: Mapping[str, Any], without: str = "") -> str:
    """What a light, material or view is, one of its parameters aside."""
    options = {key: value for key, value in row[f"{kind}_options"].items() if key != without}
    return json.dumps([row[kind], options], sort_keys=True)


def names_of(kind: str, rows: Sequence[Mapping[str, Any]], without: str = "") -> dict[str, str]:
    """By identity the name of each light, material or view, with the options in which those of one name differ."""
    known = {identity(kind, row, without): row for row in rows}
    named = {}
    for key, row in known.items():
        alike = [other[f"{kind}_options"] for other in known.values() if other[kind] == row[kind]]
        telling = [name for name in _differing(alike) if name not in (without, "file")]
        text = listed({name: row[f"{kind}_options"].get(name) for name in telling})
        called = PurePath(row[f"{kind}_options"]["file"]).name if row[kind] == "file" else str(row[kind])
        named[key] = f"{called} ({text})" if text else called
    return named


def listed(options: Mapping[str, Any]) -> str:
    """Options as names have them."""
    return ", ".join(f"{key} {as_text(value)}" for key, value in options.items())


def as_text(value: Any) -> str:
    """The value of an option, as names have it."""
    if isinstance(value, float):
        return f"{value:.4g}".replace("-", "−")
    if isinstance(value, list):
        return f"[{', '.join(as_text(each) for each in value)}]"
    return value if isinstance(value, str) else json.dumps(value)


def _follows(key: str, over: str, options: Sequence[Mapping[str, Any]]) -> bool:
    """Whether one option alone decides another, as where a study pairs them: then that tells no two lines apart.

    Two values of a budget may go with one of the other; of what is no budget each must have its own.
    """
    values: dict[str, set[str]] = {}
    for each in options:
        values.setdefault(json.dumps(each.get(over)), set()).add(json.dumps(each.get(key)))
    n_found = len(set[str]().union(*values.values()))
    is_single = len(values) > 1 and all(len(found) == 1 for found in values.values())
    return is_single and (over == "samples" or n_found == len(values))


def _differing(options: Sequence[Mapping[str, Any]]) -> list[str]:
    """Keys, in order, whose value is not the same in all."""
    keys = dict.fromkeys(key for each in options for key in each)
    return [key for key in keys if len({json.dumps(each.get(key)) for each in options}) > 1]
