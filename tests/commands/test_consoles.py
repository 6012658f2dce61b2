"""What is printed: plain text of any origin, in any encoding, to a reader that may be gone."""

import io
import os
import subprocess
import sys

import pytest
import torch
from matplotlib import pyplot, rcParams
from matplotlib.figure import Figure

from glossbench.catalog.entries import Entry
from glossbench.commands import cli, printing
from glossbench.commands.consoles import Console, escape_controls, open_streams
from glossbench.documentation import read_documentation, read_first_line
from glossbench.reports.style import RC, draw_colour_bar, style, to_svg
from glossbench.run.figures import FIGURES

HOSTILE = "s.yaml:100: [bold]x[/bold] [/red] \x1b[31mred\x1b[0m \x9b31m \u202eevil \x00"
SHOWN = "s.yaml:100: [bold]x[/bold] [/red] \\x1b[31mred\\x1b[0m \\x9b31m \\u202eevil \\x00"


def printed(text, console=Console, **options):
    stream = io.StringIO()
    console(file=stream, width=200).print(text, **options)
    return stream.getvalue()


def test_text_that_would_steer_a_terminal_is_shown_as_escapes():
    assert printed(HOSTILE) == SHOWN + "\n"


def test_styles_still_reach_a_terminal():
    stream = io.StringIO()

    Console(file=stream, force_terminal=True, color_system="standard").print(HOSTILE, style="red")

    assert stream.getvalue() == f"\x1b[31m{SHOWN}\x1b[0m\n"


def test_a_console_that_steers_would_be_noticed():
    from rich.console import Console as Plain

    assert printed(HOSTILE.replace("[/red]", ""), Plain) != SHOWN.replace("[/red]", "") + "\n"


def test_one_line_stays_one_line():
    assert escape_controls("a\nb\r\x85\u2028\tc") == "a\\nb\\r\\x85\\u2028\\tc"


@pytest.mark.parametrize("say", [printing.say, lambda text: cli._end(2, text)], ids=["a line", "an error"])
def test_the_name_of_a_file_with_an_end_of_line_is_one_line(say, capsys):
    try:
        say("no\nfile")
    except SystemExit as stopped:
        assert stopped.code == 2  # noqa: PT017

    assert "".join(capsys.readouterr()) == "no\\nfile\n"


@pytest.mark.parametrize(
    ("encoding", "text", "shown"),
    [
        ("ascii", "größer — 3 ≤ 4", r"gr\xf6\xdfer - 3 <= 4"),
        ("latin-1", "größer — 3 ≤ 4", "größer - 3 <= 4"),
        ("cp1252", "größer — 3 ≤ 4", "größer — 3 <= 4"),
        ("utf-8", "größer \udcff", r"größer \udcff"),
    ],
)
def test_what_an_encoding_lacks_is_spelled_out(encoding, text, shown, monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    monkeypatch.setattr(sys, "stdout", stream)

    open_streams()
    printing.say(text)

    assert stream.buffer.getvalue().decode(encoding) == shown + "\n"


def test_a_closed_pipe_ends_the_printing_and_not_the_work():
    read, write = os.pipe()
    os.close(read)
    with open(write, "w", encoding="utf-8") as stream:
        console = Console(file=stream)

        console.print("a")
        console.print("b")

    assert console.quiet


@pytest.fixture
def call(monkeypatch, capsys):
    """Exit code, output and errors of the command line in this process."""

    def called(*arguments):
        monkeypatch.setattr(sys, "argv", ["glossbench", *arguments])
        capsys.readouterr()
        with pytest.raises(SystemExit) as stopped:
            cli.main()
        return stopped.value.code, *capsys.readouterr()

    return called


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["vaidate"], "error: No such command 'vaidate'. Did you mean 'validate'? See glossbench --help\n"),
        (["[/bold] :100:\x1b[31m"], "error: No such command '[/bold] :100:\\x1b[31m'. See glossbench --help\n"),
        (["run", "--foo"], "error: No such option: --foo See glossbench run --help\n"),
        (["validate"], "error: Missing argument 'STUDY'. See glossbench validate --help\n"),
    ],
)
def test_a_wrong_call_is_one_line_on_standard_error(call, arguments, message):
    assert call(*arguments) == (2, "", message)


