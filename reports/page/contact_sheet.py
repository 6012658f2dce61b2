"""The contact sheet of a report: for each group the reference, pictures of cells, and their signed error maps."""

from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np
from markupsafe import Markup

from glossbench.run.results import Results

from .. import raster, style
from ..model.conditions import Cell, Group

SIZE = 160  # pixels on the longer side


def make_pictures(results: Results, group: Group, shown: Sequence[Cell], name: str) -> dict[str, Any]:
    """Pictures of cells with their signed error maps: one exposure, one scale."""
    if not group.done:
        return {}
    key = group.reference["reference_key"]
    reference, mask = results.reference(key).astype(np.float64), results.mask(key)
    errors = [(results.image(c.row["key"]) - reference).mean(axis=2)[mask] for c in group.done]
    limit = raster.find_error_limit(errors)
    exposure = raster.choose_exposure(reference, mask)
    tiles = []
    for cell in shown:
        image = results.image(cell.row["key"])
        picture = raster.to_uri(raster.draw_picture(image, mask, exposure, SIZE))
        error = raster.to_uri(raster.draw_error_map((image - reference).mean(axis=2), mask, limit, True, SIZE))
        tiles.append({"cell": cell, "picture": picture, "error": error})
    noise = results.standard_error(key).mean(axis=2)
    return {
        "picture": raster.to_uri(raster.draw_picture(reference, mask, exposure, SIZE)),
        "noise": raster.to_uri(raster.draw_error_map(noise, mask, limit, True, SIZE)),
        "rows": _arrange_tiles(tiles),
        "left_out": len(group.done) - len(shown),
        "limit": limit,
        "clipped": 100 * float(np.mean([np.abs(e) > limit for e in errors])),
        "exposure": exposure,
        "stops": style.format_stops(exposure),
        "shape": mask.shape,
        "size": SIZE,
        "scaled": max(mask.shape) > SIZE,
        "bar": Markup(style.to_svg(style.draw_colour_bar(limit, "image − reference [radiance]"), f"{name}-bar")),
    }


def _arrange_tiles(tiles: Sequence[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    """A row for each method with more than one budget; the other methods share the last row."""
    rows = [list(members) for _, members in groupby(tiles, key=lambda tile: tile["cell"].index)]
    single = [row[0] for row in rows if len(row) == 1]
    return [row for row in rows if len(row) > 1] + ([single] if single else [])
