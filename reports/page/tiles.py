"""Small pictures of the page: sample patterns, and the precomputed state of methods."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from glossbench.run.results import Results

from .. import raster, style
from ..model.conditions import Cell, Group, list_methods
from ..model.panels import Floats

MANY_PATTERNS = 12
MANY_STATES = 24


def make_pattern_tiles(results: Results, groups: Sequence[Group]) -> dict[str, Any]:
    """The different patterns of half vectors that pixels share; of too many only their number."""
    found: dict[Any, tuple[Group, Cell, Floats]] = {}
    for group in groups:
        for cell in group.done:
            half_vectors = results.half_vectors(cell.row["key"])
            if half_vectors is not None:
                found.setdefault((cell.index, half_vectors.tobytes()), (group, cell, half_vectors))
    if not found or len(found) > MANY_PATTERNS:
        return {"count": len(found), "tiles": []}
    hues = list_methods([group for group in groups if group.done])
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


def make_state_tiles(results: Results, groups: Sequence[Group]) -> list[dict[str, Any]]:
    """Pictures of the precomputed state of methods, each at its own exposure; of many cells, the first ones."""
    tiles: list[dict[str, Any]] = []
    # There may be many thousand files: they are listed once, not once per cell.
    have = {
        name.removeprefix("images/").partition("_state_")[0]
        for name in results.store.list("images/")
        if "_state_" in name
    }
    for group in groups:
        for cell in group.done:
            key = cell.row["key"]
            found = results.pictures(key) if key in have and len(tiles) < MANY_STATES else {}
            for name, image in found.items():
                shown = np.ones(image.shape[:2], bool)
                lit = image.max(axis=2) > 0  # an unfolded cube has empty corners
                exposure = raster.choose_exposure(image, lit) if lit.any() else 1.0
                png = raster.draw_picture(image, shown, exposure)
                tile = {"name": name, "title": group.title, "cell": cell, "shape": image.shape, "exposure": exposure}
                tiles.append({**tile, "picture": raster.to_uri(png)})
    return tiles
