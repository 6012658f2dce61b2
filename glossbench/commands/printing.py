"""Output of the command line: lines, facts, the table of a run, the verdicts."""

import json
import time
from typing import TYPE_CHECKING, Any

from rich.table import Table
from rich.text import Text

from glossbench.columns import COLUMNS, CONDITIONS, parse_row
from glossbench.commands.consoles import Console, escape_controls
from glossbench.findings.times import BUSY
from glossbench.study.labels import distinguish_rows, identify, name_items, with_options

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas
    from rich.progress import Progress

    from glossbench.study.cells import Cell

out = Console()
err = Console(stderr=True)
PULSE = 30.0  # seconds between two lines
MAX_ROWS = 40  # in a table, and in the list of reasons below it, so that both fit on a terminal


class Pulse:
    """The progress of a bar without a terminal, as in a log: at most one line per `PULSE` on standard error."""

    def __init__(self, bar: "Progress", what: str) -> None:
        self.bar, self.what, self.last = bar, what, time.monotonic()

    def __call__(self) -> None:
        if err.is_terminal or time.monotonic() - self.last < PULSE:
            return
        self.last, task = time.monotonic(), self.bar.tasks[0]
        done = f"{task.completed:.0f} of {task.total or 0:.0f} {self.what}, {task.elapsed or 0:.0f} s"
        err.print(escape_controls(f"{done}: {task.description}"), soft_wrap=True)


def say(text: str) -> None:
    """Print one line of any length on standard output; line ends inside it, as in a file's name, are escaped."""
    out.print(escape_controls(text), soft_wrap=True)


def say_lines(text: str) -> None:
    """Print text of several lines, unchanged."""
    out.print(text, soft_wrap=True)


def note(text: str) -> None:
    """Print one line about something unusual on standard error."""
    err.print(escape_controls(f"note: {text}"), style="yellow", soft_wrap=True)


def print_rows(rows: dict[str, str]) -> None:
    """Print facts, one per line, and an empty line; empty facts are left out."""
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
    """Print the first cells of a run, one row each, named by the options that distinguish them.

    The number of further cells, and the reasons of cells that were skipped or failed, follow.
    """
    from glossbench.findings.legends import explain_table  # late, because it imports torch

    rows = [parse_row(row) for row in cells.to_dict("records")]
    names = {kind: name_items(kind, rows) for kind in CONDITIONS}
    kinds = [kind for kind in CONDITIONS if kind != "view" or len(names[kind]) > 1]
    methods = name_methods(rows)
    table = Table(box=None, pad_edge=False)
    for heading in (*kinds, "method"):
        table.add_column(heading)
    brief = {name: column for name, column in COLUMNS.items() if column.short}
    before, after = (
        [name for name in brief if (brief[name].role == "count") is is_count] for is_count in (True, False)
    )
    for heading in (*(brief[name].short for name in before), *metrics, *(brief[name].short for name in after)):
        table.add_column(heading, justify="right")
    for row, method in list(zip(rows, methods, strict=True))[:MAX_ROWS]:
        named = [Text(name) for name in (*(names[kind][identify(kind, row)] for kind in kinds), method)]
        if row["status"] != "done":
            table.add_row(*named, row["status"])
            continue
        counts, costs = ([brief[name].format_brief(row[name]) for name in names] for names in (before, after))
        table.add_row(*named, *counts, *(_format_error(row, name) for name in metrics), *costs)
    print_whole(table)
    if len(rows) > MAX_ROWS:
        say(f"... and {len(rows) - MAX_ROWS} more of {len(rows)} rows: all are in the report and in cells.parquet")
    reasons = dict.fromkeys(
        f"{row['status']}: {row['method']}: {row['reason'].strip().splitlines()[-1]}"
        for row in rows
        if row["status"] != "done"
    )
    for reason in list(reasons)[:MAX_ROWS]:
        say(reason)
    if len(reasons) > MAX_ROWS:
        say(f"... and {len(reasons) - MAX_ROWS} more reasons: all are in the report")
    halves = {"±": "half of the 95 % interval"} if any("left_out" in row and row["left_out"] for row in rows) else {}
    print_words(halves | explain_table(rows, with_decided=False))


def print_whole(table: Table) -> None:
    """Print a table, also wider than the window: numbers are not cut to fit a narrow window or a file."""
    needed = out.measure(table, options=out.options.update(max_width=1000)).maximum
    Console(width=max(needed, out.width)).print(table, soft_wrap=True)


