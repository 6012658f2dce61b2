"""`glossbench compare`: what changed from one result to another, cell by cell."""

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table
from rich.text import Text

from glossbench.columns import COLUMNS, CONDITIONS
from glossbench.commands import completion
from glossbench.commands.printing import MAX_ROWS, name_methods, note, out, print_rows, print_whole, say
from glossbench.errors import InputError
from glossbench.study.labels import identify, name_items

if TYPE_CHECKING:
    from glossbench.findings.differences import Change, Differences
    from glossbench.run.tables import Table as Cells

EXIT_CODES = (
    "Exit code: 0 nothing is worse: no error beyond noise, no shading time, and all cells done in A are done in B; "
    "1 an error is worse, or a cell is not done any more; 3 only a shading time is longer; 2 bad input, or no common "
    "cells; 130 interrupted. Cells that only A or only B has do not count."
)
Result = "A folder or address of a run, a published summary, or a .parquet file beside its columns.json."


def compare(
    before: Annotated[str, typer.Argument(metavar="A", help=Result, autocompletion=completion.results)],
    after: Annotated[str, typer.Argument(metavar="B", help="The same; its changes from A are reported.",
                                         autocompletion=completion.results)],
) -> None:  # fmt: skip
    """Compare two results: which cells of B are better, worse or slower than in A, and which appeared or vanished.

    Cells are matched by light, material, view, method and options. An error changed if it differs by more than 1 %, and
    if the noise of the references does not explain it; the chance that any of all errors is called worse or better by
    noise alone is 5 %. A shading time changed if its median did by more than 25 % and no timed runs overlap. Times are
    compared only on one processor.
    """
    from glossbench.findings.differences import find_differences
    from glossbench.run.tables import read_table

    tables = read_table(before), read_table(after)
    found = find_differences(tables[0].cells, tables[1].cells, (tables[0].columns, tables[1].columns))
    if not found.match.pairs:
        raise InputError(f"{before} and {after} have no cell in common: {_explain_strangers(found)}")
    for table in tables:
        for remark in table.remarks:
            note(f"{table.address}: {remark}")
    print_rows(_summarize(found, tables))
    _print_changes(found)
    if found.is_worse or found.is_slower:
        raise typer.Exit(1 if found.is_worse else 3)


def _explain_strangers(found: "Differences") -> str:
    for kind in (*CONDITIONS, "method"):
        held = [
            list(dict.fromkeys(rows[0][kind] for rows in side)) for side in (found.match.vanished, found.match.appeared)
        ]
        if not set(held[0]) & set(held[1]):
            return f"each {kind} differs, {' and '.join(', '.join(names) for names in held)}"
    return "the options or the combinations of their lights, materials, views and methods differ"


def _summarize(found: "Differences", tables: Sequence["Cells"]) -> dict[str, str]:
    """The comparison in a few lines."""
    from glossbench.findings.comparisons import EQUAL, NOISE
    from glossbench.findings.differences import BETTER, WORSE
    from glossbench.findings.times import FASTER, SLOWER

    match = found.match
    errors, times = (Counter(each.verdict for each in changes) for changes in (found.errors, found.times))
    worse = [f"{errors[WORSE]} errors are worse"] * bool(errors[WORSE])
    worse += [f"{len(found.broken)} cells are not done any more"] * bool(found.broken)
    worse += [f"{times[SLOWER]} shading times are longer"] * bool(times[SLOWER])
    cells = f"{len(match.pairs)} in both, {len(match.vanished)} only in A, {len(match.appeared)} only in B"
    told = [f"{errors[word]} {word}" for word in (WORSE, BETTER, NOISE)] + [f"{errors[EQUAL]} equal within 1 %"]
    timed = [f"{times[SLOWER]} slower, {times[FASTER]} faster, of {len(found.times)} compared"] * bool(found.times)
    timed += [f"{n} cells not compared: {reason}" for reason, n in found.untimed.items()]
    return {
        **{side: _describe(table) for side, table in zip("AB", tables, strict=True)},
        "result": ", ".join(worse) or "nothing is worse beyond noise",
        "cells": cells + (f", {len(found.repaired)} done only in B" if found.repaired else ""),
        "errors": f"{', '.join(told)} ({', '.join(found.metrics[0])})",
        "": f"not compared, because only one of the two has it: {', '.join(found.metrics[1])}"
        if found.metrics[1]
        else "",
        "noise": "\n".join(_describe_noise(found.errors)),
        "times": "\n".join(timed),
    }


