"""The command line: run a study, write its report, look things up, check a method, measure this machine."""

import json
import sys
from collections.abc import Callable
from importlib.metadata import entry_points, version
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from glossbench.commands import completion, data
from glossbench.commands.figure import figure
from glossbench.commands.info import info
from glossbench.commands.light import light as describe_light
from glossbench.errors import InputError
from glossbench.leftovers import leave
from glossbench.printing import (
    Pulse,
    err,
    out,
    print_notes,
    print_table,
    print_verdicts,
    say,
    warn_of_noise,
    warn_of_times,
)

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False)

StudyArgument = Annotated[
    str,
    typer.Argument(
        metavar="STUDY", help="A study's name (quickstart) or a path to its YAML.", autocompletion=completion.studies
    ),
]


def main() -> None:
    """Entry point: bad input ends with one line and exit code 2, an interrupt with 130."""
    try:
        app()
    except InputError as error:
        err.print(f"error: {error}", style="red", markup=False, highlight=False, soft_wrap=True)
        leave(2)
        sys.exit(2)
    except SystemExit as ended:
        leave(ended.code)
        raise


def _print_version(wanted: bool) -> None:
    if wanted:
        say(f"glossbench {version('glossbench')}")
        raise typer.Exit


@app.callback()
def options(
    show_version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Compare prefiltering methods for glossy image-based lighting against a converged reference."""


@app.command()
def run(
    study: StudyArgument,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Folder of results; results/STUDY.")] = None,
    light: Annotated[
        str | None,
        typer.Option(
            metavar="FILE|NAME",
            help="An HDR file, or a light's name, in place of the study's lights.",
            autocompletion=completion.lights,
        ),
    ] = None,
    method: Annotated[
        list[str] | None,
        typer.Option("-f", "--method", help="Only this method; repeatable.", autocompletion=completion.methods),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="In place of the study's seed.")] = None,
    no_cache: Annotated[bool, typer.Option("--no-cache", help="Compute every cell and reference anew.")] = False,
    rerun_failed: Annotated[bool, typer.Option("--rerun-failed", help="Try failed cells again.")] = False,
    fail_fast: Annotated[bool, typer.Option("--fail-fast", help="Stop at the first cell that fails.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would run, and stop.")] = False,
) -> None:
    """Run a study, print its table and verdicts, and write its reports."""
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    from glossbench.runner import Progress, run_study
    from glossbench.study import load_study

    loaded = load_study(study, light=light)
    if seed is not None:
        loaded = loaded.with_seed(seed)
    if method:
        loaded = loaded.only(method)
    if light is not None and output is None:
        output = Path("results") / f"{loaded.name}_{Path(light).stem}"
    folder = output or Path("results") / loaded.name
    if dry_run:
        for cell in loaded.cells():
            items = (cell.light, cell.material, cell.view, cell.method)
            say("  ".join(f"{item.name} {item.json}" for item in items))
        say(f"{len(loaded.cells())} cells would go to {folder}")
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    try:
        with Bar(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
            task, pulse = bar.add_task("", total=None), Pulse(bar)

            def show(**changes: Any) -> None:
                bar.update(task, **changes)
                pulse()

            progress = Progress(
                begin=lambda n: show(total=n),
                doing=lambda text: show(description=text),
                cell=lambda row: show(advance=1),
            )
            results = run_study(
                loaded, folder, use_cache=not no_cache, rerun_failed=rerun_failed, fail_fast=fail_fast,
                progress=progress,
            )  # fmt: skip
            show(description="reports")
            pages = [write(results.folder) for write in _report_writers().values()]
    except KeyboardInterrupt:
        err.print("interrupted: cells that are done are kept, the same command goes on from there", soft_wrap=True)
        raise typer.Exit(130) from None
    print_table(results.cells, list(loaded.metrics))
    warn_of_noise(results.cells)
    warn_of_times(results.cells)
    print_notes(results.cells)
    print_verdicts(results.claims)
    for page in pages:
        say(f"report: {page}")
    failed = int((results.cells["status"] == "failed").sum())
    if failed:
        err.print(
            f"{_counted(failed, 'cell')} failed: tracebacks are in the report, --rerun-failed tries again",
            style="red",
        )
        raise typer.Exit(1)


@app.command()
def report(
    results: Annotated[Path, typer.Argument(help="A folder that a run made.", autocompletion=completion.results)],
    html: Annotated[bool, typer.Option("--html", help="Only the page.")] = False,
    pdf: Annotated[bool, typer.Option("--pdf", help="Only the PDF.")] = False,
) -> None:
    """Write the reports of results again."""
    from glossbench.results import Results

    opened = Results.open(results)
    only = {name for name, wanted in (("html", html), ("pdf", pdf)) if wanted}
    for name, write in _report_writers().items():
        if not only or name in only:
            say(f"report: {write(opened.folder)}")


@app.command()
def validate(study: StudyArgument) -> None:
    """Check a study without running it."""
    from glossbench.study import load_study

    loaded = load_study(study)
    cells = loaded.cells()
    counts = [_counted(len({getattr(cell, kind) for cell in cells}), kind) for kind in ("light", "material", "view")]
    counts += [_counted(len(cells), "cell"), _counted(len(loaded.claims), "claim")]
    out.print(
        f"{loaded.title}: {', '.join(counts)}",
        markup=False,
        highlight=False,
    )


@app.command()
def schema() -> None:
    """Print the JSON Schema of studies, for editors."""
    from glossbench.schema import schema as study_schema

    print(json.dumps(study_schema(), indent=2))


app.command()(info)
app.command()(figure)
app.command(name="light")(describe_light)
app.add_typer(data.app, name="data")


@app.command(name="check-method")
def check_method(
    name: Annotated[
        str,
        typer.Argument(help="A registered method, or a module that registers one.", autocompletion=completion.methods),
    ],
) -> None:
    """Check a method against the contract that every method keeps."""
    from glossbench.contract import check_contract

    outcomes = check_contract(name, lambda text: err.print(f"{text} ...", style="dim", markup=False, highlight=False))
    table = Table("check", "outcome", "measured", box=None, pad_edge=False)
    for outcome in outcomes:
        verdict = {True: "[green]kept[/green]", False: "[red]broken[/red]", None: "not claimed"}[outcome.kept]
        table.add_row(
            outcome.check,
            verdict,
            escape(f"{outcome.measured} ({outcome.where})" if outcome.where else outcome.measured),
        )
    out.print(table)
    if any(outcome.kept is False for outcome in outcomes):
        raise typer.Exit(1)


@app.command()
def bench() -> None:
    """Measure this machine: the shading kernel eager and fused, and pyramids against a copy of their cube."""
    from glossbench.bench import measure

    table = Table("what", "value", "ratio", box=None, pad_edge=False)
    for line in measure(lambda text: err.print(f"{text} ...", style="dim")):
        table.add_row(line.what, line.value, line.ratio)
    out.print(table)


@app.command(name="sys-info")
def sys_info() -> None:
    """Print versions and hardware, for bug reports."""
    from glossbench.provenance import system_information

    for key, value in system_information().items():
        say(f"{key}: {value}")


def _counted(n: int, what: str) -> str:
    return f"{n} {what}{'' if n == 1 else 's'}"


def _report_writers() -> dict[str, Callable[[Path], Path]]:
    return {point.name: point.load() for point in entry_points(group="glossbench.reports")}
