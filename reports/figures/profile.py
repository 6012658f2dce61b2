"""Cross sections: radiance along one row of pixels, of the reference and of each method."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ..figure import FIGURES, Figure
from ..model.axes import Label
from ..model.conditions import Group, list_methods
from ..model.options import GroupOption, Option
from ..model.panels import Axis, Line, Panel, Panels
from ..model.report import Report
from ..model.selection import choose_middle_budgets
from ..raster import Floats, Mask
from ..style import INK, assign_looks


@FIGURES.register("profile")
class Profile(Figure):
    """Radiance along the row of the reference's brightest pixel, of the reference and of each method."""

    options: ClassVar[Mapping[str, Option]] = {"group": GroupOption()}
    in_reports = False  # the viewer has every row

    def data(self, report: Report, **given: Any) -> Panels:
        group: Group = given["group"]
        key = group.reference["reference_key"]
        reference, mask = report.results.reference(key), report.results.mask(key)
        row, cells = find_brightest_row(reference, mask), choose_middle_budgets(group)
        drawn = assign_looks([str(cell.row["method"]) for cell in cells], list_methods(report.groups))
        labels = [Label(cell.name, i, 0, *look) for i, (cell, look) in enumerate(zip(cells, drawn, strict=True))]
        images = [report.results.image(cell.row["key"]) for cell in cells]
        lines = [make_line(row, mask, Label("reference", -1, -1, INK), reference)]
        lines += [make_line(row, mask, label, image) for label, image in zip(labels, images, strict=True)]
        across = Axis(f"column [pixels], in row {row}", is_log=False)
        up = Axis("radiance", is_log=False, has_zero=True)
        title = f"radiance along row {row} of each method: {group.title}"
        return Panels([Panel("column", across, up, lines, is_curve=True)], title)


def find_brightest_row(reference: Floats, mask: Mask) -> int:
    """The row with the brightest pixel of the surface in a reference (H, W, 3)."""
    return int(np.where(mask, reference.sum(axis=2), -np.inf).argmax() // mask.shape[1])


def make_line(row: int, mask: Mask, label: Label, image: Floats) -> Line:
    """Radiance, as the mean of the channels, along a row of an image (H, W, 3)."""
    x = np.flatnonzero(mask[row])
    return Line(label, x.astype(float), image[row, x].mean(axis=1))
