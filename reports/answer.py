"""The picture that shows the answer: the methods side by side where they differ most, and a crop of where they err."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from glossbench.metrics import METRICS
from glossbench.results import Results

from . import pictures
from .cells import Cell, Group
from .crops import Crop, crops_of

MOST_TILES = 5


class Answer(NamedTuple):
    """Cells of one light, material and view that a first glance should show.

    Attributes:
        cells: one a method, in the order of the study; of a method with several lines the best.
        budget: the samples option that all of them share that have one; None without.
    """

    group: Group
    cells: Sequence[Cell]
    budget: int | None


def answer_of(groups: Sequence[Group], metric: str) -> Answer | None:
    """Of all groups and budgets the one with the most methods, and of these the one where the metric differs most.

    Differences are taken relative to the mean of the reference, so that no bright light outshouts the others.
    """
    found = [answer for group in groups for answer in _answers(group, metric)]
    if not found:
        return None
    return max(found, key=lambda answer: (len(answer.cells), _spread(answer, metric)))


def _answers(group: Group, metric: str) -> list[Answer]:
    cells = [cell for cell in group.done if cell.row.get(metric) is not None]
    budgets = sorted({cell.row["options"]["samples"] for cell in cells if _has_budget(cell)})
    return [
        Answer(group, telling([cell for cell in cells if not _has_budget(cell) or _budget(cell) == n], metric), n)
        for n in budgets or [None]
        if cells
    ]


def _has_budget(cell: Cell) -> bool:
    return isinstance(cell.row["options"].get("samples"), int)


def _budget(cell: Cell) -> int:
    return int(cell.row["options"]["samples"])


def telling(cells: Sequence[Cell], metric: str) -> list[Cell]:
    """At most `MOST_TILES`: the best cell of each method; of a single method from the best to the worst."""
    sign = 1 if metric not in METRICS.names() or METRICS.get(metric).lower_is_better else -1
    methods: dict[str, list[Cell]] = {}
    for cell in sorted(cells, key=lambda cell: sign * abs(cell.row[metric])):
        methods.setdefault(cell.row["method"], []).append(cell)
    if len(methods) == 1:
        only = next(iter(methods.values()))
        picked = only if len(only) <= MOST_TILES else [only[i] for i in _spaced(len(only), MOST_TILES)]
    else:
        picked = [own[0] for own in methods.values()][:MOST_TILES]
    return sorted(picked, key=lambda cell: (cell.index, cell.row["n_samples"]))


def _spaced(n: int, most: int) -> list[int]:
    return [round(i * (n - 1) / (most - 1)) for i in range(most)]


def _spread(answer: Answer, metric: str) -> float:
    values = [abs(cell.row[metric]) for cell in answer.cells]
    mean = answer.group.reference["reference_mean"]
    return float(max(values) - min(values)) / mean if mean else 0.0


def drawn(results: Results, answer: Answer, size: int = 192) -> dict[str, Any]:
    """Its pictures as sources of <img>: whole, the crop, and the signed error in the crop, on one scale."""
    key = answer.group.reference["reference_key"]
    reference, mask = results.reference(key).astype(np.float64), results.mask(key)
    images = [results.image(cell.row["key"]).astype(np.float64) for cell in answer.cells]
    errors = [(image - reference).mean(axis=2) for image in images]
    limit = pictures.middle_limit([error[mask] for error in errors])
    exposure = pictures.exposure_of(reference, mask)
    crops = crops_of(errors, mask, limit, 1)
    crop = crops[0] if crops else Crop(0, 0, mask.shape[1], mask.shape[0])
    side, part = max(crop.width, crop.height), crop.of(mask.astype(float)) > 0

    def tile(image: pictures.Floats, error: pictures.Floats | None) -> dict[str, Any]:
        return {
            "whole": pictures.uri(pictures.picture(image, mask, exposure, size)),
            "crop": pictures.uri(pictures.picture(crop.of(image), part, exposure, side)),
            "error": "" if error is None else pictures.uri(pictures.error_map(crop.of(error), part, limit, True, side)),
        }

    height, width = mask.shape
    return {
        "group": answer.group,
        "budget": answer.budget,
        "reference": tile(reference, None),
        "tiles": [
            {"cell": cell, **tile(*pair)}
            for cell, pair in zip(answer.cells, zip(images, errors, strict=True), strict=True)
        ],
        "limit": limit,
        "box": {
            "left": 100 * crop.x / width,
            "top": 100 * crop.y / height,
            "width": 100 * crop.width / width,
            "height": 100 * crop.height / height,
        },
        "crop": crop,
    }
