"""Fronts: what each error costs over all conditions, and which configurations no other one beats with certainty."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from glossbench.findings.costs import COSTS
from glossbench.findings.decisions import Choice, Choices

from ..figure import FIGURES, Figure
from ..model.axes import Label, Sweep
from ..model.decision import has_choice
from ..model.options import AxisOption, MetricOption, Option
from ..model.panels import Axis, Line, Panel, Panels
from ..model.plots import make_cost_axis
from ..model.report import Report


@FIGURES.register("fronts")
class Fronts(Figure):
    """A metric over each cost, for all conditions together, with the Pareto fronts beyond noise."""

    options: ClassVar[Mapping[str, Option]] = {"metric": MetricOption(), "over": AxisOption(with_costs=True)}

    def data(self, report: Report, metric: str, over: Sweep, **_: Any) -> Panels:  # type: ignore[override]
        column = report.columns[metric]
        if not column.lower_is_better:
            return Panels(note=f"fronts are those of errors, and a higher {metric} is better")
        choices = report.choices(metric)
        n = len(choices.places)
        if n < 2 or not has_choice(choices):
            return Panels(note="fronts need two methods with images under two conditions")
        lowest = np.nanmin(choices.trials.log_errors, axis=0)
        heights = {
            each.index: float(np.exp((choices.trials.log_errors[each.index] - lowest).mean())) for each in choices.all
        }
        axis = Axis(f"{column.title} / lowest", f"{metric} / lowest")
        lines = _group_lines(choices, over)
        panels = [panel for cost in COSTS if (panel := _plot(choices, cost, axis, lines, heights))]
        return Panels(panels, f"over all {n} conditions against costs")


def _group_lines(choices: Choices, over: Sweep) -> list[tuple[Label, list[Choice]]]:
    """The choices of each line of a sweep, in the order of the sweep."""
    found: dict[int, tuple[Label, list[tuple[float, Choice]]]] = {}
    for each in choices.all:
        row = next(iter(each.configuration.cells.values()))[0]
        value = over.value(row)
        if value is not None:
            label = over.labels[row["key"]]
            found.setdefault(label.index, (label, []))[1].append((value, each))
    return [
        (label, [choice for _, choice in sorted(own, key=lambda pair: pair[0])])
        for label, own in sorted(found.values(), key=lambda pair: pair[0].index)
    ]


def _plot(
    choices: Choices, cost: str, y: Axis, lines: list[tuple[Label, list[Choice]]], heights: Mapping[int, float]
) -> Panel | None:
    """Errors over the largest cost; None if the cost of all is negligible or unknown."""
    costs = choices.trials.cost(cost).max(axis=1)
    if not (costs[[each.index for each in choices.all]] > 0).any():
        return None
    front = choices.find_front(cost)
    drawn, masks = [], []
    for label, own in lines:
        x, values = (np.array([of[each.index] for each in own]) for of in (costs, heights))
        drawn.append(Line(label, x, values))
        masks.append(np.array([each in front for each in own]))
    return Panel(f"front {cost}", make_cost_axis(cost), y, drawn, masks)
