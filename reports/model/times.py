"""Times in a report: how their spread is written, and remarks on how they were measured."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from ..style import format_number

BUSY = 0.1  # a larger share of the processor time in other programs is reported


def format_spread(middle: float | None, low: float | None, high: float | None) -> str:
    """The fastest and the slowest of several runs, in the given unit; "" if they are equal or not known."""
    if middle is None or low is None or high is None or not low < high:
        return ""
    return f"{format_number(low, 2)} to {format_number(high, 2)}"


def time_notes(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Remarks on times: the number of runs, the processors, and the load by other programs."""
    done = [row for row in rows if row["status"] == "done"]
    notes = []
    runs = sorted({int(row["shade_runs"]) for row in done if row.get("shade_runs")})
    if runs:
        several = f"{runs[0]} to {runs[-1]}" if len(runs) > 1 else f"{runs[0]}"
        notes.append(f"Shading times are medians of {several} runs, shown with the fastest and the slowest run.")
    processors = Counter(str(row["processor"]) for row in done if row.get("processor"))
    if len(processors) > 1:
        each = "; ".join(f"{name}: {count} cells" for name, count in processors.items())
        notes.append(f"Cells were timed on {len(processors)} processors, so their times cannot be compared ({each}).")
    busy = [row["busy"] for row in done if (row.get("busy") or 0) > BUSY]
    if busy:
        notes.append(
            f"The machine was busy while {len(busy)} of {len(done)} cells were timed: other programs used up to "
            f"{100 * max(busy):.0f} % of the processor time, so these times may be too long."
        )
    return notes
