"""Figures of images for print: whole images over their signed error maps, and crops next to a marked reference."""

from collections.abc import Iterable, Sequence
from itertools import groupby
from math import ceil
from typing import Any

import numpy as np

from glossbench.run.results import Results

from .. import raster, style
from ..model.answer import MOST_TILES, choose_best_cells
from ..model.conditions import Cell, Group
from ..model.crops import Crop, choose_crops
from ..model.selection import choose_middle_budgets
from ..raster import Floats, Mask
from ..typesetting import Press

COLUMNS = 6  # cells side by side
MOST_COLUMNS = 7  # if that saves a row
SIZE = 256  # pixels on the longer side of a whole image


class PrintedGroup:
    """The images of one light, material and view, at one exposure, with their errors.

    Args:
        press: receives the images.
        metric: the metric of the error maps; None for image − reference, the mean of the channels.
    """

    def __init__(self, results: Results, group: Group, press: Press, metric: str | None = None) -> None:
        self.results, self.group, self.press = results, group, press
        key = group.reference["reference_key"]
        self.reference = results.reference(key).astype(np.float64)
        self.mask = results.mask(key)
        self.exposure = raster.choose_exposure(self.reference, self.mask)
        self.metric = results.metric(metric) if metric is not None else None
        self.signed = self.metric is None or self.metric.signed
        self.noise = results.standard_error(key).mean(axis=2) if self.metric is None else None
        self.errors = {cell.row["key"]: self._read_error(cell) for cell in group.done}

    def arrange_whole(self, cells: Sequence[Cell]) -> dict[str, Any]:
        """Data of a figure of whole images, each over its error map; the reference first, over its standard error."""
        limit = raster.find_error_limit([error[self.mask] for error in self.errors.values()])
        noise = ["reference", f"noise {style.format_number(self.group.reference['reference_noise'], 2)}"]
        tiles = [[self._make_tile(self.reference, self.noise, limit, noise)]]
        for _, line in groupby(cells, key=lambda cell: cell.index):
            tiles.append([self._make_tile(*self._read_pixels(cell), limit, write_caption(cell)) for cell in line])
        rows = _pack(tiles)
        return {"columns": max(COLUMNS, *map(len, rows)), "rows": rows, **self._scale(limit, self.errors.values())}

    def arrange_crops(self, cells: Sequence[Cell], crops: Sequence[Crop] = ()) -> dict[str, Any]:
        """Data of a figure of crops, by default where the cells err most, and the whole reference with their frames.

        Error maps have the scale of the whole images of these cells.
        """
        errors = [self.errors[cell.row["key"]] for cell in cells]
        limit = raster.find_error_limit([error[self.mask] for error in errors])
        chosen = list(crops) or choose_crops(errors, self.mask, limit)
        columns = [{"caption": ["reference"], "tiles": self._make_crops(self.reference, self.noise, limit, chosen)}]
        columns += [
            {"caption": write_caption(c), "tiles": self._make_crops(*self._read_pixels(c), limit, chosen)}
            for c in cells
        ]
        height, width = self.mask.shape
        frames = [
            {"x": c.x / width, "y": c.y / height, "width": c.width / width, "height": c.height / height,
             "pixels": f"x {c.x}, y {c.y}, {c.width} × {c.height} pixels"}
            for c in chosen
        ]  # fmt: skip
        picture = self.press.add(raster.draw_picture(self.reference, self.mask, self.exposure, 512), "png")
        shown = {"columns": columns, "most": COLUMNS, "frames": frames, "picture": picture}
        return shown | self._scale(limit, errors)

    def _read_error(self, cell: Cell) -> Floats:
        image = self.results.image(cell.row["key"]).astype(np.float64)
        if self.metric is None:
            return (image - self.reference).mean(axis=2).astype(np.float32)
        return np.where(self.mask, self.metric.errors(image, self.reference, self.mask), 0.0).astype(np.float32)

    def _read_pixels(self, cell: Cell) -> tuple[Floats, Floats]:
        """Image and error of a cell."""
        return self.results.image(cell.row["key"]), self.errors[cell.row["key"]]

    def _make_tile(self, image: Floats, error: Floats | None, limit: float, caption: Sequence[str]) -> dict[str, Any]:
        picture = self.press.add(raster.draw_picture(image, self.mask, self.exposure), "png")
        return {"picture": picture, "error": self._draw_map(error, self.mask, limit, SIZE), "caption": caption}

    def _draw_map(self, error: Floats | None, mask: Mask, limit: float, size: int) -> str | None:
        """The file of an error map; None for the reference, if a standard error does not exist for this metric."""
        return (
            None
            if error is None
            else self.press.add(raster.draw_error_map(error, mask, limit, self.signed, size), "png")
        )

    def _make_crops(
        self, image: Floats, error: Floats | None, limit: float, crops: Sequence[Crop]
    ) -> list[dict[str, Any]]:
        tiles = []
        for crop in crops:
            mask, side = crop.cut(self.mask), max(crop.width, crop.height)
            picture = self.press.add(raster.draw_picture(crop.cut(image), mask, self.exposure, side), "png")
            shown = self._draw_map(None if error is None else crop.cut(error), mask, limit, side)
            tiles.append({"picture": picture, "error": shown})
        return tiles

    def _scale(self, limit: float, errors: Iterable[Floats]) -> dict[str, Any]:
        beyond = [np.abs(error[self.mask]) > limit for error in errors]
        return {
            "title": self.group.title,
            "scale": self.press.add(raster.scale(self.signed), "png"),
            "ticks": [
                style.format_number(s * limit, 2) for s in ((-1, -0.5, 0, 0.5, 1) if self.signed else (0, 0.5, 1))
            ],
            "label": self._make_label(),
            "limit": style.format_number(limit),
            "clipped": style.format_number(100 * float(np.mean(beyond)), 2),
            "stops": style.format_stops(self.exposure),
            "size": f"{self.mask.shape[1]} × {self.mask.shape[0]}",
        }

    def _make_label(self) -> str:
        if self.metric is None:
            return "image − reference [radiance]"
        unit = "" if self.metric.unit == "1" else f" [{self.metric.unit}]"
        return (self.metric.map_formula or self.metric.name) + unit