def test_the_help_says_the_exit_codes_and_h_is_help(call):
    code, out, err = call("-h")

    assert (code, err) == (0, "")
    assert "Exit code: 0 all is well; 1 a cell failed" in " ".join(out.split())
    assert call("--help") == (code, out, err)


def test_without_arguments_the_commands_are_listed(call):
    code, out, err = call()

    assert code == 2
    assert "check-method" in out + err


def test_warnings_and_records_of_the_package_are_lines_on_standard_error(call, monkeypatch):
    import logging
    import warnings

    from glossbench.commands import info

    def study_files():
        warnings.warn("odd\nthing", UserWarning, stacklevel=1)
        logging.getLogger("glossbench").warning("no\ncompiler")
        raise KeyboardInterrupt

    monkeypatch.setattr(info, "find_study_files", study_files)
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        code, _, err = call("info")

    assert code == 130
    first, second = err.splitlines()
    assert first.startswith("warning: odd\\nthing (")
    assert second == "no\\ncompiler"


PROGRAM = """
import os, sys, runpy
import glossbench.reports.style
assert os.environ["MPLBACKEND"] == "module://nowhere"
from glossbench.catalog.entries import Entry
from glossbench.documentation import read_documentation, read_first_line
assert read_documentation(Entry) == sys.argv.pop()
sys.stdout.reconfigure(encoding="ascii")
runpy.run_module("glossbench", run_name="__main__", alter_sys=True)
"""


def test_a_backend_that_is_not_there_and_docstrings_that_are_dropped_do_no_harm():
    environment = {**os.environ, "MPLBACKEND": "module://nowhere"}

    done = subprocess.run(
        [sys.executable, "-OO", "-c", PROGRAM, "-h", read_documentation(Entry)],
        capture_output=True, text=True, env=environment,
    )  # fmt: skip

    assert (done.returncode, done.stderr) == (0, "")
    assert "Exit code: 0 all is well" in done.stdout


def test_every_figure_says_what_it_is():
    lines = {name: read_first_line(FIGURES.get(name)) for name in FIGURES.names()}

    assert "convergence" in lines
    assert [name for name, line in lines.items() if not line] == []


def drawn():
    return to_svg(draw_colour_bar(1.0, "error"), "a")


def test_a_user_s_style_changes_no_figure_and_stays_as_it_was():
    expected = drawn()
    mine = {
        "text.usetex": True,
        "font.size": 30.0,
        "xtick.major.size": 30.0,
        "savefig.bbox": "tight",
        "svg.fonttype": "path",
    }
    before = dict(rcParams)
    figures = pyplot.get_fignums()
    try:
        rcParams.update(mine)

        assert drawn() == expected
        assert {key: rcParams[key] for key in mine} == mine
        assert pyplot.get_fignums() == figures
    finally:
        rcParams.update({key: before[key] for key in mine})


def test_a_figure_that_took_the_user_s_style_would_be_noticed(monkeypatch):
    from glossbench.reports import style

    expected = drawn()
    monkeypatch.setattr(style, "_PLAIN", {"xtick.major.size": 30.0})

    assert drawn() != expected


def test_a_style_is_put_back_after_an_error():
    before = rcParams["font.size"]

    with pytest.raises(ZeroDivisionError), style({**RC, "font.size": 77.0}):
        Figure(figsize=(1 / 0, 1))

    assert rcParams["font.size"] == before


def test_nothing_is_drawn_where_a_terminal_has_no_colours(call, monkeypatch):
    monkeypatch.setattr(printing.out, "_force_terminal", True)
    monkeypatch.setattr(printing.out, "_color_system", None)

    code, out, _ = call("light", "constant", "--resolution", "4")

    assert (code, "▀" in out) == (0, False)
    assert torch.get_default_dtype() == torch.float32
