"""Docstrings as data: reports, `info` and citations say what they say, also where Python was told to drop them."""

import ast
import inspect
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
