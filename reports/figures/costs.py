"""Costs: what each error costs in time and memory."""

from collections.abc import Mapping
from typing import Any, ClassVar

from glossbench.findings.costs import COSTS

from ..figure import FIGURES, Figure
from ..model.axes import Place, Sweep
from ..model.options import AxisOption, MetricOption, Option, PlaceOption
from ..model.panels import Panels
from ..model.plots import has_cost, plot_against_cost, plot_by_method
from ..model.report import Report


@FIGURES.register("costs")
class Costs(Figure):
    """A metric over shading time, update costs and memory, with the Pareto front."""

    options: ClassVar[Mapping[str, Option]] = {
        "metric": MetricOption(), "over": AxisOption(with_costs=True), "group": PlaceOption(),
    }  # fmt: skip

    def data(self, report: Report, metric: str, over: Sweep, group: Place, **_: Any) -> Panels:  # type: ignore[override]
        lines = report.lines(group, metric)
        if not lines:
            return Panels(note=f"no cell of {group.title} has {metric}")
        with_cost = [cost for cost in COSTS if has_cost(lines, cost)]
        if not with_cost:
            return Panels([plot_by_method(group, metric, lines)], "by method")
        panels = [plot_against_cost(group, metric, lines, cost) for cost in with_cost]
        free = ", ".join(title.partition(" [")[0] for cost, title in COSTS.items() if cost not in with_cost)
        note = f"No cost, or less than 0.01 ms, for any line: {free}." if free else ""
        return Panels(panels, "against costs", note)
