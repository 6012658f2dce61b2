"""What a plug-in raised, in one line, and where."""

import os
import sysconfig
import traceback
from pathlib import Path


def one_line(error: BaseException) -> str:
    """What was raised."""
    first, *_ = [*str(error).splitlines(), ""]
    return f"{type(error).__name__}: {first}"


def place_of(error: BaseException) -> str:
    """FILE:LINE of the plug-in in which it was raised, or from which it came; empty where no plug-in took part."""
    core = str(Path(__file__).parent)
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if not frame.filename.startswith(core)]
    return next((f"{f.filename}:{f.lineno}" for f in reversed(frames) if _is_of_plugin(f.filename)), "")


def _is_of_plugin(file: str) -> bool:
    """Whether a file is somebody's own: neither a library's nor Python's."""
    libraries = {sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")}
    return os.path.isfile(file) and not any(library and file.startswith(library) for library in libraries)
