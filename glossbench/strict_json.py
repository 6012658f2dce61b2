"""JSON that every reader takes, and that knows whether it is whole.

Standard JSON has no NaN and no infinity: they are null and the texts "Infinity" and "-Infinity".
"""

import json
from hashlib import sha256
from math import inf, isfinite, isnan
from typing import Any

_INFINITE = {"Infinity": inf, "-Infinity": -inf}
_CHECKSUM = "sha256"


def dumps(data: Any, **options: Any) -> str:
    """Standard JSON of some data; `options` are those of json.dumps."""
    return json.dumps(_standard(data), allow_nan=False, **options)


def loads(text: str | bytes) -> Any:
    """What `dumps` wrote, with its infinities; what was not a number is None."""
    return _infinite(json.loads(text))


def numbers(data: dict[str, Any]) -> dict[str, Any]:
    """A flat mapping as it was before `dumps`: what is null was not a number."""
    return {
        key: float("nan") if value is None else _INFINITE.get(value, value) if isinstance(value, str) else value
        for key, value in data.items()
    }


def sealed(data: dict[str, Any]) -> str:
    """JSON of a mapping, with a checksum of the rest as its last key."""
    standard = _standard(data)
    return json.dumps(standard | {_CHECKSUM: _checksum(standard)}, indent=1, allow_nan=False)


def unsealed(text: str | bytes) -> dict[str, Any]:
    """What was sealed; ValueError where it is not as it was. Without a checksum, as older files are, any mapping."""
    data = json.loads(text)
    if not isinstance(data, dict):
        raise ValueError("not a mapping")
    checksum = data.pop(_CHECKSUM, None)
    if checksum is not None and checksum != _checksum(data):
        raise ValueError("its checksum is another")
    return data


def _checksum(data: dict[str, Any]) -> str:
    return sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def _infinite(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _infinite(value) for key, value in data.items()}
    if isinstance(data, list):
        return [_infinite(value) for value in data]
    return _INFINITE.get(data, data) if isinstance(data, str) else data


def _standard(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _standard(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_standard(value) for value in data]
    if isinstance(data, float) and not isfinite(data):
        return None if isnan(data) else "Infinity" if data > 0 else "-Infinity"
    return data
