"""Errors that a plug-in raised: their text in one line, and their place in the source."""

import os
import sysconfig
import traceback
from pathlib import Path


def summarize_error(error: BaseException) -> str:
    """The class and the first line of an error."""
    first, *_ = [*str(error).splitlines(), ""]
    return f"{type(error).__name__}: {first}"


def locate_error(error: BaseException) -> str:
    """FILE:LINE in the plug-in that raised the error or called the code that did; empty if no plug-in took part."""
    core = str(Path(__file__).parent)
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if not frame.filename.startswith(core)]
    return next((f"{f.filename}:{f.lineno}" for f in reversed(frames) if _is_of_plugin(f.filename)), "")


def _is_of_plugin(file: str) -> bool:
    """Whether a file belongs to a plug-in: neither to a library nor to Python."""
    libraries = {sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")}
    return os.path.isfile(file) and not any(library and file.startswith(library) for library in libraries)
