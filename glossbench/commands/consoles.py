"""The consoles of the command line. They print plain text from any source to any output.

The text comes from studies, plug-ins and names of files. Markup and emoji codes are printed as they are, and control
characters are shown as escapes. The output may be a terminal or log of any encoding, or a pipe whose reader is gone.
"""

import codecs
import io
import os
import sys
from collections.abc import Iterable
from typing import Any

from rich.console import Console as RichConsole
from rich.segment import Segment

# C0 and C1 controls, and characters that change the direction of text, or end a line in some programs only.
_STEERING = (*range(0x20), *range(0x7F, 0xA0), 0x61C, 0x200E, 0x200F, *range(0x2028, 0x202F), *range(0x2066, 0x206A))
_ESCAPES = {code: chr(code).encode("unicode_escape").decode() for code in _STEERING}
_ESCAPES_IN_LINES = {code: escape for code, escape in _ESCAPES.items() if chr(code) not in "\n\t"}
# Replacements for the special characters of our own sentences, for encodings that lack them.
_SPELLED = {"−": "-", "–": "-", "—": "-", "≤": "<=", "≥": ">=", "×": "x", "·": "*", "…": "...", "’": "'", "²": "^2"}


def escape_controls(text: str) -> str:
    """The text with line ends and control characters shown as escapes."""
    return text.translate(_ESCAPES)


class Console(RichConsole):
    """A console for text from any source; styles come from `style` and from `Text`, never from the text itself."""

    def __init__(self, stderr: bool = False, **options: Any) -> None:
        super().__init__(stderr=stderr, markup=False, emoji=False, highlight=False, **options)

    def render(self, *arguments: Any, **options: Any) -> Iterable[Segment]:
        """The segments, with control characters shown as escapes."""
        for segment in super().render(*arguments, **options):
            yield segment if segment.control else segment._replace(text=segment.text.translate(_ESCAPES_IN_LINES))

    def on_broken_pipe(self) -> None:
        """The reader of a pipe is gone, for example `| head`: print nothing more, and continue the work."""
        self.quiet = True
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.file.fileno())
        os.close(nowhere)


def open_streams() -> None:
    """Let standard output and error accept any text, and open those streams that were closed at the start.

    If a stream stayed closed, the first file to be opened would get its number, and the printed text would go there.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest free number, which is this one
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="glossbench")


def _spell_out(error: UnicodeError) -> tuple[str, int]:
    """The replacement for characters that an encoding does not have."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    missing = error.object[error.start : error.end]
    return "".join(_SPELLED.get(c) or c.encode("ascii", "backslashreplace").decode() for c in missing), error.end


codecs.register_error("glossbench", _spell_out)
