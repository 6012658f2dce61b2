"""Facts in a report besides numbers: cells without an image, versions and hardware, options of each condition."""

from collections.abc import Mapping
from typing import NamedTuple

from glossbench.study.labels import format_options

from .conditions import Cell, Group
from .report import Report

# Columns with the origin of each cell: the provenance of the run describes only one of the processes.
OF_CELLS = {
    "version": "versions of the cells", "torch": "torch of the cells", "device": "devices of the cells",
    "seed": "seeds", "light_key": "light keys",
}  # fmt: skip


class MissingCell(NamedTuple):
    """A cell without an image, and why: a reason or a traceback, and its last line."""

    group: Group
    cell: Cell
    reason: str
    last: str

    @property
    def has_failed(self) -> bool:
        """Whether it raised an error; otherwise its method does not support it."""
        return bool(self.cell.row["status"] == "failed")


def without_image(report: Report) -> list[MissingCell]:
    """All cells without an image."""
    found = []
    for group in report.groups:
        for cell in group.cells:
            if not cell.done:
                reason = (cell.row["reason"] or "").strip() or "no reason is known"
                found.append(MissingCell(group, cell, reason, reason.splitlines()[-1]))
    return found


def list_provenance(report: Report) -> list[tuple[str, str]]:
    """Versions, time and machine of the results, and all options of each light, material and view."""
    facts = {key.replace("_", " "): value for key, value in report.provenance.items()}
    facts |= {title: ", ".join(seen) for column, title in OF_CELLS.items() if (seen := report.list_values(column))}
    if isinstance(report.study.get("reference"), Mapping):
        facts["reference"] = report.study["reference"]
    for group in report.groups:
        stated = (f"{kind}: {format_options(options) or 'no options'}" for kind, options in group.options.items())
        facts[group.title] = "; ".join(stated)
    return [
        (name, format_options(value) if isinstance(value, Mapping) else str(value)) for name, value in facts.items()
    ]


def compose_headline(report: Report) -> list[str]:
    """Versions, time and number of cells, and remarks on incomplete results."""
    n_done = sum(row["status"] == "done" for row in report.rows)
    counts = f"{len(report.rows)} cells" + ("" if n_done == len(report.rows) else f", {n_done} of them with an image")
    version, started = report.provenance.get("glossbench"), str(report.provenance.get("started", ""))[:10]
    return [text for text in (f"glossbench {version}" if version else "", started, counts, *report.remarks) if text]