def _format_error(row: dict[str, Any], metric: str) -> str:
    """A metric with half its 95 % interval; "floor" if the reference is too noisy to measure the error."""
    from glossbench.findings.columns import make_metric_column  # late, because they import torch
    from glossbench.findings.estimates import estimate_metric

    if row["at_noise_floor"] and not make_metric_column(metric).signed:
        return "floor"
    half = estimate_metric(row, metric).half_width
    return f"{row[metric]:.4g} ± {half:.1g}" if half else f"{row[metric]:.4g}"


def print_words(said: dict[str, str]) -> None:
    """Print the meaning of words in a table or a verdict, one line each."""
    for word, text in said.items():
        out.print(f"{word}: {text}", style="dim", soft_wrap=True)


def name_methods(rows: list[dict[str, Any]], over: str | None = None) -> list[str]:
    """For each row, the method with the options that distinguish it, without those that `over` determines."""
    texts = (options for _, options in distinguish_rows(rows, over))
    return [with_options(row["method"], own) for row, own in zip(rows, texts, strict=True)]


def print_plan(cells: "Sequence[Cell]", statuses: "Sequence[str]") -> None:
    """Print what a run would compute, one line per cell: its status on disk, and the names that distinguish it."""
    rows = [parse_row(cell.make_record(status="new").to_row()) for cell in cells]
    names = {kind: name_items(kind, rows) for kind in CONDITIONS}
    columns = [list(statuses)]
    kinds = [kind for kind in CONDITIONS if kind != "view" or len(names[kind]) > 1]
    columns += [[names[kind][identify(kind, row)] for row in rows] for kind in kinds]
    columns += [name_methods(rows, over="")]
    widths = [max(map(len, column)) for column in columns]
    for line in zip(*columns, strict=True):
        say("  ".join(f"{text:<{width}}" for text, width in zip(line, widths, strict=True)).rstrip())


def print_verdicts(claims: list[dict[str, Any]]) -> None:
    """Print the claims of a study, each with its verdict."""
    from glossbench.findings.legends import explain_verdicts  # late, because it imports torch

    styles = {"holds": "green", "does not hold": "red", "equal": "cyan", "within noise": "yellow"}
    for claim in claims:
        out.print()
        out.print(claim["verdict"], style=styles.get(claim["verdict"], "dim"), end="  ")
        out.print(f"{claim['text']}\n  {claim['summary']}")
    print_words(explain_verdicts(claims))
    out.print()


def print_notes(cells: "pandas.DataFrame") -> None:
    """Print what was repaired or fitted, one line each, without repetition."""
    for text in dict.fromkeys(text for notes in cells["notes"] for text in json.loads(notes)):
        note(text)


def warn_of_noise(cells: "pandas.DataFrame") -> None:
    """Print one line if references did not meet their target; that of samples may be missed by half."""
    references = cells.drop_duplicates("reference_key")
    # Halves of sampled replicates end by the noise of each other, so that the noise of both may be a little higher.
    most = references["reference_target"] * references["reference_method"].eq("sampling").map({True: 1.5, False: 1.0})
    missed = references[references["reference_noise"] > most]
    if len(missed):
        worst = (missed["reference_noise"] / missed["reference_mean"]).max()
        wanted = (missed["reference_target"] / missed["reference_mean"]).min()
        err.print(
            f"{len(missed)} of {len(references)} references stopped at reference.max_samples with noise up to "
            f"{100 * worst:.2g} % of the mean; the target was {100 * wanted:.2g} %",
            style="yellow", soft_wrap=True,
        )  # fmt: skip


def warn_of_times(cells: "pandas.DataFrame") -> None:
    """Print a line if times are not comparable: the machine was busy, or cells were timed on several processors."""
    done = cells[cells["status"] == "done"]
    busy = int((done["busy"] > BUSY).sum())
    if busy:
        text = f"{busy} of {len(done)} cells were timed while other programs used up to "
        text += f"{100 * done['busy'].max():.0f} % of the processor time: these times may be too long"
        err.print(text, style="yellow", soft_wrap=True)
    processors = list(dict.fromkeys(done["processor"]))
    if len(processors) > 1:
        text = f"cells were timed on {len(processors)} processors, so times cannot be compared: {', '.join(processors)}"
        err.print(text, style="yellow", soft_wrap=True)
