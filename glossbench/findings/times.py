"""Times: whether the shading times of two results can be compared, and which is longer."""

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

BUSY = 0.1  # share of the time that other work took; above it, times are at least a tenth too long
# A time is longer if its median is longer by this factor, and if no two of the timed runs overlap.
CHANGED_BY = 1.25
SLOWER, FASTER, UNCHANGED = "slower", "faster", "unchanged"


def explain_untimed(before: Sequence[Mapping[str, Any]], after: Sequence[Mapping[str, Any]]) -> str:
    """Why the shading times of a cell in two results cannot be compared; "" if they can.

    Args:
        before: parsed rows of the first result: one, or one for each seed of random points.
    """
    rows = (*before, *after)
    names = [dict.fromkeys(str(row.get("processor") or "unknown") for row in own) for own in (before, after)]
    if len({**names[0], **names[1]}) > 1:
        return f"different processors: {' and '.join(', '.join(own) for own in names)}"
    if any(not row.get("shade_runs") or row.get("shade_seconds_low") is None for row in rows):
        return "they were not measured"
    if len({str(row.get("kernels")) for row in rows}) > 1:
        return "kernels ran in different ways, eagerly or compiled"
    if any((row.get("busy") or 0) > BUSY for row in rows):
        return f"other programs used more than {100 * BUSY:.0f} % of the processor time"
    return ""


def compare_times(before: Sequence[Mapping[str, Any]], after: Sequence[Mapping[str, Any]]) -> tuple[float, float, str]:
    """The median shading times [s] of a cell in two results, and the verdict on the second."""
    a, b = (median(row["shade_seconds"] for row in rows) for rows in (before, after))
    if b > CHANGED_BY * a and _overlaps_not(after, before):
        return a, b, SLOWER
    if a > CHANGED_BY * b and _overlaps_not(before, after):
        return a, b, FASTER
    return a, b, UNCHANGED


def _overlaps_not(slow: Sequence[Mapping[str, Any]], fast: Sequence[Mapping[str, Any]]) -> bool:
    """Whether the fastest run of one result is slower than the slowest run of the other."""
    return bool(min(row["shade_seconds_low"] for row in slow) > max(row["shade_seconds_high"] for row in fast))
