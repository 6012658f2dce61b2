"""The HTML report of a study: one file, read from what the run left on disk, that opens without a network."""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from itertools import groupby
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

MANY_CELLS = 24  # beyond it a group of images shows three budgets a method
MANY_PATTERNS = 12
CLIPPED_SHARE = 0.5  # percent of the pixels that may lie beyond the scale of the error maps
WHITE = 99.0  # percentile of the reference that the exposure brings to white


def write_report(folder: Path) -> Path:
    """Writes report.html into a folder of results, whole or not at all, and returns its path."""
    results = Results(folder)
    rows = [parsed(row) for row in results.cells.to_dict("records")]
    metrics = [name for name in results.cells.columns if name in _metrics(results.study)]
    groups = grouped(rows, metrics)
    templates = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters |= {"number": figures.number, "count": _count, "samples": _samples}
    templates.filters |= {"options": listed, "breakable": _breakable}
    page = templates.get_template("report.html").render(
        study=results.study,
        study_yaml=yaml.safe_dump(results.study, sort_keys=False, allow_unicode=True),
        claims=results.claims,
        provenance=results.provenance,
        metrics=metrics,
        definitions=_metrics(results.study),
        groups=groups,
        sections=[(g, _plots(g, f"g{i}"), _images(results, g, f"g{i}")) for i, g in enumerate(groups)],
        patterns=_patterns(results, groups),
        n_patterns=MANY_PATTERNS,
        seen={key: _seen(rows, key) for key in ("version", "torch", "device", "processor", "seed", "light_key")},
        white=WHITE,
    )
    path = Path(folder) / "report.html"
    with replacing(path) as part:
        part.write_text(page, encoding="utf-8")
    return path


def _metrics(study: Mapping[str, Any]) -> dict[str, Any]:
    """Metrics by name: the registered class, or None for one whose plug-in is not installed here."""
    entries = [[entry] if isinstance(entry, str) else entry for entry in study.get("metrics") or ()]
    asked = dict.fromkeys(name for entry in entries for name in entry)
    return asked | {name: METRICS.get(name) for name in METRICS.names()}


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


def _plots(group: Group, name: str) -> list[Markup]:
    """RMS over samples and over shading time, or by method where each has one budget."""
    lines = []
    done = [cell for cell in group.done if cell.row["rms"] is not None]
    for index, members in groupby(done, key=lambda cell: cell.index):
        own = list(members)
        n, seconds, rms = (np.array([c.row[key] for c in own], float) for key in ("n_samples", "shade_seconds", "rms"))
        at_floor = np.array([bool(c.row["at_noise_floor"]) for c in own])
        lines.append(figures.Line(own[0].name, index, n, 1e3 * seconds, rms, at_floor))
    if not lines:
        return []
    noise = group.reference["reference_noise"] or 0.0
    swept = any(len(set(line.samples)) > 1 for line in lines)
    first = figures.error_over("samples", lines, noise) if swept else figures.error_by_method(lines, noise)
    second = figures.error_over("milliseconds", lines, noise)
    return [Markup(figures.svg(f, f"{name}-{i}")) for i, f in enumerate((first, second))]


def _images(results: Results, group: Group, name: str) -> dict[str, Any]:
    """Pictures and error maps of a group: one exposure, one scale."""
    if not group.done:
        return {}
    key = group.reference["reference_key"]
    reference, mask = results.reference(key).astype(np.float64), results.mask(key)
    errors = [(results.image(c.row["key"]) - reference).mean(axis=2)[mask] for c in group.done]
    limit = error_limit(errors)
    exposure = exposure_of(reference, mask)
    shown = _shown(group.done)
    tiles = []
    for cell in shown:
        image = results.image(cell.row["key"])
        picture = _uri(figures.picture(image, mask, exposure))
        error = _uri(figures.error_map((image - reference).mean(axis=2), mask, limit))
        tiles.append({"cell": cell, "picture": picture, "error": error})
    noise = results.standard_error(key).mean(axis=2)
    return {
        "picture": _uri(figures.picture(reference, mask, exposure)),
        "noise": _uri(figures.error_map(noise, mask, limit)),
        "rows": _tile_rows(tiles),
        "left_out": len(group.done) - len(shown),
        "limit": limit,
        "clipped": 100 * float(np.mean([np.abs(e) > limit for e in errors])),
        "share": 100 - CLIPPED_SHARE,
        "exposure": exposure,
        "stops": f"{round(float(np.log2(exposure)), 1) + 0.0:+.1f}".replace("-", "−"),
        "shape": mask.shape,
        "scaled": max(mask.shape) > 256,
        "bar": Markup(figures.svg(figures.colour_bar(limit), f"{name}-bar")),
    }


def _tile_rows(tiles: Sequence[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    """A row for each method with more than one budget; the others together in the last."""
    rows = [list(members) for _, members in groupby(tiles, key=lambda tile: tile["cell"].index)]
    single = [row[0] for row in rows if len(row) == 1]
    return [row for row in rows if len(row) > 1] + ([single] if single else [])


def error_limit(errors: Sequence[figures.Floats]) -> float:
    """The end of the scale that the error maps of a group share: a percentile of |error| of all cells."""
    size = np.abs(np.concatenate(errors))
    return float(np.percentile(size, 100 - CLIPPED_SHARE)) or float(size.max()) or 1.0


def exposure_of(reference: figures.Floats, mask: figures.Mask) -> float:
    """The factor that brings a high percentile of the reference's brightest channel to white."""
    brightest = reference[mask].max(axis=1)
    white = float(np.percentile(brightest, WHITE)) or float(brightest.max())
    return 1 / white if white > 0 else 1.0


def _shown(cells: Sequence[Cell]) -> list[Cell]:
    """All cells; of too many the smallest, middle and largest budget of each method."""
    if len(cells) <= MANY_CELLS:
        return list(cells)
    shown = []
    for _, members in groupby(cells, key=lambda cell: cell.index):
        own = list(members)
        shown += [own[i] for i in sorted({0, len(own) // 2, len(own) - 1})]
    return shown


def _patterns(results: Results, groups: Sequence[Group]) -> dict[str, Any]:
    """Half vectors that the pixels share, equal ones once; only their number where there are too many."""
    found: dict[Any, tuple[Group, Cell, figures.Floats]] = {}
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


def _uri(png: bytes) -> str:
    return f"data:image/png;base64,{b64encode(png).decode()}"
