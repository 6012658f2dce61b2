"""Docstrings as data: what each attribute of a class is."""

import re
from inspect import cleandoc


def attributes(cls: type) -> dict[str, str]:
    """What the docstrings of a class and its bases say of each attribute, a sentence each, where they do."""
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        section = re.search(
            r"^Attributes:\n((?:    .*\n?|\n)+)", cleandoc(vars(base).get("__doc__") or ""), re.MULTILINE
        )
        for entry in re.split(r"\n    (?=\S)", "\n" + section[1].rstrip()) if section else []:
            names, colon, text = entry.partition(":")
            if colon:
                found |= dict.fromkeys((name.strip() for name in names.split(",")), " ".join(text.split()))
    return found


def first_line(cls: type) -> str:
    """What a class is, in the first line of its docstring."""
    return (cls.__doc__ or "").strip().partition("\n")[0]
