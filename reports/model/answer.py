"""The picture that shows the answer: the methods side by side where they differ most, and crops where they err most."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas
from pydantic import ValidationError

from glossbench.findings.columns import Column
from glossbench.findings.verdicts import find_cells
from glossbench.run.results import Results
from glossbench.study.claims import KINDS
from glossbench.study.labels import read_budget

from .. import raster
from .conditions import Cell, Group
from .crops import Crop, choose_crops
from .selection import pick_evenly

MOST_TILES = 5
Claimed = tuple[str, Collection[str]]  # the text of a claim, and the keys of the cells that it is about


class Answer(NamedTuple):
    """Cells of one light, material and view that a first glance should show.

    Attributes:
        cells: one per method, in the order of the study; of a method with several lines the best.
        budget: the budget that all methods with a budget share, as "17 samples"; else "".
        claim: the text of the claim that selected the cells; else "".
    """

    group: Group
    cells: Sequence[Cell]
    budget: str = ""
    claim: str = ""


def find_answer(groups: Sequence[Group], metric: str, claims: Iterable[Claimed] = ()) -> Answer | None:
    """One condition and budget of the study's first claim that has cells; without a claim, one of all.

    It is the one with the most methods; of several, the one where the metric differs most relative to the mean of the
    reference, so that a bright light does not dominate.
    """
    for text, keys in claims:
        if found := _make_answer(groups, metric, keys):
            return found._replace(claim=text)
    return _make_answer(groups, metric, None)


def _make_answer(groups: Sequence[Group], metric: str, keys: Collection[str] | None) -> Answer | None:
    found = [answer for group in groups for answer in _list_answers(group, metric, keys)]
    return max(found, key=lambda answer: (len(answer.cells), _measure_spread(answer, metric)), default=None)


def _list_answers(group: Group, metric: str, keys: Collection[str] | None) -> list[Answer]:
    """One answer per budget of a claim: the claim's cells of its methods, and the best cells of other methods."""
    cells = [cell for cell in group.done if cell.row.get(metric) is not None]
    own = [cell for cell in cells if keys is None or cell.row["key"] in keys]
    methods = {cell.row["method"] for cell in own}
    shown = [*own, *(cell for cell in cells if cell.row["method"] not in methods)]
    budgets: list[float | None] = [*sorted({n for cell in own if (n := read_budget(cell.row)) is not None})]
    found = []
    for n in budgets or [None] if own else ():
        alike = [cell for cell in shown if n is None or read_budget(cell.row) in (None, n)]
        names = dict.fromkeys(cell.row["budget"] for cell in alike if read_budget(cell.row) is not None)
        text = f"{n:g} {' or '.join(names)}" if n is not None else ""
        found.append(Answer(group, choose_best_cells(alike, group.columns[metric]), text))
    return found


def list_claimed(study: Mapping[str, Any], cells: pandas.DataFrame) -> Iterator[Claimed]:
    """The claims of a study, in its order, each with the keys of the cells that it is about."""
    for claim in study.get("claims") or ():
        kind = next((kind for kind in KINDS if kind in claim), None)
        try:
            known = KINDS[kind].model_validate(claim) if kind else None
        except ValidationError:  # it is from another version
            known = None
        if known is not None:
            yield known.text, find_cells(known, cells)


def choose_best_cells(cells: Sequence[Cell], metric: Column) -> list[Cell]:
    """At most `MOST_TILES` cells: the best of each method; for a single method, from the best to the worst."""
    sign = 1 if metric.lower_is_better else -1
    methods: dict[str, list[Cell]] = {}
    for cell in sorted(cells, key=lambda cell: sign * abs(cell.row[metric.name])):
        methods.setdefault(cell.row["method"], []).append(cell)
    if len(methods) == 1:
        only = next(iter(methods.values()))
        picked = pick_evenly(only, MOST_TILES)
    else:
        picked = [own[0] for own in methods.values()][:MOST_TILES]
    return sorted(picked, key=lambda cell: (cell.index, cell.row["n_samples"]))


def _measure_spread(answer: Answer, metric: str) -> float:
    values = [abs(cell.row[metric]) for cell in answer.cells]
    mean = answer.group.reference["reference_mean"]
    return float(max(values) - min(values)) / mean if mean else 0.0


def draw_answer(results: Results, answer: Answer, size: int = 192) -> dict[str, Any]:
    """The pictures of an answer as sources of <img>: whole, the crop, and its signed error, on one scale."""
    key = answer.group.reference["reference_key"]
    reference, mask = results.reference(key).astype(np.float64), results.mask(key)
    images = [results.image(cell.row["key"]).astype(np.float64) for cell in answer.cells]
    errors = [(image - reference).mean(axis=2) for image in images]
    limit = raster.find_middle_limit([error[mask] for error in errors])
    exposure = raster.choose_exposure(reference, mask)
    crops = choose_crops(errors, mask, limit, 1)
    crop = crops[0] if crops else Crop(0, 0, mask.shape[1], mask.shape[0])
    side, part = max(crop.width, crop.height), crop.cut(mask.astype(float)) > 0

    def make_tile(image: raster.Floats, error: raster.Floats | None) -> dict[str, Any]:
        return {
            "whole": raster.to_uri(raster.draw_picture(image, mask, exposure, size)),
            "crop": raster.to_uri(raster.draw_picture(crop.cut(image), part, exposure, side)),
            "error": ""
            if error is None
            else raster.to_uri(raster.draw_error_map(crop.cut(error), part, limit, True, side)),
        }

    height, width = mask.shape
    return {
        "group": answer.group,
        "budget": answer.budget,
        "claim": answer.claim,
        "reference": make_tile(reference, None),
        "tiles": [
            {"cell": cell, **make_tile(*pair)}
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
