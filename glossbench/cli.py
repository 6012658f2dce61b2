"""The command line: run a study, write its report, look things up, check a method, measure this machine."""

import errno
import json
import logging
import sys
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Collection
from functools import partial
from importlib.metadata import EntryPoint, entry_points, version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer
from rich.table import Table
from rich.text import Text

from glossbench.commands import completion, data
from glossbench.commands.figure import figure
from glossbench.commands.info import info
from glossbench.commands.light import light as describe_light
from glossbench.consoles import one_line, open_streams
from glossbench.errors import InputError
from glossbench.leftovers import leave
from glossbench.printing import (
    Pulse,
    err,
    note,
    out,
    print_notes,
    print_plan,
    print_rows,
    print_table,
    print_verdicts,
    say,
    say_lines,
    warn_of_noise,
    warn_of_times,
)

if TYPE_CHECKING:
    from glossbench.study import Study

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Exit code: 0 all is well; 1 a cell failed, a check is broken, or output could not be written; 2 bad input; "
    "130 interrupted.",
)
_UsageError: Any = typer.BadParameter.__base__  # of the click that typer brings or imports

StudyArgument = Annotated[
    str,
    typer.Argument(
        metavar="STUDY", help="A study's name (quickstart) or a path to its YAML.", autocompletion=completion.studies
    ),
]


def main() -> None:
    """Entry point: bad input ends with one line and exit code 2, an interrupt with 130."""
    open_streams()
    logger = logging.getLogger("glossbench")
    logger.addHandler(_printed)
    warnings.showwarning = _print_warning
    try:
        sys.exit(app(prog_name="glossbench", standalone_mode=False) or 0)
    except InputError as error:
        _end(2, f"error: {error}")
    except _UsageError as error:
        if not error.format_message().strip() or type(error).__name__ == "NoArgsIsHelpError":
            error.show()
            sys.exit(2)
        command = f"{error.ctx.command_path} --help" if error.ctx else "glossbench --help"
        _end(2, f"error: {error.format_message()} See {command}")
    except (KeyboardInterrupt, typer.Abort):
        _end(130, "interrupted")
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EIO):  # of the file that standard output goes to
            raise
        _end(1, f"error: output cannot be written: {error.strerror}")
    except SystemExit as ended:
        leave(ended.code)
        raise
    finally:
        logger.removeHandler(_printed)


def _end(code: int, line: str) -> NoReturn:
    err.print(one_line(line), style="red", soft_wrap=True)
    leave(code)
    sys.exit(code)


class _Printed(logging.Handler):
    """Records of the package as lines on standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        err.print(one_line(record.getMessage()), style="yellow", soft_wrap=True)


_printed = _Printed()


def _print_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, file: Any = None, line: Any = None
) -> None:
    err.print(one_line(f"warning: {message} ({filename}, line {lineno})"), style="yellow", soft_wrap=True)


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

    from glossbench.plugins import origin
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
    for plugin in loaded.plugins:
        err.print(f"plugin {plugin}: {origin(plugin)}", soft_wrap=True)
    if dry_run:
        _print_plan(loaded, folder)
        return
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
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
                note=note,
            )
            results = run_study(
                loaded, folder, use_cache=not no_cache, rerun_failed=rerun_failed, fail_fast=fail_fast,
                progress=progress,
            )  # fmt: skip
    except KeyboardInterrupt:
        err.print("interrupted: cells that are done are kept, the same command goes on from there", soft_wrap=True)
        raise typer.Exit(130) from None
    print_table(results.cells, list(loaded.metrics))
    warn_of_noise(results.cells)
    warn_of_times(results.cells)
    print_notes(results.cells)
    print_verdicts(results.claims)
    is_whole = _write_reports(results.folder)
    failed = int((results.cells["status"] == "failed").sum())
    if failed:
        err.print(
            f"{_counted(failed, 'cell')} failed: tracebacks are in the report, --rerun-failed tries again",
            style="red",
        )
    if failed or not is_whole:
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
    for remark in opened.remarks(opened.cells):
        note(remark)
    if not _write_reports(opened.folder, only):
        raise typer.Exit(1)


@app.command()
def validate(study: StudyArgument) -> None:
    """Check a study without running it."""
    from glossbench.describing import described, in_one_line
    from glossbench.study import study_with_forms

    loaded, forms = study_with_forms(study, open_files=True)
    say(in_one_line(loaded))
    print_rows(described(loaded, forms))


@app.command()
def schema() -> None:
    """Print the JSON Schema of studies, for editors."""
    from glossbench.schema import schema as study_schema

    say_lines(json.dumps(study_schema(), indent=2))


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

    outcomes = check_contract(name, lambda text: err.print(f"{text} ...", style="dim"))
    table = Table("check", "outcome", "measured", box=None, pad_edge=False)
    for outcome in outcomes:
        verdict = {True: Text("kept", "green"), False: Text("broken", "red"), None: Text("not claimed")}[outcome.kept]
        measured = f"{outcome.measured} ({outcome.where})" if outcome.where else outcome.measured
        table.add_row(outcome.check, verdict, measured)
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


def _print_plan(study: "Study", folder: Path) -> None:
    """What a run would do."""
    from glossbench.runner import kept_statuses

    cells, statuses = study.cells(), kept_statuses(study, folder)
    print_plan(cells, statuses)
    count = Counter(statuses)
    told = [f"{count[status]} {status}" for status in ("done", "skipped", "failed", "new") if count[status]]
    say(f"{_counted(len(cells), 'cell')} would go to {folder}: {', '.join(told)}")
    if count["failed"]:
        say("failed cells stay as they are; --rerun-failed tries them again")


def _write_reports(folder: Path, only: Collection[str] = ()) -> bool:
    """Write the reports, or some of them; one that fails is a line, and the others are still written.

    Returns: whether all were written.
    """
    is_whole = True
    for name, write in _report_writers().items():
        if only and name not in only:
            continue
        try:
            with err.status(f"report {name}"):
                page = write(folder)
            say(f"report: {page}")
        except KeyboardInterrupt:
            again = f"the results are whole: `glossbench report {folder}` writes the reports"
            err.print(one_line(f"interrupted: {again}"), soft_wrap=True)
            raise typer.Exit(130) from None
        except (Exception, SystemExit) as error:  # a writer may be another distribution's code
            is_whole = False
            _print_fault(f"error: the {name} report was not written", error)
    return is_whole


def _print_fault(what: str, error: BaseException) -> None:
    """One line for an exception: what failed, why, and the place in the source where that is not the user's fault."""
    text = " ".join(str(error).split())
    if not isinstance(error, InputError):
        last = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__}: {text} ({Path(last.filename).name}:{last.lineno})"
    err.print(one_line(f"{what}: {text}"), style="red", soft_wrap=True)


def _report_writers() -> dict[str, Callable[[Path], Path]]:
    return {point.name: partial(_written, point) for point in entry_points(group="glossbench.reports")}


def _written(point: EntryPoint, folder: Path) -> Path:
    page: Path = point.load()(folder)
    return page
