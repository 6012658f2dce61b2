"""Efficiency: how much a method gets for its time."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

from ..figure import FIGURES, Figure
from ..model.axes import Place, Sweep
from ..model.options import AxisOption, MetricOption, Option, PlaceOption
from ..model.panels import Axis, Line, Panel, Panels
from ..model.plots import axis_over
from ..model.report import Report


@FIGURES.register("efficiency")
class Efficiency(Figure):
    """1 / (error^2 t) over samples, t the shading time [ms]: constant for a method that converges as Monte Carlo does.

    Source: Hammersley and Handscomb 1964 section 5.1.
    """

    options: ClassVar[Mapping[str, Option]] = {
        "metric": MetricOption(), "over": AxisOption(with_costs=True), "group": PlaceOption(),
    }  # fmt: skip

    def data(self, report: Report, metric: str, over: Sweep, group: Place, **_: Any) -> Panels:  # type: ignore[override]
        lines = report.lines(group, metric)
        panel = Panel("efficiency", axis_over(group, lines), Axis(f"1 / ({metric}² t)"), [])
        drawn = [
            Line(line.label, line.x, 1 / (line.errors**2 * line.costs["shade"]), line.keys, line.at_floor)
            for line in lines
            if (line.errors > 0).all() and (line.costs["shade"] > 0).all()
        ]
        return Panels([replace(panel, lines=drawn)] if drawn else [], "and its efficiency")
