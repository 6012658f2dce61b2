"""The plots of a page as data: every case of every figure; equal values are stored once."""

import zlib
from base64 import b64encode
from collections.abc import Mapping
from math import isfinite
from typing import Any

import numpy as np

from glossbench.run.figures import FIGURES
from glossbench.strict_json import dumps

from ..figure import Case
from ..model.panels import Axis, Ends, Floats, Line, Panel
from ..model.report import Report


class Pool:
    """JSON values without duplicates; each is referred to by its index.

    The costs of a line are the same under every metric, and its errors the same against every cost.
    """

    def __init__(self) -> None:
        self.values: list[Any] = []
        self._places: dict[str, int] = {}
        self._of_numbers: dict[bytes, int] = {}  # most numbers repeat, and comparing bytes is fast

    def add(self, value: Any) -> int:
        """The index of a value."""
        text = dumps(value)
        if text not in self._places:
            self._places[text] = len(self.values)
            self.values.append(value)
        return self._places[text]

    def add_numbers(self, values: Floats | None) -> int | None:
        """The index of numbers, rounded to 6 digits, more than a plot or its tip shows; None if they are not finite."""
        if values is None:
            return None
        found = self._of_numbers.get(stored := np.asarray(values, float).tobytes())
        if found is None:
            short = [float(f"{value:.6g}") if isfinite(value) else None for value in values.tolist()]
            found = self._of_numbers[stored] = self.add(short)
        return found

    def add_ends(self, ends: Ends | None) -> list[int | None] | None:
        """The indices of lower and upper ends."""
        return ends and [self.add_numbers(end) for end in ends]


def plot_data(report: Report) -> dict[str, Any]:
    """The data for the script of the plots."""
    pool, found, titles = Pool(), [], dict[str, str]()
    # An option depends on those before it; the figures with the most options determine the order of all.
    for name in sorted(FIGURES.names(), key=lambda name: -len(FIGURES.get(name).options)):
        figure = FIGURES.get(name)()
        if figure.in_reports:
            titles |= {option: each.title for option, each in figure.options.items() if option not in titles}
            cases = [_pack_case(case, pool) for case in figure.cases(report)]
            found.append({"name": name, "options": list(figure.options), "cases": cases})
    return {"figures": found, "options": titles, "pool": pool.values}


def deflate(data: Any) -> str:
    """Data as JSON, deflated to about a sixth, as base64."""
    return b64encode(zlib.compress(dumps(data).encode(), 6)).decode()


def _pack_case(case: Case, pool: Pool) -> dict[str, Any]:
    given = {
        name: pool.add({"name": choice.name, "title": choice.title, "part": choice.part})
        for name, choice in case.choices.items()
    }
    return {
        "given": given,
        "panels": [_pack_panel(panel, pool) for panel in case.panels.panels],
        "note": case.panels.note,
    }


def _pack_panel(panel: Panel, pool: Pool) -> dict[str, Any]:
    return {
        "name": panel.name,
        "x": pool.add(_pack_axis(panel.x)),
        "y": pool.add(_pack_axis(panel.y)),
        "lines": [_pack_line(line, pool) for line in panel.lines],
        "fronts": pool.add([[i, int(j)] for i, mask in enumerate(panel.fronts) for j in np.flatnonzero(mask)]),
        "isMain": panel.is_main,
        "isLastResort": panel.is_last_resort,
    }


def _pack_axis(axis: Axis) -> dict[str, Any]:
    return {
        "label": axis.label,
        "name": axis.name or axis.label,
        "floor": axis.floor,
        "isLog": axis.is_log,
        "hasZero": axis.has_zero,
        "atValues": axis.at_values,
        "names": list(axis.names),
    }


def _pack_line(line: Line, pool: Pool) -> list[int | None]:
    """Indices of x, of y, and of the rest."""
    beside = [{"title": each.title, "values": pool.add_numbers(each.values), "spread": pool.add_ends(each.spread)}
              for each in line.beside]  # fmt: skip
    rest: Mapping[str, Any] = {
        "label": pool.add(vars(line.label)),
        "keys": pool.add(list(line.keys)),
        "hollow": pool.add([bool(at) for at in line.is_hollow]),
        "band": pool.add_ends(line.band),
        "interval": pool.add_ends(line.interval),
        "spread": pool.add_ends(line.spread),
        "slope": line.slope,
        "beside": beside,
    }
    return [pool.add_numbers(line.x), pool.add_numbers(line.y), pool.add(rest)]
