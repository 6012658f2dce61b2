"""The table of cells as a CSV file."""

import pandas

FORMULA = ("=", "+", "-", "@", "\t", "\r")


def make_csv(cells: pandas.DataFrame) -> bytes:
    """All columns with all digits.

    A text that a spreadsheet would run as a formula gets an apostrophe in front, because names come from a study.
    """
    safe = cells.map(lambda value: f"'{value}" if isinstance(value, str) and value.startswith(FORMULA) else value)
    return safe.to_csv(index=False).encode()
