"""Typesetting by typst: a folder of data, images and templates becomes pages. Texts of a study are never code."""

import os
import re
import subprocess
import sys
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any, Literal

import typst
from matplotlib import get_data_path
from matplotlib.figure import Figure

from glossbench.errors import InputError
from glossbench.strict_json import dumps

from .style import RC, style

TEMPLATES = Path(__file__).parent / "print" / "templates"
LONGEST = 64  # characters of a word; inside a longer word a line may break
PIECE = 16  # after so many characters
Format = Literal["pdf", "png", "svg"]
_FONTS = str(Path(get_data_path()) / "fonts" / "ttf")
_SET = """
import sys, typst
root, template, fonts, made = sys.argv[1:]
typst.Compiler(root=root, font_paths=typst.Fonts(font_paths=[fonts])).compile(template, output=made, format="pdf")
"""
_first_process: dict[str, int] = {}  # the one in which typst has started its threads


class Press:
    """A temporary folder that typst reads from; templates see no file outside it.

    Texts reach a template as JSON strings, never as source: a title that looks like code is printed as it is.
    """

    def __enter__(self) -> "Press":
        if _first_process.setdefault("id", os.getpid()) != os.getpid():
            raise InputError(
                "reports cannot be written in a forked process whose parent wrote some: typst's threads do not survive "
                "a fork; start processes by spawn or forkserver"
            )
        self._temporary = TemporaryDirectory(prefix="glossbench-")
        self.folder = Path(self._temporary.name)
        fonts = typst.Fonts(font_paths=[_FONTS])
        self._compiler = typst.Compiler(root=str(self.folder), font_paths=fonts)
        self._n_files = 0
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._temporary.cleanup()

    def add(self, content: bytes, ending: str) -> str:
        """The name of a new file with this content."""
        self._n_files += 1
        name = f"{self._n_files}.{ending}"
        (self.folder / name).write_bytes(content)
        return name

    def figure(self, figure: Figure) -> dict[str, Any]:
        """File and width [pt] of a plot as SVG, in which lines stay lines, and text stays text in the same font."""
        out = BytesIO()
        nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        with style({**RC, "svg.hashsalt": str(self._n_files)}):
            figure.savefig(out, format="svg", transparent=True, metadata=nothing)
        return {"file": self.add(out.getvalue(), "svg"), "width": 72 * figure.get_figwidth()}

    def is_equation(self, text: str) -> bool:
        """Whether typst can set this as mathematics."""
        source = self.folder / "equation.typ"
        source.write_text('#eval(sys.inputs.text, mode: "math")')
        try:
            self._compiler.compile(str(source), sys_inputs={"text": text})
        except typst.TypstError:
            return False
        return True

    def equation(self, text: str) -> bytes:
        """An SVG of an equation for which `is_equation` is true, in black, cropped."""
        source = self.folder / "line.typ"
        source.write_text(
            "#set page(width: auto, height: auto, margin: 1pt, fill: none)\n#set text(size: 13pt)\n"
            '#math.equation(block: true, eval(sys.inputs.text, mode: "math"))'
        )
        made = self._compiler.compile(str(source), format="svg", sys_inputs={"text": text})
        first = made[0] if isinstance(made, list) else made
        assert first is not None  # as below
        return first

    def pages(self, template: str, data: Mapping[str, Any], form: Format = "pdf") -> bytes:
        """A template filled with data: a PDF, or an image of its first page."""
        (self.folder / "data.json").write_text(dumps(_make_breakable(data)), encoding="utf-8")
        for source in TEMPLATES.glob("*.typ"):
            (self.folder / source.name).write_bytes(source.read_bytes())
        if form == "pdf":
            return self._set_pdf(template)
        made = self._compiler.compile(str(self.folder / template), format=form, ppi=300)
        first = made[0] if isinstance(made, list) else made
        assert first is not None  # without an output file typst returns what it made
        return first

    def _set_pdf(self, template: str) -> bytes:
        """A PDF, set in a separate process, because a long one needs half a gigabyte."""
        made = self.folder / "made.pdf"
        arguments = (str(self.folder), str(self.folder / template), _FONTS, str(made))
        done = subprocess.run(
            [sys.executable, "-c", _SET, *arguments], capture_output=True, text=True, errors="replace"
        )
        if done.returncode != 0:
            told = " ".join(done.stderr.split()) or f"the process ended with {done.returncode}"
            raise RuntimeError(f"typst: {told[-500:]}")
        return made.read_bytes()


def _make_breakable(value: Any) -> Any:
    """The data with spaces of zero width in long words, so that lines may break there."""
    if isinstance(value, str):
        text = value.encode("utf-8", "backslashreplace").decode()  # half a character would not be JSON
        return re.sub(rf"\S{{{LONGEST + 1},}}", lambda word: re.sub(rf".{{{PIECE}}}", "\\g<0>\u200b", word[0]), text)
    if isinstance(value, Mapping):
        return {key: _make_breakable(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_make_breakable(each) for each in value]
    return value
