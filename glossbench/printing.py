"""What the command line prints: lines, facts, the table of a run, the verdicts."""

import json
import time
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from glossbench.rows import KINDS, identity, listed, names_of, parsed, told_apart

if TYPE_CHECKING:
    import pandas
    from rich.progress import Progress

BUSY = 0.1  # share of the time that other work took; times are then a tenth too long or more
out = Console()
err = Console(stderr=True)
PULSE = 30.0  # seconds between two lines


class Pulse:
    """A bar's progress where no terminal draws it, in a log say: a line on standard error, at most one a `PULSE`."""

    def __init__(self, bar: "Progress") -> None:
        self.bar, self.last = bar, time.monotonic()

    def __call__(self) -> None:
        if err.is_terminal or time.monotonic() - self.last < PULSE:
            return
        self.last, task = time.monotonic(), self.bar.tasks[0]
        done = f"{task.completed:.0f} of {task.total or 0:.0f} cells, {task.elapsed or 0:.0f} s"
        err.print(f"{done}: {task.description}", markup=False, highlight=False, soft_wrap=True)


def say(text: str) -> None:
    """Text as it is on standard output, a line a line, however long."""
    out.print(text, markup=False, highlight=False, soft_wrap=True)


def print_rows(rows: dict[str, str]) -> None:
    """What something is, a line a fact, and an empty line; facts that are empty are left out."""
    stated = [(fact, line) for fact, value in rows.items() for line in value.splitlines()]
    width = max((len(fact) for fact, _ in stated), default=0)
    before = ""
    for fact, line in stated:
        label = "" if fact == before else fact
        out.print(Text.assemble((f"{label:<{width}}", "bold"), "  ", line), soft_wrap=True)
        before = fact
    if stated:
        out.print()


def print_table(cells: "pandas.DataFrame", metrics: list[str]) -> None:
    """The cells of a run, a row each: names with the options that tell them apart."""
    rows = [parsed(row) for row in cells.to_dict("records")]
    names = {kind: names_of(kind, rows) for kind in KINDS}
    kinds = [kind for kind in KINDS if kind != "view" or len(names[kind]) > 1]
    told = {row["method"]: told_apart([other for other in rows if other["method"] == row["method"]])[1] for row in rows}
    table = Table(box=None, pad_edge=False)
    for heading in (*kinds, "method"):
        table.add_column(heading)
    for heading in ("samples", *metrics, "shade ms"):
        table.add_column(heading, justify="right")
    for row in rows:
        options = listed({key: row["options"].get(key) for key in told[row["method"]]})
        method = f"{row['method']} ({options})" if options else row["method"]
        named = [Text(name) for name in (*(names[kind][identity(kind, row)] for kind in kinds), method)]
        if row["status"] != "done":
            table.add_row(*named, row["status"])
            continue
        numbers = [
            "floor" if row["at_noise_floor"] and name != "mean_error" else f"{row[name]:.4g}" for name in metrics
        ]
        table.add_row(*named, str(row["n_samples"]), *numbers, f"{1000 * row['shade_seconds']:.1f}")
    # Numbers that a narrow window, or a file, would cut are of no use.
    needed = out.measure(table, options=out.options.update(max_width=1000)).maximum
    Console(width=max(needed, out.width)).print(table, soft_wrap=True)
    for row in rows:
        if row["status"] != "done":
            say(f"{row['status']}: {row['method']}: {row['reason'].strip().splitlines()[-1]}")


def print_verdicts(claims: list[dict[str, Any]]) -> None:
    """The claims of a study, each with its verdict."""
    styles = {"holds": "green", "does not hold": "red", "within noise": "yellow"}
    for claim in claims:
        out.print()
        out.print(claim["verdict"], style=styles.get(claim["verdict"], "dim"), end="  ", highlight=False)
        out.print(f"{claim['text']}\n  {claim['summary']}", markup=False, highlight=False)
    out.print()


def print_notes(cells: "pandas.DataFrame") -> None:
    """What was repaired or fitted, a line each, once."""
    for note in dict.fromkeys(note for notes in cells["notes"] for note in json.loads(notes)):
        err.print(f"note: {note}", style="yellow", markup=False, highlight=False, soft_wrap=True)


def warn_of_noise(cells: "pandas.DataFrame") -> None:
    """One line if references stopped at their largest number of samples before they met the noise asked for."""
    references = cells.drop_duplicates("reference_key")
    missed = references[references["reference_noise"] > references["reference_target"]]
    if len(missed):
        worst = (missed["reference_noise"] / missed["reference_mean"]).max()
        wanted = (missed["reference_target"] / missed["reference_mean"]).min()
        err.print(
            f"{len(missed)} of {len(references)} references did not meet the noise asked for: {100 * worst:.2g} % of "
            f"the mean for {100 * wanted:.2g} %, at reference.max_samples",
            style="yellow", highlight=False, soft_wrap=True,
        )  # fmt: skip


def warn_of_times(cells: "pandas.DataFrame") -> None:
    """A line where times do not compare: the machine was busy, or cells were timed on two processors."""
    done = cells[cells["status"] == "done"]
    busy = int((done["busy"] > BUSY).sum())
    if busy:
        text = f"{busy} of {len(done)} cells were timed while other programs took the processor for "
        text += f"{100 * done['busy'].max():.0f} % of the time at worst: their times are too long"
        err.print(text, style="yellow", markup=False, highlight=False, soft_wrap=True)
    processors = list(dict.fromkeys(done["processor"]))
    if len(processors) > 1:
        text = f"cells were timed on {len(processors)} processors, whose times do not compare: {', '.join(processors)}"
        err.print(text, style="yellow", markup=False, highlight=False, soft_wrap=True)
