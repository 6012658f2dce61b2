"""`glossbench figure`: write one figure of results to a file."""

from pathlib import Path
from typing import Annotated

import typer

from glossbench.commands.completion import figures as figure_names
from glossbench.commands.completion import results as result_folders
from glossbench.commands.printing import note, print_rows, say
from glossbench.documentation import read_first_line
from glossbench.errors import InputError, suggest_nearest


def figure(
    results: Annotated[str, typer.Argument(help="The folder or address of a run.", autocompletion=result_folders)],
    name: Annotated[
        str | None, typer.Argument(help="A figure's name; without one, list the figures.", autocompletion=figure_names)
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="A .pdf, .svg or .png file (default: RESULTS/NAME.pdf).")
    ] = None,
    group: Annotated[int | None, typer.Option(help="Number of a light, material and view, from 1.")] = None,
    metric: Annotated[
        str | None, typer.Option(help="Error metric (default: the study's first; for `images`, the signed error).")
    ] = None,
    over: Annotated[
        str | None,
        typer.Option(
            help="Horizontal axis of `convergence`, as in the report: samples, regions, material.s, or short s."
        ),
    ] = None,
    crop: Annotated[
        list[str] | None,
        typer.Option(metavar="X,Y,WIDTH,HEIGHT", help="A window [pixels], as in the viewer's address; repeatable."),
    ] = None,
) -> None:
    """Write one figure of results."""
    from glossbench.run.figures import FIGURES
    from glossbench.run.results import Results

    opened = Results.open(results)
    if name is None:
        print_rows({key: read_first_line(FIGURES.get(key)) for key in FIGURES.names()})
        return
    if name not in FIGURES.names():
        raise InputError(f"no figure is called {name!r}{suggest_nearest(name, FIGURES.names())}")
    drawn = FIGURES.get(name)()
    given = {
        "group": group,
        "metric": metric,
        "over": over,
        "crop": [_parse_window(text) for text in crop or ()] or None,
    }
    told = {option: value for option, value in given.items() if value is not None}
    if not_taken := sorted(set(told) - set(drawn.options)):
        raise InputError(f"the figure {name} has no option --{not_taken[0]}")
    for remark in opened.remarks(opened.cells):
        note(remark)
    if output is None:
        opened.disk.own(f"{name}.pdf")
        opened.store.put(f"{name}.pdf", drawn.draw(opened, "pdf", **told))
    else:
        drawn.write(opened, output, **told)
    say(f"figure: {output or opened.store.locate(f'{name}.pdf')}")


def _parse_window(text: str) -> tuple[int, ...]:
    parts = text.split(",")
    try:
        window = tuple(int(part) for part in parts)
    except ValueError:
        window = ()
    if len(window) != 4:
        raise InputError(f"--crop must be four whole numbers X,Y,WIDTH,HEIGHT, got {text!r}")
    return window
