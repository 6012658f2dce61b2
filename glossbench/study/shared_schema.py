"""A JSON Schema without repetition: a part that occurs more than once is stated once, under $defs."""

import json
from collections import Counter
from collections.abc import Iterator
from typing import Any

LISTS = ("anyOf", "prefixItems")  # keys that hold a list of schemas
MAPS = ("properties", "$defs")  # keys that map names to schemas
SINGLE = ("items", "additionalProperties", "propertyNames")
MIN_LENGTH = 80  # characters; a reference to a shorter part would save nothing


def share_parts(schema: dict[str, Any]) -> dict[str, Any]:
    """The schema with its repeated parts under $defs, each named after the place where it occurs first."""
    counts = Counter(text for text, _ in _find_parts(schema, ()))
    names: dict[str, str] = {}
    taken = Counter(list(schema["$defs"]))
    for text, path in _find_parts(schema, ()):
        if counts[text] > 1 and len(text) > MIN_LENGTH and text not in names:
            name = ".".join(path)
            names[text] = f"{name}.{taken[name] + 1}" if taken[name] else name
            taken[name] += 1
    definitions = {name: _insert_references(json.loads(text), names, is_top=True) for text, name in names.items()}
    whole = _insert_references(schema, names, is_top=True)
    return {**whole, "$defs": {**whole["$defs"], **definitions}}


def _find_parts(schema: dict[str, Any], path: tuple[str, ...]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Every schema below one, as canonical text, with the names on the path to it; also inside repeated parts."""
    for part, name in _find_children(schema):
        below = (*path, name) if name else path
        yield json.dumps(part, sort_keys=True), below
        yield from _find_parts(part, below)


def _find_children(schema: dict[str, Any]) -> Iterator[tuple[dict[str, Any], str]]:
    for key in LISTS:
        yield from ((part, "") for part in schema.get(key, []))
    for key in MAPS:
        yield from ((part, name) for name, part in schema.get(key, {}).items())
    yield from ((schema[key], "") for key in SINGLE if isinstance(schema.get(key), dict))


def _insert_references(schema: dict[str, Any], names: dict[str, str], is_top: bool = False) -> dict[str, Any]:
    """The schema with a reference in place of each part that has a name."""
    text = json.dumps(schema, sort_keys=True)
    if text in names and not is_top:
        return {"$ref": f"#/$defs/{names[text]}"}
    found = dict(schema)
    for key in LISTS:
        if key in found:
            found[key] = [_insert_references(part, names) for part in found[key]]
    for key in MAPS:
        if key in found:
            found[key] = {name: _insert_references(part, names) for name, part in found[key].items()}
    for key in SINGLE:
        if isinstance(found.get(key), dict):
            found[key] = _insert_references(found[key], names)
    return found