def _pack(lines: Sequence[list[dict[str, Any]]]) -> list[list[dict[str, Any]]]:
    """Tiles in rows. Each line stays in one row, unless all lines have one tile, or a line is longer than a row."""
    longest = max(map(len, lines))
    if longest == 1 or longest > COLUMNS:
        tiles = [tile for line in lines for tile in line]
        columns = max(COLUMNS, ceil(len(tiles) / ceil(len(tiles) / MOST_COLUMNS)))
        return [tiles[i : i + columns] for i in range(0, len(tiles), columns)]
    rows: list[list[dict[str, Any]]] = [[]]
    for line in lines:
        if len(rows[-1]) + len(line) > COLUMNS:
            rows.append([])
        rows[-1] += line
    return rows


def write_caption(cell: Cell) -> list[str]:
    """The caption of an image: the method, its options, its samples and its errors."""
    row = cell.row
    count = f"{row['n_samples']} {'sample' if row['n_samples'] == 1 else 'samples'}"
    if row["at_noise_floor"]:
        return [str(row["method"]), cell.options, count, "at the noise floor"]
    flip = [f"FLIP {style.format_number(row['flip'])}"] if row.get("flip") is not None else []
    return [str(row["method"]), cell.options, count, f"RMS {style.format_number(row['rms'])}", *flip]


def choose_best_few(group: Group, metric: str | None) -> list[Cell]:
    """The lines of a group, each at its middle budget, that one row of crops shows."""
    cells = choose_middle_budgets(group)
    if len(cells) <= MOST_TILES:
        return cells
    known = [cell for cell in cells if metric and cell.row.get(metric) is not None]
    return choose_best_cells(known, group.columns[metric]) if metric and known else cells[:MOST_TILES]