def _describe(table: "Cells") -> str:
    versions = dict.fromkeys(map(str, table.cells.get("version", ())))
    return f"{table.address}: {len(table.cells)} cells" + (f", glossbench {', '.join(versions)}" if versions else "")


def _describe_noise(errors: Sequence["Change"]) -> list[str]:
    """How the noise of references and random points entered."""
    from glossbench.findings.differences import BETTER, WORSE

    shared = sum(each.shares_noise for each in errors)
    found = [f"{shared} errors have the same references in both, whose noise cancels"] * bool(shared)
    if shared < len(errors):
        found.append(f"{len(errors) - shared} errors have different references, whose noise is taken as independent")
    if silent := sum(not each.has_noise for each in errors):
        found.append(f"{silent} errors have no stored noise: every difference above 1 % counts")
    if single := sum(each.is_one_seed and each.verdict in (WORSE, BETTER) for each in errors):
        found.append(f"{single} of the worse and better have random points with one seed, whose spread is not known")
    return found


def _print_changes(found: "Differences") -> None:
    """The tables: what is worse, slower, better, faster, and cells that only one result has."""
    from glossbench.findings.differences import BETTER, WORSE
    from glossbench.findings.times import FASTER, SLOWER

    name = _Names(found)
    for verdict, changes in ((WORSE, found.errors), (SLOWER, found.times)):
        _print_table(verdict, [each for each in changes if each.verdict == verdict], name)
    _print_cells("not done any more", [(after, _give_reason(after)) for _, after in found.broken], name)
    for verdict, changes in ((BETTER, found.errors), (FASTER, found.times)):
        _print_table(verdict, [each for each in changes[::-1] if each.verdict == verdict], name)
    _print_cells("done only in B", [(after, f"was {_give_reason(before)}") for before, after in found.repaired], name)
    _print_cells("only in A", [(rows[0], "") for rows in found.match.vanished], name)
    _print_cells("only in B", [(rows[0], "") for rows in found.match.appeared], name)


class _Names:
    """The names of cells, by what distinguishes them among all cells of both results."""

    def __init__(self, found: "Differences") -> None:
        match = found.match
        groups = [*match.vanished, *match.appeared, *(group for pair in match.pairs for group in pair)]
        rows = [row for rows in groups for row in rows]
        self._names = {kind: name_items(kind, rows) for kind in CONDITIONS}
        self._methods = {id(row): text for row, text in zip(rows, name_methods(rows, over=""), strict=True)}
        self.kinds = [kind for kind in CONDITIONS if len(self._names[kind]) > 1]

    def __call__(self, row: dict[str, Any]) -> list[Text]:
        """The conditions that vary, and the method."""
        texts = [self._names[kind][identify(kind, row)] for kind in self.kinds]
        return [Text(text) for text in (*texts, self._methods[id(row)])]


def _print_table(verdict: str, changes: Sequence["Change"], name: _Names) -> None:
    if not changes:
        return
    table = Table(*name.kinds, "method", verdict, box=None, pad_edge=False)
    for heading in ("A", "B", "B / A"):
        table.add_column(heading, justify="right")
    table.add_column("95 % interval")
    for each in changes[:MAX_ROWS]:
        column = COLUMNS.get(each.column)
        scale = column.scale if column else 1.0
        low, high = each.interval
        table.add_row(
            *name(each.after), Text(column.heading if column else each.column), f"{scale * each.a:.4g}",
            f"{scale * each.b:.4g}", f"{each.ratio:.4g}", f"[{low:.4g}, {high:.4g}]" if low < high else "",
        )  # fmt: skip
    _print_and_count(table, len(changes))


def _print_cells(what: str, cells: Sequence[tuple[dict[str, Any], str]], name: _Names) -> None:
    if not cells:
        return
    table = Table(*name.kinds, "method", what, box=None, pad_edge=False)
    for row, why in cells[:MAX_ROWS]:
        table.add_row(*name(row), Text(why))
    _print_and_count(table, len(cells))


def _print_and_count(table: Table, n: int) -> None:
    print_whole(table)
    if n > MAX_ROWS:
        say(f"... and {n - MAX_ROWS} more of {n} rows")
    out.print()


def _give_reason(row: dict[str, Any]) -> str:
    lines = (row.get("reason") or "").strip().splitlines()
    return f"{row['status']}: {lines[-1]}" if lines else str(row["status"])
