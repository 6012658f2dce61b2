"""Errors that a user can fix: one clear line with the name, the rule, the value and the nearest valid name."""

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path


class InputError(ValueError):
    """An error that a user can fix, in a study, an option or a file. Its text is one line; the exit code is 2."""


class WriteError(InputError):
    """A file cannot be written: for example, the disk is full or the folder is read-only.

    Attributes:
        path: the path or address of the file.
    """

    def __init__(self, path: Path | str, reason: str) -> None:
        super().__init__(f"{path}: cannot be written: {reason}")
        self.path = path


def suggest_nearest(name: str, known: Iterable[str]) -> str:
    """A hint for an unknown name: "; did you mean 'kurt'?", or all valid names if none is similar."""
    names = sorted(known)
    return find_nearest(name, names) or (f"; known: {', '.join(names)}" if names else "")


def find_nearest(name: str, known: Iterable[str]) -> str:
    """A hint for an unknown name: "; did you mean 'kurt'?", or nothing if none is similar."""
    by_lower = {known_name.lower(): known_name for known_name in known}
    close = get_close_matches(str(name).lower(), by_lower, n=1, cutoff=0.5)
    return f"; did you mean {by_lower[close[0]]!r}?" if close else ""


def describe_wrong_value(value: object) -> str:
    """A value of a wrong type in a few words: text and numbers themselves, other values by their class."""
    return repr(value) if isinstance(value, str | int | float | None) else f"a {type(value).__name__}"


def check_call(function: str, **arguments: tuple[object, type]) -> None:
    """Raise InputError if an argument does not have its class; the error says what to write instead.

    Args:
        arguments: by name, the value and the class that it must have.
    """
    for name, (value, wanted) in arguments.items():
        if not isinstance(value, wanted):
            example = value if isinstance(value, str) else "..."
            order = ", ".join(arguments)
            got = describe_wrong_value(value)
            raise InputError(f'{function}({order}): {name} must be what gb.{name}("{example}") makes, got {got}')


class MethodError(RuntimeError):
    """A plug-in broke its interface: for example, a wrong shape or dtype, or radiance that is not finite."""
