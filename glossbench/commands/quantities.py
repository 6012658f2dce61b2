"""Quantities with units, as a user types them: "1 ms at 128^2", "4MB"."""

import re
from collections.abc import Callable, Mapping
from math import inf

from glossbench.errors import InputError, suggest_nearest

MILLISECONDS = {"us": 1e-3, "ms": 1.0, "s": 1e3}
MEGABYTES = {"kB": 1e-3, "MB": 1.0, "GB": 1e3, "KiB": 1024e-6, "MiB": 1024**2 * 1e-6, "GiB": 1024**3 * 1e-6}
_SIZES: Mapping[str, Callable[..., int]] = {
    r"(\d+) *\^ *2": lambda edge: edge**2,
    r"(\d+) *x *(\d+)": lambda width, height: width * height,
    r"(\d+)": lambda n: n,
}


def parse_budget(text: str) -> tuple[float, int | None]:
    """A time of a frame [ms] and its number of pixels, None if the text states none."""
    time, _, size = text.partition(" at ")
    milliseconds = _parse(time, MILLISECONDS, "--budget", "1 ms at 128^2")
    return milliseconds, _parse_size(size.strip()) if size else None


def parse_memory(text: str) -> float:
    """A size [MB]."""
    return _parse(text, MEGABYTES, "--memory", "4 MB")


def _parse(text: str, units: Mapping[str, float], option: str, example: str) -> float:
    found = re.fullmatch(r" *([\d.]+(?:e[+-]?\d+)?) *([^\W\d]+) *", text)
    try:
        value = float(found[1]) if found else 0.0
    except ValueError:
        value = 0.0
    if found is None or not 0 < value < inf:
        raise InputError(f'{option} must be a positive number with its unit, such as "{example}", got {text!r}')
    if found[2] not in units:
        raise InputError(f"{option}: no unit is called {found[2]!r}{suggest_nearest(found[2], units)}")
    return value * units[found[2]]


def _parse_size(text: str) -> int:
    for pattern, count in _SIZES.items():
        if found := re.fullmatch(pattern, text.removesuffix("pixels").strip()):
            if n := count(*map(int, found.groups())):
                return n
    raise InputError(f"--budget: the size must be such as 128^2, 640x480 or 16384, got {text!r}")
