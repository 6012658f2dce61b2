"""The command line: run a study, write its reports, look up names, check a method, measure this machine."""

import errno
import json
import logging
import sys
import warnings
from importlib.metadata import version
from typing import Annotated, Any, NoReturn

import typer
from rich.table import Table
from rich.text import Text

from glossbench.commands import completion, data
from glossbench.commands.arguments import StudyArgument
from glossbench.commands.choose import choose
from glossbench.commands.compare import EXIT_CODES, compare
from glossbench.commands.compile import compile_kernels
from glossbench.commands.consoles import escape_controls, open_streams
from glossbench.commands.figure import figure
from glossbench.commands.findings import findings
from glossbench.commands.info import info
from glossbench.commands.light import light as describe_light
from glossbench.commands.printing import err, out, print_rows, say, say_lines
from glossbench.commands.run import report, run
from glossbench.errors import InputError
from glossbench.process.leftovers import leave

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Exit code: 0 all is well; 1 a cell failed, a check is broken, or output could not be written; 2 bad input; "
    "130 interrupted.",
)
_UsageError: Any = typer.BadParameter.__base__  # from the click that typer contains or imports


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
        if error.errno not in (errno.ENOSPC, errno.EIO):  # raised by the file to which standard output goes
            raise
        _end(1, f"error: output cannot be written: {error.strerror}")
    except SystemExit as ended:
        leave(ended.code)
        raise
    finally:
        logger.removeHandler(_printed)


def _end(code: int, line: str) -> NoReturn:
    err.print(escape_controls(line), style="red", soft_wrap=True)
    leave(code)
    sys.exit(code)


class _PrintingHandler(logging.Handler):
    """Prints the log records of the package as lines on standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        err.print(escape_controls(record.getMessage()), style="yellow", soft_wrap=True)


_printed = _PrintingHandler()


def _print_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, file: Any = None, line: Any = None
) -> None:
    err.print(escape_controls(f"warning: {message} ({filename}, line {lineno})"), style="yellow", soft_wrap=True)


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


app.command()(run)
app.command()(report)


@app.command()
def validate(study: StudyArgument) -> None:
    """Check a study without running it."""
    from glossbench.study.describe import describe_contents, summarize_study
    from glossbench.study.study import load_study_with_forms

    loaded, forms = load_study_with_forms(study, open_files=True)
    say(summarize_study(loaded))
    print_rows(describe_contents(loaded, forms))


@app.command()
def schema() -> None:
    """Print the JSON Schema of studies, for editors."""
    from glossbench.study.schema import schema as study_schema

    say_lines(json.dumps(study_schema(), indent=1))


app.command(name="compile")(compile_kernels)
app.command()(info)
app.command()(figure)
app.command()(choose)
app.command()(findings)
app.command(epilog=EXIT_CODES)(compare)
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
    from glossbench.contract.method_check import check_contract

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
def bench(
    scale: Annotated[
        bool, typer.Option("--scale", help="Measure runs: the time of a cell, two workers, the memory of 5,000 cells.")
    ] = False,
) -> None:
    """Measure this machine: the shading kernel, eager and fused, and pyramids, compared with a copy of their cube."""
    from glossbench.commands.bench import measure
    from glossbench.commands.bench_scale import measure_scale

    table = Table("what", "value", "ratio", box=None, pad_edge=False)
    try:
        for line in (measure_scale if scale else measure)(lambda text: err.print(f"{text} ...", style="dim")):
            table.add_row(line.what, line.value, line.ratio)
    finally:
        out.print(table)  # what was measured before an end


@app.command(name="sys-info")
def sys_info() -> None:
    """Print versions and hardware, for bug reports."""
    from glossbench.provenance import collect_system_information

    for key, value in collect_system_information().items():
        say(f"{key}: {value}")
