"""Errors that a user can mend: one clear line that says what, the rule, the value and the nearest valid name."""

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path


class InputError(ValueError):
    """Anything a user can fix: a study, an option, a file. Its text is one line; the command line exits with 2."""


class CannotWrite(InputError):
    """A file that cannot be written: a full disk, a folder that may only be read.

    Attributes:
        path: of the file.
    """

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"{path}: cannot be written: {reason}")
        self.path = path


def nearest(name: str, known: Iterable[str]) -> str:
    """A hint for an unknown name: "; did you mean 'kurt'?", or the valid names when none is near."""
    names = sorted(known)
    by_lower = {known_name.lower(): known_name for known_name in names}
    close = get_close_matches(str(name).lower(), by_lower, n=1, cutoff=0.5)
    if close:
        return f"; did you mean {by_lower[close[0]]!r}?"
    return f"; known: {', '.join(names)}" if names else ""


def called(value: object) -> str:
    """A value of a wrong type in a few words: text and numbers as they are, all else by its class."""
    return repr(value) if isinstance(value, str | int | float | None) else f"a {type(value).__name__}"


def check_call(function: str, **arguments: tuple[object, type]) -> None:
    """InputError where one of the arguments, each a value and its class, is something else: what to write instead."""
    for name, (value, wanted) in arguments.items():
        if not isinstance(value, wanted):
            example = value if isinstance(value, str) else "..."
            order = ", ".join(arguments)
            raise InputError(
                f'{function}({order}): {name} must be what gb.{name}("{example}") makes, got {called(value)}'
            )


class MethodError(RuntimeError):
    """A plug-in broke the shade interface: wrong shape or dtype, or radiance that is not finite."""
