"""`glossbench info`: list all names, or describe one."""

import json
from inspect import get_annotations
from pathlib import Path
from typing import Annotated, Any

import typer
import yaml
from rich.table import Table
from rich.text import Text

from glossbench.catalog.entries import Entry, list_entries
from glossbench.commands.completion import everything
from glossbench.commands.printing import out, print_rows, say
from glossbench.commands.schema_words import describe_values
from glossbench.documentation import read_documentation
from glossbench.errors import InputError, suggest_nearest
from glossbench.study.study_files import find_study_files


def info(
    name: Annotated[
        str | None,
        typer.Argument(
            help="Name of a method, material, light, view, metric, study or public file.", autocompletion=everything
        ),
    ] = None,
    write: Annotated[Path | None, typer.Option(help="Write all descriptions as Markdown into this folder.")] = None,
) -> None:
    """List all names, or describe one: what it computes, its options with bounds and defaults, its source."""
    from glossbench.study.registries import REGISTRIES as kinds  # late, because it imports torch

    if write is not None:
        from glossbench.commands.reference_pages import write_pages  # late: only this option needs it

        for path in write_pages(write, kinds):
            say(str(path))
        return
    studies, files = find_study_files(), {entry.name: entry for entry in list_entries()}
    if name is None:
        for kind, registry in kinds.items():
            _print_names(kind, [n for n in registry.names() if n not in files])
        _print_names("study", list(studies))
        _print_names("public file", list(files))
        return
    known = {*studies, *files, *(n for registry in kinds.values() for n in registry.names())}
    if name not in known:
        raise InputError(f"nothing is called {name!r}{suggest_nearest(name, known)}")
    for kind, registry in kinds.items():
        if name in registry.names():
            _describe_class(kind, registry.get(name))
    if name in studies:
        _describe_study(name, studies[name])
    if name in files:
        _describe_file(files[name])


def _print_names(kind: str, names: list[str]) -> None:
    table = Table.grid(padding=(0, 2))
    table.add_column(width=len("public file"), style="bold")
    table.add_column()
    table.add_row(kind, ", ".join(names))
    out.print(table)


def _print_heading(name: str, kind: str) -> None:
    out.print(Text.assemble((name, "bold"), f" ({kind})\n"))


def _describe_class(kind: str, cls: Any) -> None:
    """Print a registered class: its docstring, its class attributes, its options with defaults and bounds."""
    from glossbench.options import Options, make_schema

    _print_heading(cls.name, kind)
    out.print(read_documentation(cls))
    out.print()
    kind_of = next(base for base in cls.__mro__ if Options in base.__bases__)
    # The equation is in typst's notation; the docstring has it as plain text.
    stated = {key: getattr(cls, key) for key in get_annotations(kind_of) if key != "equation"}
    print_rows(
        {key.replace("_", " "): _format_value(value) for key, value in stated.items() if isinstance(value, str | bool)}
    )
    table = Table("option", "default", "values", box=None, pad_edge=False)
    for option, rule in make_schema(cls)["properties"].items():
        default = json.dumps(rule["default"]) if "default" in rule else "required"
        table.add_row(option, default, describe_values(rule))
    if table.row_count:
        out.print(table)
        out.print()
    if kind == "material" and any(entry.name == cls.name and entry.find_local() for entry in list_entries("brdf")):
        print_rows({"holds": "\n".join(cls.create({}).notes())})


def _format_value(value: str | bool) -> str:
    return value if isinstance(value, str) else "yes" if value else "no"


def _describe_study(name: str, path: Path) -> None:
    """Print what a study asks and compares, without reading the files that its run needs."""
    stated = yaml.safe_load(path.read_text(encoding="utf-8"))
    _print_heading(name, "study")
    say(stated["title"])
    print_rows(
        {
            "question": " ".join(stated.get("question", "").split()),
            "source": stated.get("source", ""),
            "methods": ", ".join(dict.fromkeys(m if isinstance(m, str) else next(iter(m)) for m in stated["methods"])),
            "claims": "\n".join(claim["text"] for claim in stated.get("claims", [])),
            "file": str(path),
        }
    )


def _describe_file(entry: Entry) -> None:
    """Print an entry of the catalogue."""
    here = entry.find_local()
    _print_heading(entry.name, f"{entry.kind}, public file")
    print_rows(
        {
            "stresses": entry.stresses,
            "here": str(here) if here else f"no; glossbench data fetch {entry.name}",
            "read as": yaml.safe_dump(entry.reading, default_flow_style=True).strip("{}\n"),
            "licence": entry.licence,
            "source": entry.url,
            "bytes": str(entry.bytes),
            "sha256": entry.sha256,
        }
    )
