"""The HTML report of a study: one file, read from what the run left on disk, that opens without a network."""

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import yaml
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from glossbench.metrics import METRICS
from glossbench.run.results import Results
from glossbench.strict_json import dumps
from glossbench.study.labels import budget_of, listed, with_names

from .. import raster, style
from ..model.answer import drawn
from ..model.conditions import Cell, Group, methods_of
from ..model.descriptions import described
from ..model.equal import Value
from ..model.notation import runs
from ..model.panels import Floats
from ..model.report import Report
from ..model.selection import MOST_PICTURES, chosen
from ..model.spreadsheet import csv_link
from ..model.times import shade_spread, spread_of
from ..raster import CLIPPED_SHARE, WHITE, svg_uri
from ..typesetting import Press
from .contact_sheet import pictures_of
from .payload import payload, remove_others
from .plot_data import plot_data
from .scripts import TEMPLATES, module, policy

MANY_PATTERNS = 12
MANY_STATES = 24
MOST_ROWS, FEWEST_ROWS = 1000, 5  # of a table, in all and of a light, material and view
PAGE = ("numbers.js", "scales.js", "plot.js", "points.js", "plots.js", "tables.js")


def write_report(folder: Path) -> Path:
    """Writes report.html into a folder of results, whole or not at all, and returns its path."""
    results = Results(folder)
    results.disk.own("report.html")
    report = Report.of(results)
    viewer = payload(results, report.groups, report.measured[0] if report.measured else None)
    scripts = [module(PAGE), module(["numbers.js", *sorted(path.name for path in TEMPLATES.glob("viewer*.js"))])]
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
            definitions=_metrics(report.study),
            groups=report.groups,
            most=max(FEWEST_ROWS, MOST_ROWS // max(1, len(report.groups))),
            most_rows=MOST_ROWS,
            missing=_missing(report.groups),
            viewer=viewer,
            answer=_answer(report),
            plots=plot_data(report),
            sheets=_sheets(results, report.groups),
            patterns=_patterns(results, report.groups),
            n_patterns=MANY_PATTERNS,
            states=_states(results, report.groups),
            csv=csv_link(_named(results.cells)),
            methods=_methods(report.seen("method")),
            white=WHITE,
            share=100 - CLIPPED_SHARE,
        )
    )
    results.disk.write("report.html", page)
    remove_others(results, viewer)
    return results.folder / "report.html"


@cache
def _templates() -> Environment:
    """Templates that escape all that they are given, and stop where something is missing."""
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
    templates.filters |= {"options": listed, "breakable": _breakable, "sortable": _sortable, "shortest": style.tick}
    templates.filters |= {"shade_spread": shade_spread, "spread": _spread}
    return templates


def _named(cells: pandas.DataFrame) -> pandas.DataFrame:
    """The table with what its lights, materials and views are called, which older results do not hold."""
    return pandas.DataFrame(with_names(cells.to_dict("records")), index=cells.index)


def _metrics(study: Mapping[str, Any]) -> dict[str, Any]:
    """Metrics by name: the registered class, or None for one whose plug-in is not installed here."""
    return dict.fromkeys(study.get("metrics") or ()) | {name: METRICS.get(name) for name in METRICS.names()}


def _spread(value: Value) -> str:
    return spread_of(*value)


def _samples(value: float) -> str:
    return f"{style.whole(value)} {'sample' if value == 1 else 'samples'}"


def _breakable(name: str) -> Markup:
    """A name that a line may break after its underscores."""
    return escape(name).replace("_", Markup("_<wbr>"))


def _sortable(cell: Cell, metrics: Sequence[str], told: bool, tuned: bool) -> list[float | str | None]:
    """What a row of the table sorts by, a value a column; None comes last, an error at the noise floor first."""
    row = cell.row
    names = [row["method"], *([cell.options] if told else []), *([listed(row["tuned"])] if tuned else [])]
    if not cell.done:
        return [*names, budget_of(row)]
    errors = [0.0 if row["at_noise_floor"] else row[metric] for metric in metrics]
    updates = [row["update_seconds"].get(change, 0) for change in ("light", "material", "geometry", "view")]
    costs = [row["shade_seconds"], sum(row["stage_seconds"].values()), *updates, row["state_bytes"]]
    return [*names, row["n_samples"], *errors, *costs]


def _missing(groups: Sequence[Group]) -> list[dict[str, Any]]:
    """The cells without an image, with the last line of what they say."""
    return [
        {"group": group, "cell": cell, "last": (cell.row["reason"] or "no traceback").strip().splitlines()[-1]}
        for group in groups
        for cell in group.cells
        if not cell.done
    ]


def _answer(report: Report) -> dict[str, Any] | None:
    """The picture of the first screen, under the first metric."""
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


def _methods(names: Sequence[str]) -> list[dict[str, Any]]:
    """Methods in words, with their equation as the source of an <img>, where it is one."""
    with Press() as press:

        def image(equation: str) -> str:
            return svg_uri(press.equation(equation)) if equation and press.is_equation(equation) else ""

        return [
            method._asdict() | {"image": image(method.equation), "source": runs(method.source)}
            for method in described(names)
        ]


def _patterns(results: Results, groups: Sequence[Group]) -> dict[str, Any]:
    """Half vectors that the pixels share, equal ones once; only their number where there are too many."""
    found: dict[Any, tuple[Group, Cell, Floats]] = {}
    for group in groups:
        for cell in group.done:
            half_vectors = results.half_vectors(cell.row["key"])
            if half_vectors is not None:
                found.setdefault((cell.index, half_vectors.tobytes()), (group, cell, half_vectors))
    if not found or len(found) > MANY_PATTERNS:
        return {"count": len(found), "tiles": []}
    hues = methods_of([group for group in groups if group.done])
    widest = max(float(np.degrees(h[:, 0].max())) for _, _, h in found.values() if len(h))
    largest = max(5.0, np.ceil(widest / 5) * 5)
    tiles = [
        {
            "title": group.title,
            "cell": cell,
            "n": len(half_vectors),
            "colour": style.shade(hues[str(cell.row["method"])]),
            "dots": style.polar(half_vectors, largest),
        }
        for group, cell, half_vectors in found.values()
    ]
    return {"count": len(found), "tiles": tiles, "largest": largest}


def _states(results: Results, groups: Sequence[Group]) -> list[dict[str, Any]]:
    """Pictures of what methods keep, each at an exposure of its own; of the first cells where there are many."""
    tiles: list[dict[str, Any]] = []
    # One listing of a folder that may hold many thousand files, not one a cell.
    have = {path.name.partition("_state_")[0] for path in (results.folder / "images").glob("*_state_*.exr")}
    for group in groups:
        for cell in group.done:
            key = cell.row["key"]
            found = results.pictures(key) if key in have and len(tiles) < MANY_STATES else {}
            for name, image in found.items():
                shown = np.ones(image.shape[:2], bool)
                lit = image.max(axis=2) > 0  # an unfolded cube has empty places
                exposure = raster.exposure_of(image, lit) if lit.any() else 1.0
                png = raster.picture(image, shown, exposure)
                tile = {"name": name, "title": group.title, "cell": cell, "shape": image.shape, "exposure": exposure}
                tiles.append({**tile, "picture": raster.uri(png)})
    return tiles
