"""The command line: run a study, write its report, look things up, check a method, measure this machine."""

import json
import logging
import sys
from collections.abc import Callable
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.logging import RichHandler
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar
from rich.table import Table

from glossbench.errors import InputError, nearest

app = typer.Typer(
    help="Compare prefiltering methods for glossy image-based lighting against a converged reference.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
data_app = typer.Typer(help="Public inputs by name.", no_args_is_help=True)
app.add_typer(data_app, name="data")
out = Console()
err = Console(stderr=True)

StudyArgument = Annotated[str, typer.Argument(metavar="STUDY", help="A study's name (quickstart) or a path to its YAML.")]


def main() -> None:
    """Entry point: bad input ends with one line and exit code 2, an interrupt with 130."""
    logging.basicConfig(level=logging.WARNING, format="%(message)s", handlers=[RichHandler(console=err, show_path=False)])
    try:
        app()
    except InputError as error:
        err.print(f"error: {error}", style="red", markup=False, highlight=False, soft_wrap=True)
        sys.exit(2)
    except KeyboardInterrupt:
        err.print("interrupted: cells that are done are kept, the same command goes on from there")
        sys.exit(130)


@app.command()
def run(
    study: StudyArgument,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Folder of results; results/STUDY.")] = None,
    light: Annotated[str | None, typer.Option(help="An HDR file in place of the study's lights.")] = None,
    method: Annotated[list[str] | None, typer.Option("-f", "--method", help="Only this method; repeatable.")] = None,
    seed: Annotated[int | None, typer.Option(help="In place of the study's seed.")] = None,
    no_cache: Annotated[bool, typer.Option("--no-cache", help="Compute every cell and reference anew.")] = False,
    rerun_failed: Annotated[bool, typer.Option("--rerun-failed", help="Try failed cells again.")] = False,
    fail_fast: Annotated[bool, typer.Option("--fail-fast", help="Stop at the first cell that fails.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would run, and stop.")] = False,
) -> None:
    """Run a study, print its table and verdicts, and write its report."""
    from glossbench.runner import Progress, require_methods, run_study
    from glossbench.study import load_study

    loaded = load_study(study, light_file=light)
    if seed is not None:
        loaded = loaded.with_seed(seed)
    if method:
        loaded = require_methods(loaded, method)
    if light is not None and output is None:
        output = Path("results") / f"{loaded.name}_{Path(light).stem}"
    folder = output or Path("results") / loaded.name
    if dry_run:
        for cell in loaded.cells():
            out.print(f"{cell.light.name} {cell.material.json} {cell.view.name} {cell.method.name} {cell.method.json}",
                      markup=False, highlight=False, soft_wrap=True)  # fmt: skip
        out.print(f"{len(loaded.cells())} cells would go to {folder}")
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Bar(*columns, console=err, transient=True) as bar:
        task = bar.add_task("", total=None)
        progress = Progress(
            begin=lambda n: bar.update(task, total=n),
            doing=lambda text: bar.update(task, description=text),
            cell=lambda row: bar.advance(task),
        )
        results = run_study(
            loaded, folder, use_cache=not no_cache, rerun_failed=rerun_failed, fail_fast=fail_fast, progress=progress
        )
        bar.update(task, description="report")
        pages = [write(results.folder) for write in _report_writers().values()]
    _print_table(results.cells, list(loaded.metrics))
    _print_verdicts(results.claims)
    for page in pages:
        out.print(f"report: {page}", highlight=False, soft_wrap=True)
    failed = int((results.cells["status"] == "failed").sum())
    if failed:
        err.print(f"{failed} cells failed: their tracebacks are in the report, --rerun-failed tries them again", style="red")
        raise typer.Exit(1)


@app.command()
def report(results: Annotated[Path, typer.Argument(help="A folder that a run made.")]) -> None:
    """Write the report of results again."""
    from glossbench.results import Results

    opened = Results.open(results)
    for write in _report_writers().values():
        out.print(f"report: {write(opened.folder)}", highlight=False, soft_wrap=True)


@app.command()
def validate(study: StudyArgument) -> None:
    """Check a study without running it."""
    from glossbench.study import load_study

    loaded = load_study(study)
    out.print(f"{loaded.title}: {len(loaded.cells())} cells, {len(loaded.claims)} claims", markup=False, highlight=False)


@app.command()
def schema() -> None:
    """Print the JSON Schema of studies, for editors."""
    from glossbench.study import schema as study_schema

    print(json.dumps(study_schema(), indent=2))


@app.command()
def info(name: Annotated[str | None, typer.Argument(help="A method, material, light, view or metric.")] = None) -> None:
    """List what there is, or describe one thing: its docstring, options, bounds and defaults."""
    registries = _registries()
    if name is None:
        for kind, registry in registries.items():
            out.print(f"[bold]{kind}[/bold]  {', '.join(registry.names())}", highlight=False)
        out.print(f"[bold]study[/bold]  {', '.join(_study_names())}", highlight=False)
        return
    for kind, registry in registries.items():
        if name in registry.names():
            _describe(kind, registry.get(name))
            return
    raise InputError(f"nothing is called {name!r}{nearest(name, [n for r in registries.values() for n in r.names()])}")


@app.command(name="check-method")
def check_method(name: Annotated[str, typer.Argument(help="A registered method, or a module that registers one.")]) -> None:
    """Check a method against the contract that every method keeps."""
    from glossbench.contract import check_contract

    outcomes = check_contract(name)
    table = Table("check", "outcome", "measured", box=None, pad_edge=False)
    for outcome in outcomes:
        verdict = {True: "[green]kept[/green]", False: "[red]broken[/red]", None: "not claimed"}[outcome.kept]
        table.add_row(outcome.check, verdict, outcome.measured)
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
    from glossbench.runner import system_information

    for key, value in system_information().items():
        out.print(f"{key}: {value}", markup=False, highlight=False, soft_wrap=True)


@data_app.command(name="list")
def data_list() -> None:
    """List the catalogue: name, what it is, licence, and whether it is here."""
    from glossbench.catalog import entries

    table = Table("name", "kind", "here", "stresses", "licence", box=None, pad_edge=False)
    for entry in entries():
        table.add_row(entry.name, entry.kind, "yes" if entry.local() else "no", entry.stresses, entry.licence)
    out.print(table)


@data_app.command(name="fetch")
def data_fetch(name: Annotated[str, typer.Argument(help="A name of `data list`.")]) -> None:
    """Bring a file of the catalogue here, verified by its hash."""
    from glossbench.catalog import fetch

    out.print(str(fetch(name)), highlight=False, soft_wrap=True)


def _report_writers() -> dict[str, Callable[[Path], Path]]:
    return {point.name: point.load() for point in entry_points(group="glossbench.reports")}


def _registries() -> dict[str, Any]:
    from glossbench.brdf.material import MATERIALS
    from glossbench.envmap.lights import LIGHTS
    from glossbench.metrics import METRICS
    from glossbench.scene.points import VIEWS
    from glossbench.shading import METHODS

    return {"method": METHODS, "material": MATERIALS, "light": LIGHTS, "view": VIEWS, "metric": METRICS}


def _study_names() -> list[str]:
    from glossbench.study import study_names

    return study_names()


def _describe(kind: str, cls: Any) -> None:
    from inspect import cleandoc

    from glossbench.options import json_schema

    out.print(f"[bold]{cls.name}[/bold] ({kind})\n", highlight=False)
    out.print(cleandoc(cls.__doc__ or ""), markup=False, highlight=False)
    table = Table("option", "default", "values", box=None, pad_edge=False)
    for option, rule in json_schema(cls)["properties"].items():
        table.add_row(option, json.dumps(rule.get("default")) if "default" in rule else "required", _bounds(rule))
    if table.row_count:
        out.print()
        out.print(table)


def _bounds(rule: dict[str, Any]) -> str:
    """What a JSON Schema property allows, in a few words."""
    if "anyOf" in rule:
        return " or ".join(_bounds(part) for part in rule["anyOf"])
    if "enum" in rule or "const" in rule:
        return ", ".join(str(value) for value in rule.get("enum", [rule.get("const")]))
    if "prefixItems" in rule:
        return f"{len(rule['prefixItems'])} x {_bounds(rule['prefixItems'][0])}"
    signs = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}
    limits = [f"{sign} {rule[key]:g}" for key, sign in signs.items() if key in rule]
    return " ".join([str(rule.get("type", "any")), *limits])


