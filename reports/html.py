"""The HTML report of a study: one file, read from what the run left on disk, that opens without a network."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from glossbench.metrics import METRICS
from glossbench.results import Results, replacing

from . import figures
from .cells import Cell, Group, grouped, listed, parsed
from .images import MOST_MAPS, MOST_PICTURES, chosen, mapped, maps_of, pictures_of
from .lines import Place, axis_of, lines_at
from .pictures import CLIPPED_SHARE, WHITE, Floats
from .scripts import TEMPLATES, module, policy

MANY_PATTERNS = 12
PAGE = ("tables.js",)


def write_report(folder: Path) -> Path:
    """Writes report.html into a folder of results, whole or not at all, and returns its path."""
    results = Results(folder)
    rows = [parsed(row) for row in results.cells.to_dict("records")]
    metrics = [name for name in _metrics(results.study) if name in results.cells.columns]
    groups = grouped(rows, metrics)
    templates = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters |= {"number": figures.number, "count": _count, "samples": _samples}
    templates.filters |= {"options": listed, "breakable": _breakable}
    viewer = sorted(path.name for path in TEMPLATES.glob("viewer*.js"))
    scripts = [module(names) for names in (PAGE, viewer) if names]
    page = templates.get_template("report.html").render(
        scripts=scripts,
        policy=policy(scripts),
        study=results.study,
        study_yaml=yaml.safe_dump(results.study, sort_keys=False, allow_unicode=True),
        claims=results.claims,
        provenance=results.provenance,
        metrics=metrics,
        definitions=_metrics(results.study),
        groups=groups,
        sections=_sections(results, groups, metrics),
        patterns=_patterns(results, groups),
        n_patterns=MANY_PATTERNS,
        seen={key: _seen(rows, key) for key in ("version", "torch", "device", "processor", "seed", "light_key")},
        white=WHITE,
        share=100 - CLIPPED_SHARE,
    )
    path = Path(folder) / "report.html"
    with replacing(path) as part:
        part.write_text(page, encoding="utf-8")
    return path


def _metrics(study: Mapping[str, Any]) -> dict[str, Any]:
    """Metrics by name: the registered class, or None for one whose plug-in is not installed here."""
    return dict.fromkeys(study.get("metrics") or ()) | {name: METRICS.get(name) for name in METRICS.names()}


def _count(value: float | None) -> str:
    """A whole number with narrow spaces between thousands."""
    if value is None:
        return "–"
    return f"{round(value):,}".replace(",", "\u202f") if value >= 1e4 else str(round(value))


def _samples(value: float) -> str:
    return f"{_count(value)} {'sample' if value == 1 else 'samples'}"


def _breakable(name: str) -> Markup:
    """A name that a line may break after its underscores."""
    return escape(name).replace("_", Markup("_<wbr>"))


def _sections(results: Results, groups: Sequence[Group], metrics: Sequence[str]) -> list[dict[str, Any]]:
    """What a report draws of each group: plots under each metric, pictures, error maps."""
    with_maps = mapped(metrics)
    pictured = chosen(groups, MOST_PICTURES)
    in_maps = chosen(groups, MOST_MAPS // max(1, len(with_maps)))
    sections = []
    for i, group in enumerate(groups):
        plots = {metric: _plots(group, metric, f"g{i}-{metric}", metric == metrics[0]) for metric in metrics}
        sections.append(
            {
                "group": group,
                "plots": {metric: drawn for metric, drawn in plots.items() if drawn},
                "images": pictures_of(results, group, pictured[i], f"g{i}"),
                "maps": maps_of(results, group, with_maps, in_maps[i], f"g{i}"),
                "n_unmapped": len(group.done) - len(in_maps[i]),
            }
        )
    return sections


def _plots(group: Group, metric: str, name: str, over_time: bool) -> list[Markup]:
    """A metric over samples, or by method where each has one budget; and over shading time."""
    place = Place(group.title, [group])
    lines, axis = lines_at(place, metric), axis_of(place, metric)
    if not lines:
        return []
    swept = any(len(set(line.samples)) > 1 for line in lines)
    drawn = [figures.error_over("samples", lines, axis) if swept else figures.error_by_method(lines, axis)]
    if over_time:
        drawn.append(figures.error_over("shade", lines, axis))
    return [Markup(figures.svg(figure, f"{name}-{i}")) for i, figure in enumerate(drawn)]


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
    widest = max(float(np.degrees(h[:, 0].max())) for _, _, h in found.values() if len(h))
    largest = max(5.0, np.ceil(widest / 5) * 5)
    tiles = []
    for i, (group, cell, half_vectors) in enumerate(found.values()):
        drawn = Markup(figures.svg(figures.pattern(half_vectors, largest), f"pattern{i}"))
        tiles.append({"title": group.title, "cell": cell, "n": len(half_vectors), "svg": drawn})
    return {"count": len(found), "tiles": tiles}


def _seen(rows: Sequence[Mapping[str, Any]], key: str) -> list[str]:
    """Different values of a column, in order."""
    return list(dict.fromkeys(str(row[key]) for row in rows if row.get(key) is not None))
