"""The folders in which public files lie on this machine."""

import os
from pathlib import Path

from platformdirs import user_cache_path

DATA_VARIABLE = "GLOSSBENCH_DATA"


def cache_folder() -> Path:
    """Where fetched files lie."""
    return user_cache_path("glossbench")


def data_folders() -> list[Path]:
    """Folders of public files that are there: the one that GLOSSBENCH_DATA names, then that of fetched files."""
    named = os.environ.get(DATA_VARIABLE)
    return [folder for folder in ([Path(named)] if named else []) + [cache_folder()] if folder.is_dir()]
