"""The consoles of the command line: what they print is plain text, whatever it came from and wherever it goes.

It comes from studies, plug-ins and names of files: markup and emoji codes stay the letters that they are, and what
would steer a terminal is shown as an escape. It goes to terminals and logs of any encoding, or to a
reader that is gone.
"""

import codecs
import io
import os
import sys
from collections.abc import Iterable
from typing import Any

from rich.console import Console as RichConsole
from rich.segment import Segment

# C0 and C1, and what turns the direction of writing or ends a line for some programs only.
_STEERING = (*range(0x20), *range(0x7F, 0xA0), 0x61C, 0x200E, 0x200F, *range(0x2028, 0x202F), *range(0x2066, 0x206A))
_ESCAPES = {code: chr(code).encode("unicode_escape").decode() for code in _STEERING}
_ESCAPES_IN_LINES = {code: escape for code, escape in _ESCAPES.items() if chr(code) not in "\n\t"}
# Signs of our own sentences, where an encoding has none.
_SPELLED = {"−": "-", "–": "-", "—": "-", "≤": "<=", "≥": ">=", "×": "x", "·": "*", "…": "...", "’": "'", "²": "^2"}


def one_line(text: str) -> str:
    """Text with ends of lines and all that steers a terminal shown as escapes."""
    return text.translate(_ESCAPES)


class Console(RichConsole):
    """A console for text of any origin; styles come from `style` and from `Text`, never from the letters themselves."""

    def __init__(self, stderr: bool = False, **options: Any) -> None:
        super().__init__(stderr=stderr, markup=False, emoji=False, highlight=False, **options)

    def render(self, *arguments: Any, **options: Any) -> Iterable[Segment]:
        """Segments whose text steers nothing."""
        for segment in super().render(*arguments, **options):
            yield segment if segment.control else segment._replace(text=segment.text.translate(_ESCAPES_IN_LINES))

    def on_broken_pipe(self) -> None:
        """Whoever read is gone, as `| head` is: nothing more is printed, and the work goes on."""
        self.quiet = True
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.file.fileno())
        os.close(nowhere)


def open_streams() -> None:
    """Make standard output and error take any text, and give those that were closed at the start a place.

    Without one the first file that is opened would get their number, and with it what is printed.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free: this one
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="glossbench")


def _spelled_out(error: UnicodeError) -> tuple[str, int]:
    """What takes the place of characters that an encoding does not have."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    missing = error.object[error.start : error.end]
    return "".join(_SPELLED.get(c) or c.encode("ascii", "backslashreplace").decode() for c in missing), error.end


codecs.register_error("glossbench", _spelled_out)
