"""The picture of the report's first page as a file."""

from collections.abc import Mapping
from typing import Any, ClassVar

from glossbench.errors import InputError

from ..figure import FIGURES, Figure
from ..model.options import MetricOption, Option
from ..model.report import Report
from ..print.images import PrintedGroup
from ..typesetting import Press


@FIGURES.register("answer")
class Answer(Figure):
    """The picture of the report's first page: crops of the methods where the metric differs most."""

    options: ClassVar[Mapping[str, Option]] = {"metric": MetricOption()}
    in_reports = False  # reports begin with it

    def printed(self, report: Report, press: Press, **given: Any) -> dict[str, Any]:
        found = report.find_answer(given["metric"])
        if found is None:
            raise InputError(f"{report.results.store.address} has no cell with an image and {given['metric']}")
        return {"kind": "crops", **PrintedGroup(report.results, found.group, press).arrange_crops(found.cells)}
