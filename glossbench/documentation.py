"""Docstrings as data for reports, `info` and citations, also if Python runs with -OO and drops docstrings."""

import ast
import inspect
import re
import sys
from contextlib import suppress
from textwrap import dedent
from typing import Any


def read_documentation(described: Any) -> str:
    """The docstring of a class or function without its indentation; "" if it has none.

    With -OO, Python drops docstrings, and a dataclass has its signature instead. Then the docstring is read from the
    source file, if that exists.
    """
    text = described.__doc__
    if sys.flags.optimize > 1:
        with suppress(OSError, TypeError, SyntaxError):
            text = ast.get_docstring(ast.parse(dedent(inspect.getsource(described))).body[0])  # type: ignore[arg-type]
    return inspect.cleandoc(text or "")


def read_attributes(cls: type) -> dict[str, str]:
    """The text on each attribute in the docstrings of a class and its bases; attributes without text are left out."""
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        section = re.search(r"^Attributes:\n((?:    .*\n?|\n)+)", read_documentation(base), re.MULTILINE)
        for entry in re.split(r"\n    (?=\S)", "\n" + section[1].rstrip()) if section else []:
            names, colon, text = entry.partition(":")
            if colon:
                found |= dict.fromkeys((name.strip() for name in names.split(",")), " ".join(text.split()))
    return found


def read_first_line(cls: type) -> str:
    """The first line of the docstring of a class, which says what the class is."""
    return read_documentation(cls).partition("\n")[0]
