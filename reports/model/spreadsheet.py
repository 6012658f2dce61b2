"""The table of cells as a CSV file."""

from base64 import b64encode

import pandas

FORMULA = ("=", "+", "-", "@", "\t", "\r")


def make_csv_link(cells: pandas.DataFrame) -> str:
    """All columns with all digits, as the target of a link.

    A text that a spreadsheet would run as a formula gets an apostrophe in front, because names come from a study.
    """
    safe = cells.map(lambda value: f"'{value}" if isinstance(value, str) and value.startswith(FORMULA) else value)
    return f"data:text/csv;charset=utf-8;base64,{b64encode(safe.to_csv(index=False).encode()).decode()}"