def _print_table(cells: Any, metrics: list[str]) -> None:
    table = Table(box=None, pad_edge=False)
    for heading in ("light", "material", "method", "samples", *metrics, "shade ms"):
        table.add_column(heading, justify="left" if heading in ("light", "material", "method") else "right")
    for row in cells.to_dict("records"):
        if row["status"] != "done":
            last = row["reason"].strip().splitlines()[-1]
            table.add_row(row["light"], row["material"], row["method"], row["status"], last)
            continue
        numbers = ["floor" if row["at_noise_floor"] and name != "mean_error" else f"{row[name]:.4g}" for name in metrics]
        material = f"{row['material']} {_short(row['material_options'])}"
        table.add_row(row["light"], material, row["method"], str(row["n_samples"]), *numbers,
                      f"{1000 * row['shade_seconds']:.1f}")  # fmt: skip
    out.print(table)


def _short(options: str) -> str:
    """The first option that tells materials apart at a glance: its widths."""
    values = json.loads(options)
    value = values.get("m", values.get("alpha"))
    if value is None:
        return ""
    return f"{value[0]:g}" if len(set(value)) == 1 else " ".join(f"{v:g}" for v in value)


def _print_verdicts(claims: list[dict[str, Any]]) -> None:
    styles = {"holds": "green", "does not hold": "red", "within noise": "yellow"}
    for claim in claims:
        out.print()
        out.print(claim["verdict"], style=styles.get(claim["verdict"], "dim"), end="  ", highlight=False)
        out.print(f"{claim['text']}\n  {claim['summary']}", markup=False, highlight=False)
    out.print()
