"""The contact sheet of a report: of each group the reference, pictures of cells, and their signed error maps."""

from collections.abc import Sequence
from itertools import groupby
from typing import Any, TypeVar

import numpy as np
from markupsafe import Markup

from glossbench.run.results import Results

from . import figures, pictures
from .cells import Cell, Group

Item = TypeVar("Item")
MOST_PICTURES = 72  # of a report
SIZE = 160  # pixels on the longer side


def chosen(groups: Sequence[Group], most: int) -> list[list[Cell]]:
    """The cells of each group that are drawn: all; if those are more than `most`, fewer budgets of each line.

    First the smallest, middle and largest budget are kept, then the largest alone, then of the lines some, evenly.
    """
    kept: list[list[Cell]] = []
    for n_budgets in (None, 3, 1):
        kept = [
            [cell for _, line in groupby(group.done, key=lambda cell: cell.index) for cell in _thinned(line, n_budgets)]
            for group in groups
        ]
        if sum(map(len, kept)) <= most:
            return kept
    share = max(1, most // max(1, sum(map(bool, kept))))
    return [evenly(cells, share) for cells in kept]


def evenly(items: Sequence[Item], most: int) -> list[Item]:
    """At most so many of some, at even distances, from the first to the last."""
    if len(items) <= most:
        return list(items)
    return [items[round(i * (len(items) - 1) / max(1, most - 1))] for i in range(most)]


def _thinned(line: Any, n_budgets: int | None) -> list[Cell]:
    cells = list(line)
    if n_budgets is None:
        return cells
    picked = {len(cells) - 1} if n_budgets == 1 else {0, len(cells) // 2, len(cells) - 1}
    return [cells[i] for i in sorted(picked)]


def pictures_of(results: Results, group: Group, shown: Sequence[Cell], name: str) -> dict[str, Any]:
    """Pictures of cells with their signed error maps: one exposure, one scale."""
    if not group.done:
        return {}
    key = group.reference["reference_key"]
    reference, mask = results.reference(key).astype(np.float64), results.mask(key)
    errors = [(results.image(c.row["key"]) - reference).mean(axis=2)[mask] for c in group.done]
    limit = pictures.error_limit(errors)
    exposure = pictures.exposure_of(reference, mask)
    tiles = []
    for cell in shown:
        image = results.image(cell.row["key"])
        picture = pictures.uri(pictures.picture(image, mask, exposure, SIZE))
        error = pictures.uri(pictures.error_map((image - reference).mean(axis=2), mask, limit, True, SIZE))
        tiles.append({"cell": cell, "picture": picture, "error": error})
    noise = results.standard_error(key).mean(axis=2)
    return {
        "picture": pictures.uri(pictures.picture(reference, mask, exposure, SIZE)),
        "noise": pictures.uri(pictures.error_map(noise, mask, limit, True, SIZE)),
        "rows": _tile_rows(tiles),
        "left_out": len(group.done) - len(shown),
        "limit": limit,
        "clipped": 100 * float(np.mean([np.abs(e) > limit for e in errors])),
        "exposure": exposure,
        "stops": f"{round(float(np.log2(exposure)), 1) + 0.0:+.1f}".replace("-", "−"),
        "shape": mask.shape,
        "size": SIZE,
        "scaled": max(mask.shape) > SIZE,
        "bar": Markup(figures.svg(figures.colour_bar(limit, "image − reference [radiance]"), f"{name}-bar")),
    }


def _tile_rows(tiles: Sequence[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    """A row for each method with more than one budget; the others together in the last."""
    rows = [list(members) for _, members in groupby(tiles, key=lambda tile: tile["cell"].index)]
    single = [row[0] for row in rows if len(row) == 1]
    return [row for row in rows if len(row) > 1] + ([single] if single else [])
