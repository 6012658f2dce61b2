"""`glossbench run` and `glossbench report`: a study's cells, its table and verdicts, and its reports."""

import traceback
from collections import Counter
from collections.abc import Callable, Collection
from functools import partial
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glossbench.commands import completion
from glossbench.commands.arguments import StudyArgument
from glossbench.commands.consoles import escape_controls
from glossbench.commands.printing import (
    Pulse,
    err,
    note,
    print_notes,
    print_plan,
    print_table,
    print_verdicts,
    say,
    warn_of_noise,
    warn_of_times,
)
from glossbench.errors import InputError, suggest_nearest

if TYPE_CHECKING:
    from glossbench.run.rates import Prediction
    from glossbench.study.study import Study


def run(
    study: StudyArgument,
    output: Annotated[
        str | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FOLDER|ADDRESS",
            help="Where the results go: a folder, or an address such as s3://bucket/results (default: results/STUDY).",
        ),
    ] = None,
    light: Annotated[
        str | None,
        typer.Option(
            metavar="FILE|NAME",
            help="An HDR file, or the name of a light, that replaces the study's lights.",
            autocompletion=completion.lights,
        ),
    ] = None,
    method: Annotated[
        list[str] | None,
        typer.Option("-m", "--method", help="Run only this method; repeatable.", autocompletion=completion.methods),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="A seed that replaces the study's seed.")] = None,
    no_cache: Annotated[bool, typer.Option("--no-cache", help="Compute all cells and references again.")] = False,
    rerun_failed: Annotated[bool, typer.Option("--rerun-failed", help="Try failed cells again.")] = False,
    fail_fast: Annotated[bool, typer.Option("--fail-fast", help="Stop at the first cell that fails.")] = False,
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="local:N|ADDRESS",
            help="Run on N processes of this machine, or on a cluster, such as tcp://host:8786.",
        ),
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="List what would run, and stop.")] = False,
) -> None:
    """Run a study, print its table and verdicts, and write its reports."""
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    from glossbench.plugins import find_origin
    from glossbench.run.progress import Progress
    from glossbench.run.runner import run_study
    from glossbench.study.study import load_study

    loaded = load_study(study, light=light)
    if seed is not None:
        loaded = loaded.with_seed(seed)
    if method:
        loaded = loaded.only(method)
    if light is not None and output is None:
        output = str(Path("results") / f"{loaded.name}_{Path(light).stem}")
    where = output or str(Path("results") / loaded.name)
    for plugin in loaded.plugins:
        err.print(f"plugin {plugin}: {find_origin(plugin)}", soft_wrap=True)
    if dry_run:
        _print_plan(loaded, where)
        return
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    try:
        with Bar(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
            task, pulse = bar.add_task("", total=None), Pulse(bar, "cells")

            def show(**changes: Any) -> None:
                bar.update(task, **changes)
                pulse()

            progress = Progress(
                begin=lambda n: show(total=n),
                doing=lambda text: show(description=text),
                cell=lambda row: show(advance=1),
                note=note,
            )
            results = run_study(
                loaded, where, use_cache=not no_cache, rerun_failed=rerun_failed, fail_fast=fail_fast,
                dask=dask, progress=progress,
            )  # fmt: skip
    except KeyboardInterrupt:
        err.print("interrupted: cells that are done are kept, the same command goes on from there", soft_wrap=True)
        raise typer.Exit(130) from None
    print_table(results.cells, loaded.metric_columns)
    warn_of_noise(results.cells)
    warn_of_times(results.cells)
    print_notes(results.cells)
    print_verdicts(results.claims)
    is_whole = _write_reports(results.where, keeps=not no_cache)
    failed = int((results.cells["status"] == "failed").sum())
    if failed:
        err.print(
            f"{_count_in_words(failed, 'cell')} failed: tracebacks are in the report, --rerun-failed tries again",
            style="red",
        )
    if failed or not is_whole:
        raise typer.Exit(1)


def report(
    results: Annotated[str, typer.Argument(help="The folder or address of a run.", autocompletion=completion.results)],
    names: Annotated[
        list[str] | None,
        typer.Argument(help="Reports, such as html and pdf (default: all).", autocompletion=completion.reports),
    ] = None,
) -> None:
    """Write the reports of existing results again."""
    from glossbench.run.results import Results

    opened = Results.open(results)
    for name in names or ():
        if name not in (known := _report_writers()):
            raise InputError(f"no report is called {name!r}{suggest_nearest(name, known)}")
    for remark in opened.remarks(opened.cells):
        note(remark)
    if not _write_reports(opened.where, names or ()):
        raise typer.Exit(1)


def _count_in_words(n: int, what: str) -> str:
    return f"{n} {what}{'' if n == 1 else 's'}"


def _print_plan(study: "Study", where: str) -> None:
    """Print what a run would compute, and the number of cells by status."""
    from glossbench.run.rates import predict
    from glossbench.run.runner import find_statuses

    cells, statuses = study.cells(), find_statuses(study, where)
    print_plan(cells, statuses)
    count = Counter(statuses)
    told = [f"{count[status]} {status}" for status in ("done", "skipped", "failed", "new") if count[status]]
    say(f"{_count_in_words(len(cells), 'cell')} would go to {where}: {', '.join(told)}")
    if new := [cell for cell, status in zip(cells, statuses, strict=True) if status in ("new", "damaged")]:
        say(_describe_prediction(predict(new, study.reference, study.measured)))
    if count["failed"]:
        say("failed cells stay as they are; --rerun-failed tries them again")


def _describe_prediction(cost: "Prediction") -> str:
    """The cost of new cells in one line."""
    if not cost.seconds:
        return "what this takes is not known: no run has been measured on this machine"
    memory = "" if cost.memory is None else f", {cost.memory / 1e9:.2g} GB of memory"
    rest = f"; {cost.n_unknown} cells and references are like none that was measured" if cost.n_unknown else ""
    time, disk = format_seconds(cost.seconds), f"{cost.disk / 1e6:.2g} MB of disk"
    return f"this takes about {time} on one process{memory}, {disk}{rest}"


def format_seconds(seconds: float) -> str:
    """A time in words: 40 s, 12 min, 3.5 h."""
    small, large = (seconds, "s"), (seconds / 3600, "h")
    value, unit = small if seconds < 100 else (seconds / 60, "min") if seconds < 6000 else large
    return f"{value:.2g} {unit}"


def _write_reports(where: Path | str, only: Collection[str] = (), keeps: bool = False) -> bool:
    """Write the reports, or only some. A report that fails gives one line, and the others are still written.

    Args:
        keeps: leave a report that a new one would equal.

    Returns: whether all were written.
    """
    from glossbench.commands.report_marks import ReportMarks
    from glossbench.run.results import Results

    is_whole, marks = True, ReportMarks(Results(where))
    for name, write in _report_writers().items():
        if only and name not in only:
            continue
        try:
            page = marks.find_current(name) if keeps else None
            if page is None:
                with err.status(f"report {name}"):
                    page = write(where)
                marks.add(name)
            say(f"report: {page}")
        except KeyboardInterrupt:
            again = f"the results are whole: `glossbench report {where}` writes the reports"
            err.print(escape_controls(f"interrupted: {again}"), soft_wrap=True)
            raise typer.Exit(130) from None
        except (Exception, SystemExit) as error:  # a writer may come from another distribution
            is_whole = False
            _print_fault(f"error: the {name} report was not written", error)
    return is_whole


def _print_fault(what: str, error: BaseException) -> None:
    """Print one line for an exception: what failed, why, and the place in the source unless the user is at fault."""
    text = " ".join(str(error).split())
    if not isinstance(error, InputError):
        last = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__}: {text} ({Path(last.filename).name}:{last.lineno})"
    err.print(escape_controls(f"{what}: {text}"), style="red", soft_wrap=True)


def _report_writers() -> dict[str, Callable[[Path | str], Path | str]]:
    return {point.name: partial(_write_report, point) for point in entry_points(group="glossbench.reports")}


def _write_report(point: EntryPoint, where: Path | str) -> Path | str:
    page: Path | str = point.load()(where)
    return page
