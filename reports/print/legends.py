"""The legend below the plots of a figure in print: its columns and names fit the width of the figure."""

from collections.abc import Sequence
from textwrap import wrap
from typing import Any

from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path

SIZE = 7.5  # of the text [pt]
# In units of the size of the text, as matplotlib takes them; the last two are its own defaults.
LAYOUT: dict[str, Any] = {"handlelength": 3.2, "columnspacing": 1.4, "labelspacing": 0.3,
                          "handletextpad": 0.8, "borderpad": 0.4}  # fmt: skip
MOST_COLUMNS = 3
ROW = 0.15  # height of a row [inches]


def count_columns(names: Sequence[str], width: float) -> int:
    """How many columns of a legend fit a width [inches]; 0 if the longest name does not fit alone."""
    beside = SIZE * (LAYOUT["handlelength"] + LAYOUT["handletextpad"])
    gap, border = SIZE * LAYOUT["columnspacing"], 4 * SIZE * LAYOUT["borderpad"]
    column = beside + max(map(_measure, names))
    return min(MOST_COLUMNS, int((72 * width - border + gap) // (column + gap)))


def wrap_names(names: Sequence[str], width: float) -> list[str]:
    """The names with line ends, so that each fits a column of a width [inches]."""
    if count_columns(names, width):
        return list(names)
    longest = max(names, key=_measure)
    # A line of the average letters of the longest name, and a tenth less for its widest letters.
    beside = SIZE * (LAYOUT["handlelength"] + LAYOUT["handletextpad"] + 4 * LAYOUT["borderpad"])
    letters = int(0.9 * len(longest) * (72 * width - beside) / _measure(longest))
    return ["\n".join(wrap(name, letters)) for name in names]


def count_lines(names: Sequence[str]) -> int:
    """The lines of text of names below each other."""
    return sum(1 + name.count("\n") for name in names)


def _measure(text: str) -> float:
    """The width of the widest line of a text [pt]."""
    font = FontProperties(size=SIZE)
    return max(text_to_path.get_text_width_height_descent(line, font, False)[0] for line in text.split("\n"))
