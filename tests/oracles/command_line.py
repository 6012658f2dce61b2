"""The command line of tests: a small study, and what a call of it said."""

import sys
from pathlib import Path
from typing import Any, NamedTuple

import yaml

STUDY = {
    "title": "Tiny",
    "light": {"gradient": {"resolution": 16}},
    "material": {"ggx": {"alpha": 0.5}},
    "view": {"sphere": {"resolution": 8}},
    "methods": [{"importance_sampling": {"samples": [4, 8]}}, {"environment_sampling": {"samples": [4, 8]}}],
    "reference": {"relative_error": 0.05},
    "metrics": ["rms", "relative_rms", "mean_error", "max_error"],
    "claims": [{"text": "A [b] /c", "lower": "importance_sampling", "than": "environment_sampling", "metric": "rms"}],
}


class Called(NamedTuple):
    code: int
    out: str
    err: str


def written(**changes: Any) -> str:
    Path("other.yaml").write_text(yaml.safe_dump(STUDY | changes))
    return "other.yaml"


def process(*arguments: str) -> list[str]:
    return [sys.executable, "-c", "from glossbench.commands.cli import main; main()", *arguments]


def words(text: str) -> str:
    return " ".join(text.split())


def files_under(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() if path.is_file() else b"" for path in folder.rglob("*")}
