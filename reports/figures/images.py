"""The images of one light, material and view as a file."""

from collections.abc import Mapping
from typing import Any, ClassVar

from ..figure import FIGURES, Figure
from ..model.options import ErrorOption, GroupOption, Option
from ..model.report import Report
from ..model.selection import MOST_PICTURES, choose_cells
from ..print.images import PrintedGroup
from ..typesetting import Press


@FIGURES.register("images")
class Images(Figure):
    """Whole images over their signed errors, or over the error maps of a metric."""

    options: ClassVar[Mapping[str, Option]] = {"group": GroupOption(), "metric": ErrorOption()}
    in_reports = False  # reports have the images of each group

    def printed(self, report: Report, press: Press, **given: Any) -> dict[str, Any]:
        group = given["group"]
        printed = PrintedGroup(report.results, group, press, given["metric"])
        return {"kind": "images", **printed.arrange_whole(choose_cells([group], MOST_PICTURES)[0])}
