"""Crops of the images of one light, material and view as a file."""

from collections.abc import Mapping
from typing import Any, ClassVar

from ..figure import FIGURES, Figure
from ..model.options import CropsOption, ErrorOption, GroupOption, Option
from ..model.report import Report
from ..model.selection import choose_middle_budgets
from ..print.images import PrintedGroup
from ..typesetting import Press


@FIGURES.register("crops")
class Crops(Figure):
    """Crops of each method at its middle budget, with their errors, next to a marked reference."""

    options: ClassVar[Mapping[str, Option]] = {"group": GroupOption(), "metric": ErrorOption(), "crop": CropsOption()}
    in_reports = False  # reports have crops of each group

    def printed(self, report: Report, press: Press, **given: Any) -> dict[str, Any]:
        group = given["group"]
        printed = PrintedGroup(report.results, group, press, given["metric"])
        return {"kind": "crops", **printed.arrange_crops(choose_middle_budgets(group), given["crop"])}
