"""The HTML report of a study: one file, made from the files of the run, that opens without a network."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pandas
import yaml
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from glossbench.run.results import Results
from glossbench.strict_json import dumps
from glossbench.study.labels import budget_of, listed, with_names

from .. import style
from ..model.answer import drawn
from ..model.cell_table import cell_table, costs_of, counts_of, errors_of, stage_table
from ..model.conditions import Group
from ..model.descriptions import INSTALLED, MethodText, defined, described
from ..model.facts import provenance, without_image
from ..model.notation import runs
from ..model.report import Report
from ..model.selection import MOST_PICTURES, chosen
from ..model.spreadsheet import csv_link
from ..model.tables import claim_table, equal_table, reference_table
from ..raster import CLIPPED_SHARE, WHITE, svg_uri
from ..typesetting import Press
from .contact_sheet import pictures_of
from .payload import payload, remove_others
from .plot_data import plot_data
from .scripts import TEMPLATES, module, policy
from .tiles import MANY_PATTERNS, pattern_tiles, state_tiles

MOST_ROWS, FEWEST_ROWS = 1000, 5  # of a table, in total and for one light, material and view
PAGE = ("numbers.js", "scales.js", "plot.js", "points.js", "plots.js", "tables.js")


def write_report(folder: Path) -> Path:
    """Write report.html into a folder of results, whole or not at all, and return its path."""
    results = Results(folder)
    results.disk.own("report.html")
    report = Report.of(results)
    viewer = payload(results, report.groups, report.measured[0] if report.measured else None)
    scripts = [module(PAGE), module(["numbers.js", *sorted(path.name for path in TEMPLATES.glob("viewer*.js"))])]
    most = max(FEWEST_ROWS, MOST_ROWS // max(1, len(report.groups)))
    quantities = [*counts_of(report), *errors_of(report, report.measured), *costs_of(report)]
    page = (
        _templates()
        .get_template("report.html")
        .render(
            scripts=scripts,
            policy=policy(scripts),
            report=report,
            study=report.study,
            study_yaml=yaml.safe_dump(report.study, sort_keys=False, allow_unicode=True),
            metrics=report.measured,
            definitions=defined(report.measured, report.descriptions),
            provenance=provenance(report),
            cells=cell_table(report, quantities, most),
            stages=stage_table(report, most),
            references=reference_table(report),
            most_rows=MOST_ROWS,
            missing=without_image(report),
            viewer=viewer,
            answer=_answer(report),
            plots=plot_data(report),
            sheets=_sheets(results, report.groups),
            patterns=pattern_tiles(results, report.groups),
            n_patterns=MANY_PATTERNS,
            states=state_tiles(results, report.groups),
            csv=csv_link(_named(results.cells)),
            methods=_methods(described(report.seen("method"), report.descriptions)),
            installed_note=INSTALLED,
            white=WHITE,
            share=100 - CLIPPED_SHARE,
        )
    )
    results.disk.write("report.html", page)
    remove_others(results, viewer)
    return results.folder / "report.html"


@cache
def _templates() -> Environment:
    """Templates that escape all values, and raise an error if one is missing."""
    templates = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.policies["json.dumps_function"] = dumps
    templates.policies["json.dumps_kwargs"] = {}
    templates.filters |= {"number": style.number, "count": style.whole, "samples": _samples, "budget": budget_of}
    templates.filters |= {"options": listed, "breakable": _breakable}
    templates.globals |= {"claim_table": claim_table, "equal_table": equal_table}
    return templates


def _named(cells: pandas.DataFrame) -> pandas.DataFrame:
    """The table with the names of its lights, materials and views, which older results do not contain."""
    return pandas.DataFrame(with_names(cells.to_dict("records")), index=cells.index)


def _samples(value: float) -> str:
    return f"{style.whole(value)} {'sample' if value == 1 else 'samples'}"


def _breakable(name: str) -> Markup:
    """A name with possible line breaks after its underscores."""
    return escape(name).replace("_", Markup("_<wbr>"))


def _answer(report: Report) -> dict[str, Any] | None:
    """The picture at the top of the page, for the first metric."""
    if report.answer is None:
        return None
    pictures = drawn(report.results, report.answer)
    bar = style.colour_bar(pictures["limit"], "image − reference [radiance]")
    return pictures | {"metric": report.measured[0], "bar": Markup(style.svg(bar, "answer-bar"))}


def _sheets(results: Results, groups: Sequence[Group]) -> list[dict[str, Any]]:
    """The contact sheet of each group that has images."""
    pictured = chosen(groups, MOST_PICTURES)
    return [
        {"group": group, "images": pictures_of(results, group, pictured[i], f"g{i}")}
        for i, group in enumerate(groups)
        if group.done
    ]


def _methods(methods: Sequence[MethodText]) -> list[dict[str, Any]]:
    """Descriptions of methods, with the equation as the source of an <img>, if typst can set it."""
    with Press() as press:

        def image(equation: str) -> str:
            return svg_uri(press.equation(equation)) if equation and press.is_equation(equation) else ""

        return [
            method._asdict() | {"image": image(method.equation), "source": runs(method.source)} for method in methods
        ]
