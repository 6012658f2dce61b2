"""Docstrings as data: reports, `info` and citations say what they say, also where Python was told to drop them."""

import ast
import inspect
import re
import sys
from contextlib import suppress
from textwrap import dedent
from typing import Any


def documentation(described: Any) -> str:
    """The docstring of a class or function without its indentation; "" where there is none.

    Under -OO Python drops docstrings, and a dataclass has its signature for one: they are then read from the source,
    where that is there.
    """
    text = described.__doc__
    if sys.flags.optimize > 1:
        with suppress(OSError, TypeError, SyntaxError):
            text = ast.get_docstring(ast.parse(dedent(inspect.getsource(described))).body[0])  # type: ignore[arg-type]
    return inspect.cleandoc(text or "")


def attributes(cls: type) -> dict[str, str]:
    """What the docstrings of a class and its bases say of each attribute, a sentence each, where they do."""
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        section = re.search(r"^Attributes:\n((?:    .*\n?|\n)+)", documentation(base), re.MULTILINE)
        for entry in re.split(r"\n    (?=\S)", "\n" + section[1].rstrip()) if section else []:
            names, colon, text = entry.partition(":")
            if colon:
                found |= dict.fromkeys((name.strip() for name in names.split(",")), " ".join(text.split()))
    return found


def first_line(cls: type) -> str:
    """What a class is, in the first line of its docstring."""
    return documentation(cls).partition("\n")[0]
