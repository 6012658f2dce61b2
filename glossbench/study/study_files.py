"""The installed studies: a name -> its YAML file."""

from importlib import resources
from pathlib import Path


def find_study_files() -> dict[str, Path]:
    """The file of each installed study, by name, sorted."""
    found = [Path(str(entry)) for entry in resources.files("glossbench.studies").iterdir()]
    return {file.stem: file for file in sorted(found) if file.suffix == ".yaml"}
