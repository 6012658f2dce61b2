"""The folders in which public files lie on this machine."""

import os
from pathlib import Path

from platformdirs import user_cache_path

DATA_VARIABLE = "GLOSSBENCH_DATA"


def cache_folder() -> Path:
    """The folder of fetched files."""
    return user_cache_path("glossbench")


def find_data_folders() -> list[Path]:
    """The existing folders of public files: the one that GLOSSBENCH_DATA names, then the folder of fetched files."""
    named = os.environ.get(DATA_VARIABLE)
    return [folder for folder in ([Path(named)] if named else []) + [cache_folder()] if folder.is_dir()]
