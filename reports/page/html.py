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
from glossbench.study.labels import format_options, read_budget, with_names

from .. import style
from ..model.answer import draw_answer
from ..model.cell_table import list_costs, list_counts, list_errors, make_cell_table, make_stage_table
from ..model.conditions import Group
from ..model.decision import RANKS, decide
from ..model.descriptions import INSTALLED, MethodText, define_metrics, describe_methods
from ..model.facts import list_provenance, without_image
from ..model.notation import split_runs
from ..model.report import Report
from ..model.selection import MOST_PICTURES, choose_cells
from ..model.spreadsheet import make_csv
from ..model.tables import make_claim_table, make_equal_table, make_reference_table
from ..raster import CLIPPED_SHARE, WHITE, svg_to_uri
from ..typesetting import Press
from .beside import link_csv, remove_others
from .contact_sheet import make_pictures
from .payload import build_payload
from .plot_data import deflate, plot_data
from .scripts import TEMPLATES, join_module, state_policy
from .tiles import MANY_PATTERNS, make_pattern_tiles, make_state_tiles

MOST_ROWS, FEWEST_ROWS = 1000, 5  # of a table, in total and for one light, material and view
MOST_EQUAL_ROWS = 3000  # of all tables of equal time and error
PAGE = ("deflated.js", "numbers.js", "scales.js", "plot.js", "points.js", "plots.js", "tables.js")


def write_report(where: Path | str) -> Path | str:
    """Write report.html to the store of results, whole or not at all, and return its path or address."""
    results = Results(where)
    results.disk.own("report.html")
    report = Report.from_results(results)
    viewer = build_payload(results, report.groups, report.measured[0] if report.measured else None)
    scripts = [
        join_module(PAGE),
        join_module(["deflated.js", "numbers.js", *sorted(path.name for path in TEMPLATES.glob("viewer*.js"))]),
    ]
    csv, tables = link_csv(results, make_csv(_add_names(report.cells)))
    most = max(FEWEST_ROWS, MOST_ROWS // max(1, len(report.groups)))
    quantities = [*list_counts(report), *list_errors(report, report.measured), *list_costs(report)]
    page = (
        _load_templates()
        .get_template("report.html")
        .render(
            scripts=scripts,
            policy=state_policy(scripts),
            report=report,
            study=report.study,
            study_yaml=yaml.safe_dump(report.study, sort_keys=False, allow_unicode=True),
            metrics=report.measured,
            definitions=define_metrics(report.measured, report.descriptions),
            provenance=list_provenance(report),
            cells=make_cell_table(report, quantities, most),
            stages=make_stage_table(report, most),
            references=make_reference_table(report),
            is_long=len(report.cells) > MOST_ROWS,
            most_rows=MOST_ROWS,
            most_equal=max(FEWEST_ROWS, MOST_EQUAL_ROWS // max(1, len(report.equal))),
            missing=without_image(report),
            viewer=viewer,
            answer=_draw_answer(report),
            decision=decide(report),
            ranks_explained=RANKS,
            plots=deflate(plot_data(report)),
            sheets=_make_sheets(results, report.groups),
            patterns=make_pattern_tiles(results, report.groups),
            n_patterns=MANY_PATTERNS,
            states=make_state_tiles(results, report.groups),
            csv=csv,
            methods=_describe_methods(describe_methods(report.list_values("method"), report.descriptions)),
            installed_note=INSTALLED,
            white=WHITE,
            share=100 - CLIPPED_SHARE,
        )
    )
    results.disk.write("report.html", page)
    remove_others(results, viewer.files | tables)
    return results.store.locate("report.html")


@cache
def _load_templates() -> Environment:
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
    templates.filters |= {
        "number": style.format_number,
        "count": style.format_whole,
        "samples": _format_samples,
        "budget": read_budget,
    }
    templates.filters |= {"options": format_options, "breakable": _make_breakable}
    templates.globals |= {"make_claim_table": make_claim_table, "make_equal_table": make_equal_table}
    return templates


def _add_names(cells: pandas.DataFrame) -> pandas.DataFrame:
    """The table with the names of its lights, materials and views, which older results do not contain."""
    return pandas.DataFrame(with_names(cells.to_dict("records")), index=cells.index)


def _format_samples(value: float) -> str:
    return f"{style.format_whole(value)} {'sample' if value == 1 else 'samples'}"


def _make_breakable(name: str) -> Markup:
    """A name with possible line breaks after its underscores."""
    return escape(name).replace("_", Markup("_<wbr>"))


def _draw_answer(report: Report) -> dict[str, Any] | None:
    """The picture at the top of the page, for the first metric."""
    if report.answer is None:
        return None
    pictures = draw_answer(report.results, report.answer)
    bar = style.draw_colour_bar(pictures["limit"], "image − reference [radiance]")
    return pictures | {"metric": report.measured[0], "bar": Markup(style.to_svg(bar, "answer-bar"))}


def _make_sheets(results: Results, groups: Sequence[Group]) -> list[dict[str, Any]]:
    """The contact sheet of each group that has images."""
    pictured = choose_cells(groups, MOST_PICTURES)
    return [
        {"group": group, "images": make_pictures(results, group, pictured[i], f"g{i}")}
        for i, group in enumerate(groups)
        if group.done
    ]


def _describe_methods(methods: Sequence[MethodText]) -> list[dict[str, Any]]:
    """Descriptions of methods, with the equation as the source of an <img>, if typst can set it."""
    with Press() as press:

        def image(equation: str) -> str:
            return svg_to_uri(press.equation(equation)) if equation and press.is_equation(equation) else ""

        return [
            method._asdict() | {"image": image(method.equation), "source": split_runs(method.source)}
            for method in methods
        ]
