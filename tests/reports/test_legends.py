"""Legends of plots in print: all of a legend is inside its figure, however many lines there are and however long."""

import numpy as np
import pytest

from glossbench.reports.model.axes import Label
from glossbench.reports.model.panels import Axis, Line, Panel
from glossbench.reports.print import plots
from glossbench.reports.style import shade


def figure(n_lines, name, n_panels=1):
    x = np.array([1.0, 2.0, 4.0])
    lines = [
        Line(Label(f"{name} {i}", i, i, shade(i), options={}), x, (1 + i) / x, np.zeros(3, bool), slope=-1.0)
        for i in range(n_lines)
    ]
    return plots.draw([Panel("", Axis("samples"), Axis("rms"), lines) for _ in range(n_panels)])


def find_overhang(drawn):
    """By how many pixels the texts of the legend reach out of the figure, and the least height of a plot."""
    drawn.draw_without_rendering()
    [legend] = drawn.legends
    width, height = drawn.bbox.size
    boxes = [text.get_window_extent() for text in (*legend.get_texts(), legend.get_title())]
    beyond = max(max(-box.x0, box.x1 - width, -box.y0, box.y1 - height) for box in boxes)
    return beyond, min(ax.get_window_extent().height for ax in drawn.axes) / drawn.dpi


@pytest.mark.parametrize(
    ("n_lines", "name", "n_panels"),
    [(40, "a_method_of_a_long_name", 3), (3, "W" * 60, 1), (2, "words " * 40, 2)],
)
def test_a_legend_is_inside_its_figure(n_lines, name, n_panels):
    drawn = figure(n_lines, name, n_panels)

    beyond, height = find_overhang(drawn)
    assert beyond <= 0
    assert height > 1
    assert drawn.get_figwidth() <= plots.WIDTH


def test_the_check_notices_columns_that_do_not_fit(monkeypatch):
    monkeypatch.setattr(plots, "count_columns", lambda names, width: 3)

    assert find_overhang(figure(12, "W" * 30, 3))[0] > 50
