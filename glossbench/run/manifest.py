"""What a folder of results is known by: which of its files this program wrote, and the cells that its study has."""

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from glossbench.atomic import replacing
from glossbench.errors import InputError
from glossbench.strict_json import sealed, unsealed

NAME = "glossbench.json"
SUMMARY = ("study.yaml", "provenance.json", "claims.json", "cells.parquet")
KEPT = ("columns.json", "described.json")  # what else a run says of its results; older results lack it
REPORTS = ("report.html", "report.pdf")
ENTRY = ("key", "light_options", "seed")  # of a cell: a key does not know what a file was called, nor an unused seed
LISTED, STATED = ("light", "material", "view", "methods"), ("reference", "seed", "device")
COMPARED = (*LISTED, *STATED, "metrics", "exclude")  # keys of a resolved study that decide its cells


@dataclass(frozen=True)
class Manifest:
    """The files of a folder of results that this program wrote, and its cells. A stranger may have written it.

    Attributes:
        cells: of each cell of the study, in order, the columns ENTRY of its row; none is known of older results.
        files: by name the SHA-256 of what a finished run wrote, or None where the content is not of interest.
        is_finished: the table of cells and the verdicts are there.
    """

    cells: tuple[dict[str, Any], ...] = ()
    files: Mapping[str, str | None] = field(default_factory=dict)
    is_finished: bool = False

    @staticmethod
    def read(folder: Path) -> "Manifest":
        """The manifest of a folder; of older results, or where it is damaged, what the names of files say."""
        there = [name for name in (*SUMMARY, *KEPT, *REPORTS) if os.path.lexists(folder / name)]
        is_finished = set(SUMMARY) <= set(there)
        try:
            data = unsealed((folder / NAME).read_bytes())
            cells, files = tuple(data["cells"]), dict(data["files"])
            if all(set(ENTRY) <= set(cell) for cell in cells):
                return Manifest(cells, files, data["is_finished"] is True)
        except FileNotFoundError:
            return Manifest((), dict.fromkeys(there), True) if is_finished else Manifest()
        except (OSError, ValueError, KeyError, TypeError):
            pass
        return Manifest((), dict.fromkeys(there), is_finished)

    def check_foreign(self, folder: Path, names: Iterable[str]) -> None:
        """InputError for a file of somebody else that has one of these names."""
        for name in names:
            if name not in self.files and os.path.lexists(folder / name):
                raise InputError(
                    f"{folder / name} was not written by glossbench, and would be lost: move it away, or name another "
                    "place by -o"
                )

    def missing(
        self, before: Mapping[str, Any] | None, study: Mapping[str, Any], cells: Iterable[Mapping[str, Any]]
    ) -> list[str]:
        """What a folder has, in a few words each, that another resolved study with these cells has not.

        Args:
            before: the study of the folder; None where it cannot be read.
        """
        known = {cell["key"] for cell in cells}
        gone = [cell for cell in self.cells if cell["key"] not in known]
        if "study.yaml" not in self.files or (self.cells and not gone):
            return []
        if before is None:
            return [f"{len(gone)} cells of a study.yaml that is damaged"] if gone else []
        return _lost(before, study)

    def write(self, folder: Path) -> None:
        """Put it in place of the last."""
        data = {"cells": list(self.cells), "files": dict(self.files), "is_finished": self.is_finished}
        with replacing(folder / NAME) as part:
            part.write_text(sealed(data))


def entry(row: Mapping[str, Any]) -> dict[str, Any]:
    """What a manifest has of the row of a cell."""
    return {column: row[column] for column in ENTRY if column in row}


def listed(texts: Iterable[str], most: int = 4) -> str:
    """Some texts in a line: the first ones, and how many more there are."""
    every = list(texts)
    return ", ".join(every[:most]) + (f" and {len(every) - most} more" if len(every) > most else "")


def _lost(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """What an old resolved study compares that a new one does not; nothing where the new one has all of it."""
    found = [
        f"{kind.removesuffix('s')} {next(iter(item))}" for kind in LISTED for item in old[kind] if item not in new[kind]
    ]
    gone = [each for each in old["metrics"] if each not in new["metrics"]]
    found += [f"metric {each if isinstance(each, str) else next(iter(each))}" for each in gone]
    found += [f"{key} {_differing(old[key], new[key])}" for key in STATED if old[key] != new[key]]
    found += ["cells that it excludes" for entry in new["exclude"] if entry not in old["exclude"]]
    return list(dict.fromkeys(found))


def _differing(old: Any, new: Any) -> str:
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        return ", ".join(f"{key} {value}" for key, value in old.items() if new.get(key) != value)
    return str(old)
