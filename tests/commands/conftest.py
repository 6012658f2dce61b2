"""Calls of the command line in a folder with one small study."""

import shutil
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from glossbench.catalog import entries as catalog
from glossbench.commands import cli, printing
from glossbench.commands import run as run_command
from glossbench.run.runner import run_study
from glossbench.study.study import load_study
from oracles.command_line import STUDY, Called


@pytest.fixture
def here(tmp_path, monkeypatch):
    """The current folder holds one small study."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("GLOSSBENCH_DATA", raising=False)
    monkeypatch.setattr(catalog, "cache_folder", lambda: tmp_path / "no cache")
    Path("tiny.yaml").write_text(yaml.safe_dump(STUDY))
    return tmp_path


@pytest.fixture
def call(monkeypatch, capsys):
    """Calls the command line in this process; that the machine is busy is not said."""
    monkeypatch.setattr(printing, "BUSY", float("inf"))

    def called(*arguments: Any) -> Called:
        monkeypatch.setattr(sys, "argv", ["glossbench", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as stopped:
            cli.main()
        code = stopped.value.code
        return Called(code if isinstance(code, int) else int(code is not None), *capsys.readouterr())

    return called


@pytest.fixture
def without_reports(monkeypatch):
    """Reports take most of the time of a small run, and no one looks at them here."""
    monkeypatch.setattr(run_command, "_report_writers", lambda: {"html": lambda folder: folder / "report.html"})


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Results of one method of the small study, without reports."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "tiny.yaml").write_text(yaml.safe_dump(STUDY))
    return run_study(load_study(folder / "tiny.yaml").only(["importance_sampling"]), folder / "results").folder


@pytest.fixture
def results(made, here):
    """A folder of results of one's own."""
    return shutil.copytree(made, here / "results" / "tiny")
