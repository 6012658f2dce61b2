"""Finds a file that a study names: in the current folder, in the folder of the study, or among the public files."""

import os
from pathlib import Path

from glossbench.catalog.folders import DATA_VARIABLE, find_data_folders
from glossbench.errors import InputError


def locate(file: str, beside: Path | None = None, what: str = "image file") -> Path:
    """Finds an existing file by its path, tried in this order: as given, relative to the study, among the public files.

    Raises:
        InputError: the file is not in any of these places.
    """
    folder = os.environ.get(DATA_VARIABLE)
    for place in [Path(file), *([beside / file] if beside else [])]:
        if os.path.isfile(place):  # for a name that is too long it returns False; Path.is_file raises an error
            return place
    for data in [] if Path(file).is_absolute() else find_data_folders():
        matching = [p for p in sorted(data.rglob("*")) if p.as_posix().endswith(f"/{file}") and p.is_file()]
        if matching:
            return matching[0]
    tried = dict.fromkeys([Path.cwd(), *([beside] if beside else [])])
    where = f", nor below {DATA_VARIABLE}={folder}" if folder else f", and {DATA_VARIABLE} is not set"
    raise InputError(f"no {what} {file!r}: not in {' or '.join(map(str, tried))}{where}")
