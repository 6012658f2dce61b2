"""What a plug-in raised, in one line."""

import os
import sysconfig
import traceback
from pathlib import Path


def one_line(error: BaseException) -> str:
    """What was raised, and the line of the plug-in's file in which it was, or from which it came."""
    first, *_ = [*str(error).splitlines(), ""]
    core = str(Path(__file__).parent)
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if not frame.filename.startswith(core)]
    where = next((f" ({f.filename}:{f.lineno})" for f in reversed(frames) if _is_of_plugin(f.filename)), "")
    return f"{type(error).__name__}: {first}{where}"


def _is_of_plugin(file: str) -> bool:
    """Whether a file is somebody's own: neither a library's nor Python's."""
    libraries = {sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")}
    return os.path.isfile(file) and not any(library and file.startswith(library) for library in libraries)
