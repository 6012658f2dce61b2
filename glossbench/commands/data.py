"""`glossbench data`: the catalogue of public inputs."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from glossbench.catalog.entries import fetch, find_entry, list_entries
from glossbench.commands.completion import catalogue
from glossbench.commands.printing import err, out, say, say_lines
from glossbench.errors import InputError
from glossbench.strict_json import dumps

app = typer.Typer(help="List and fetch public files of lights, BRDFs and meshes.", no_args_is_help=True)

Kind = Annotated[str | None, typer.Option(help="Only this kind: environment, brdf or mesh.")]


@app.command(name="list")
def print_entries(
    kind: Kind = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print all information as JSON.")] = False,
) -> None:
    """List the public inputs: what each one stresses, its size, and its folder if it has been fetched."""
    stated = [(one, one.find_local()) for one in list_entries(kind)]
    if as_json:
        say_lines(dumps([asdict(one) | {"local": str(path) if path else None} for one, path in stated], indent=2))
        return
    table = Table("name", "kind", "MB", "here", "stresses", box=None, pad_edge=False)
    for one, path in stated:
        table.add_row(one.name, one.kind, f"{one.bytes / 1e6:.2f}", "yes" if path else "no", one.stresses)
    out.print(table)
    folders = sorted({str(path.parent) for _, path in stated if path})
    out.print()
    for folder in folders:
        say(f"here: {folder}")
    say("licences and sources: glossbench info NAME")


@app.command(name="fetch")
def fetch_entries(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="NAME", help="Names from `data list`.", autocompletion=catalogue)
    ] = None,
    every: Annotated[bool, typer.Option("--all", help="Everything.")] = False,
    kind: Kind = None,
) -> None:
    """Download public inputs and verify their hashes; an interrupted download continues where it stopped."""
    wanted = list(dict.fromkeys(find_entry(name).name for name in names or []))
    if every or kind:
        if wanted:
            raise InputError("data fetch takes names, or --all, or --kind, not both")
        wanted = [one.name for one in list_entries(kind)]
    if not wanted:
        raise InputError("data fetch needs a name of `glossbench data list`, --all or --kind")
    for name in wanted:
        say(str(_fetch_with_progress(name)))


def _fetch_with_progress(name: str) -> Path:
    """Fetch the file of a name; a terminal shows a progress bar."""
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TransferSpeedColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), DownloadColumn(), TransferSpeedColumn())
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        task = bar.add_task(name, total=find_entry(name).bytes)
        return fetch(name, lambda n: bar.update(task, completed=n))
