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

from glossbench.findings.citations import cited_by
from glossbench.findings.legends import explain_table, explain_verdicts
from glossbench.metrics import METRICS
from glossbench.run.results import Results
from glossbench.strict_json import dumps
from glossbench.study.labels import budget_of, listed, parsed, with_names

from .. import raster, style
from ..model.answer import answer_of, claimed, drawn
from ..model.axes import SAMPLES, Place, places_of, sweeps_of
from ..model.conditions import Cell, Group, grouped, methods_of
from ..model.descriptions import described
from ..model.equal import Value, error_at_time, time_at_error
from ..model.lines import Floats, axis_of, lines_at
from ..model.notation import runs
from ..model.selection import MOST_PICTURES, chosen
from ..model.spreadsheet import csv_link
from ..model.times import shade_spread, spread_of, time_notes
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
    study, cells = results.study, results.cells
    rows = [parsed(row) for row in cells.to_dict("records")]
    metrics = [name for name in _metrics(study) if name in cells.columns]
    groups = grouped(rows, metrics)
    done = [group for group in groups if group.done]
    sweeps = sweeps_of(done, study.get("claims") or ())
    viewer = payload(results, groups, metrics[0] if metrics else None)
    scripts = [module(PAGE), module(sorted(path.name for path in TEMPLATES.glob("viewer*.js")))]
    page = (
        _templates()
        .get_template("report.html")
        .render(
            scripts=scripts,
            policy=policy(scripts),
            remarks=results.remarks(cells),
            study=study,
            study_yaml=yaml.safe_dump(study, sort_keys=False, allow_unicode=True),
            claims=results.claims,
            provenance=results.provenance,
            metrics=metrics,
            definitions=_metrics(study),
            groups=groups,
            most=max(FEWEST_ROWS, MOST_ROWS // max(1, len(groups))),
            most_rows=MOST_ROWS,
            missing=_missing(groups),
            viewer=viewer,
            answer=_answer(results, groups, metrics),
            plots=plot_data(done, sweeps, metrics),
            equal=_equal(places_of(done, sweeps[SAMPLES]), metrics),
            sheets=_sheets(results, groups),
            patterns=_patterns(results, groups),
            n_patterns=MANY_PATTERNS,
            states=_states(results, groups),
            csv=csv_link(_named(cells)),
            methods=_methods([row["method"] for row in rows]),
            citations=cited_by(_used(rows, metrics), str(study.get("source", ""))),
            seen={key: _seen(rows, key) for key in ("version", "torch", "device", "processor", "seed", "light_key")},
            white=WHITE,
            share=100 - CLIPPED_SHARE,
            times=time_notes(rows),
            verdict_words=explain_verdicts(results.claims),
            table_words=explain_table(rows),
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
    templates.filters |= {"number": style.number, "count": _count, "samples": _samples, "budget": budget_of}
    templates.filters |= {"options": listed, "breakable": _breakable, "sortable": _sortable, "shortest": _shortest}
    templates.filters |= {"shade_spread": shade_spread, "spread": _spread}
    return templates


def _named(cells: pandas.DataFrame) -> pandas.DataFrame:
    """The table with what its lights, materials and views are called, which older results do not hold."""
    return pandas.DataFrame(with_names(cells.to_dict("records")), index=cells.index)


def _metrics(study: Mapping[str, Any]) -> dict[str, Any]:
    """Metrics by name: the registered class, or None for one whose plug-in is not installed here."""
    return dict.fromkeys(study.get("metrics") or ()) | {name: METRICS.get(name) for name in METRICS.names()}


def _count(value: float | None) -> str:
    """A whole number with narrow spaces between thousands."""
    if value is None:
        return "–"
    return f"{round(value):,}".replace(",", "\u202f") if value >= 1e4 else str(round(value))


def _shortest(value: float) -> str:
    """A round number with no more digits than it has: 0.05, 1.5, 200."""
    mantissa = f"{value:.1e}".split("e")[0].removesuffix(".0")
    return style.number(value, len(mantissa.replace(".", "")))


def _spread(value: Value) -> str:
    return spread_of(*value)


def _samples(value: float) -> str:
    return f"{_count(value)} {'sample' if value == 1 else 'samples'}"


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


def _used(rows: Sequence[Mapping[str, Any]], metrics: Sequence[str]) -> list[tuple[str, str]]:
    """(kind, name) of all that a study is made of, methods first."""
    kinds = ("method", "material", "light", "view")
    return [(kind, name) for kind in kinds for name in _seen(rows, kind)] + [("metric", name) for name in metrics]


def _answer(results: Results, groups: Sequence[Group], metrics: Sequence[str]) -> dict[str, Any] | None:
    """The picture of the first screen, under the study's first metric."""
    answer = answer_of(groups, metrics[0], claimed(results)) if metrics else None
    if answer is None:
        return None
    pictures = drawn(results, answer)
    bar = style.colour_bar(pictures["limit"], "image − reference [radiance]")
    return pictures | {"metric": metrics[0], "bar": Markup(style.svg(bar, "answer-bar"))}


def _equal(places: Sequence[Place], metrics: Sequence[str]) -> list[dict[str, Any]]:
    """Tables of equal time and equal error of each place and metric, where two lines can be compared."""
    found = []
    for i, place in enumerate(places):
        for metric in metrics:
            lines, axis = lines_at(place, metric), axis_of(place, metric)
            by_time, by_error = error_at_time(lines, axis), time_at_error(lines, axis)
            if by_time or by_error:
                found.append(
                    {"place": i, "title": place.title, "metric": metric, "label": axis.label,
                     "by_time": by_time, "by_error": by_error}
                )  # fmt: skip
    return found


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


def _seen(rows: Sequence[Mapping[str, Any]], key: str) -> list[str]:
    """Different values of a column, in order."""
    return list(dict.fromkeys(str(row[key]) for row in rows if row.get(key) is not None))
