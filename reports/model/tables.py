"""Tables without cells: references, equal times and errors, the cases of claims."""

from collections.abc import Mapping
from typing import Any

from glossbench.study.labels import format_options

from ..style import format_number, format_tick, format_whole
from .equal import EqualTable
from .lines import name_lines
from .report import Report
from .table import Entry, Head, Part, Row, Table
from .times import format_spread

APART = (
    "where",
    "verdict",
    "low",
    "high",
    "seeds",
)  # of a case: shown at the ends of its row, or in the sentence of the claim


def make_reference_table(report: Report) -> Table:
    """The references, one for each light, material and view that has one."""
    rows = []
    for group in report.groups:
        if r := group.reference:
            mean, noise, target = (r.get(f"reference_{what}") for what in ("mean", "noise", "target"))
            relative = format_number(noise / mean, 2) if mean and noise is not None else "–"
            if target and noise and mean and noise > target:
                relative += f" (target {format_number(target / mean, 2)} not met)"
            texts = [format_number(mean), format_number(noise, 2), relative, format_whole(r["reference_samples"])]
            texts.append(format_number(r["reference_seconds"]))
            rows.append(Row([group.title], [Entry(text) for text in texts], notes=r.get("notes") or ()))
    heads = [Head("mean", "radiance"), Head("noise", "radiance"), Head("noise / mean")]
    heads += [Head("samples", "per pixel, all techniques"), Head("time", "s")]
    return Table([Head("light, material, view", is_number=False)], heads, [Part("", rows)])


def make_equal_table(equal: EqualTable, title: str, unit: str, most: int) -> Table:
    """The value of each line at equal times or errors; of very many lines the first, though all are compared.

    Args:
        title: the head of the names; "" for the method that all lines share, which is then left out of their names.
    """
    shared, names = name_lines([line.label for line in equal.lines])
    if title:
        names = [line.name for line in equal.lines]
    rows = []
    for i, (name, values) in enumerate(zip(names, equal.rows, strict=True)):
        entries = [
            Entry(format_number(value.middle), format_spread(*value), best == i) if value else Entry("–")
            for value, best in zip(values, equal.best, strict=True)
        ]
        rows.append(Row([name], entries))
    heads = [Head(format_tick(at), unit) for at in equal.at]
    return Table(
        [Head(title or shared or "method", is_number=False)], heads, [Part("", rows[:most], max(0, len(rows) - most))]
    )


def make_claim_table(claim: Mapping[str, Any], most: int) -> Table:
    """The cases of a claim, with one column per number; an interval is shown below its number."""
    cases = claim["numbers"]
    keys = list(dict.fromkeys(key for case in cases for key in case if key not in APART))
    rows = []
    for case in cases[:most]:
        where = case["where"] if isinstance(case["where"], str) else format_options(case["where"])
        entries = [
            Entry(_format_value(case.get(key)), _format_interval(case) if key == "value" else "") for key in keys
        ]
        rows.append(Row([where], [*entries, Entry(str(case.get("verdict", "")))]))
    heads = [*(Head(key) for key in keys), Head("verdict", is_number=False)]
    return Table([Head("where", is_number=False)], heads, [Part("", rows, max(0, len(cases) - most))])


def _format_interval(case: Mapping[str, Any]) -> str:
    low, high = case.get("low"), case.get("high")
    return "" if low is None or high is None or not low < high else f"{format_number(low)} to {format_number(high)}"


def _format_value(value: Any) -> str:
    if value is None or (isinstance(value, int | float) and not isinstance(value, bool)):
        return format_number(value)
    if isinstance(value, list):
        return " to ".join(format_number(each) for each in value)
    return format_options(value) if isinstance(value, Mapping) else str(value)
