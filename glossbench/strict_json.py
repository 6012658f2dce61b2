"""JSON that every reader accepts, with an optional checksum that shows whether it is complete.

Standard JSON has neither NaN nor infinity: they are written as null and as the texts "Infinity" and "-Infinity".
"""

import json
from hashlib import sha256
from math import inf, isfinite, isnan
from typing import Any

_INFINITE = {"Infinity": inf, "-Infinity": -inf}
_CHECKSUM = "sha256"


def dumps(data: Any, **options: Any) -> str:
    """Data as standard JSON; `options` are those of json.dumps."""
    return json.dumps(_standardize(data), allow_nan=False, **options)


def loads(text: str | bytes) -> Any:
    """The data that `dumps` wrote, with infinities restored; NaN becomes None."""
    return _restore_infinities(json.loads(text))


def restore_numbers(data: dict[str, Any]) -> dict[str, Any]:
    """A flat mapping as it was before `dumps`: None becomes NaN, and infinities are restored."""
    return {
        key: float("nan") if value is None else _INFINITE.get(value, value) if isinstance(value, str) else value
        for key, value in data.items()
    }


def seal(data: dict[str, Any]) -> str:
    """A mapping as JSON, whose last key is a checksum of the rest."""
    standard = _standardize(data)
    return json.dumps(standard | {_CHECKSUM: _compute_checksum(standard)}, indent=1, allow_nan=False)


def unseal(text: str | bytes) -> dict[str, Any]:
    """The mapping that `seal` wrote. Older files do not have a checksum; their mapping is not checked.

    Raises:
        ValueError: the text is not a mapping, or does not agree with its checksum.
    """
    data = json.loads(text)
    if not isinstance(data, dict):
        raise ValueError("not a mapping")
    checksum = data.pop(_CHECKSUM, None)
    if checksum is not None and checksum != _compute_checksum(data):
        raise ValueError("its checksum does not match")
    return data


def _compute_checksum(data: dict[str, Any]) -> str:
    return sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def _restore_infinities(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _restore_infinities(value) for key, value in data.items()}
    if isinstance(data, list):
        return [_restore_infinities(value) for value in data]
    return _INFINITE.get(data, data) if isinstance(data, str) else data


def _standardize(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _standardize(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_standardize(value) for value in data]
    if isinstance(data, float) and not isfinite(data):
        return None if isnan(data) else "Infinity" if data > 0 else "-Infinity"
    return data
