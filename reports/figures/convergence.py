"""Convergence: a metric or a cost over what a study sweeps."""

from collections.abc import Mapping
from typing import Any, ClassVar

from glossbench.findings.costs import COSTS

from ..figure import FIGURES, Figure
from ..model.axes import SAMPLES, Place, Sweep
from ..model.options import AxisOption, MetricOption, Option, PlaceOption
from ..model.panels import Panels
from ..model.plots import plot_by_method, plot_over_axis
from ..model.report import Report


@FIGURES.register("convergence")
class Convergence(Figure):
    """A metric or cost over a sweep, with fitted slopes and the reference's noise; without a sweep, by method."""

    options: ClassVar[Mapping[str, Option]] = {
        "metric": MetricOption(with_costs=True), "over": AxisOption(), "group": PlaceOption(),
    }  # fmt: skip

    def data(self, report: Report, metric: str, over: Sweep, group: Place, **_: Any) -> Panels:  # type: ignore[override]
        lines = report.lines(group, report.metrics[0] if metric in COSTS and report.metrics else metric)
        panel = plot_over_axis(group, metric, lines)
        if not lines:
            return Panels(note=f"no cell of {group.title} has {metric}")
        if not panel.spans:
            return Panels([plot_by_method(group, metric, lines)], "by method")
        return Panels([panel], f"over {over.name if over.name == SAMPLES else over.title}")
