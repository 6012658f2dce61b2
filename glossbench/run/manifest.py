"""The manifest of results: the files that this program wrote, and the cells of its study."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from glossbench.errors import InputError
from glossbench.run.store import Store
from glossbench.strict_json import seal, unseal

NAME = "glossbench.json"
SUMMARY = ("study.yaml", "provenance.json", "claims.json", "cells.parquet")
KEPT = ("columns.json", "described.json", "kernels.json")  # further files; results of older versions lack them
REPORTS = ("report.html", "report.pdf")
# Columns of a cell's entry. A key includes neither the name of a file nor an unused seed.
ENTRY = ("key", "light_options", "seed")
LISTED, STATED = ("light", "material", "view", "methods"), ("reference", "seed", "device")
COMPARED = (*LISTED, *STATED, "metrics", "exclude")  # keys of a resolved study that decide its cells


@dataclass(frozen=True)
class Manifest:
    """The files of a store that this program wrote, and its cells. The manifest itself may be forged.

    Attributes:
        cells: for each cell of the study, in order, the columns ENTRY of its row; empty for results of older versions.
        files: by name, the SHA-256 of a file of a finished run, or None if its content is not checked.
        is_finished: whether the table of cells and the verdicts have been written.
    """

    cells: tuple[dict[str, Any], ...] = ()
    files: Mapping[str, str | None] = field(default_factory=dict)
    is_finished: bool = False

    @staticmethod
    def read(store: Store) -> "Manifest":
        """The manifest of a store; if it is missing or damaged, one made from the names of the files."""
        try:
            data = unseal(store.get(NAME))
            cells, files = tuple(data["cells"]), dict(data["files"])
            if all(set(ENTRY) <= set(cell) for cell in cells):
                return Manifest(cells, files, data["is_finished"] is True)
            is_missing = False
        except InputError:
            raise
        except FileNotFoundError:
            is_missing = True
        except (OSError, ValueError, KeyError, TypeError):
            is_missing = False
        there = [name for name in (*SUMMARY, *KEPT, *REPORTS) if store.has(name)]
        is_finished = set(SUMMARY) <= set(there)
        if is_missing and not is_finished:
            return Manifest()
        return Manifest((), dict.fromkeys(there), is_finished)

    def check_foreign(self, store: Store, names: Iterable[str]) -> None:
        """InputError if one of these files exists and was not written by glossbench."""
        for name in names:
            if name not in self.files and store.has(name):
                raise InputError(
                    f"{store.locate(name)} was not written by glossbench, and would be lost: move it away, or choose "
                    "another folder with -o"
                )

    def find_missing(
        self, before: Mapping[str, Any] | None, study: Mapping[str, Any], cells: Iterable[Mapping[str, Any]]
    ) -> list[str]:
        """What the folder has, in a few words each, and another resolved study with these cells does not have.

        Args:
            before: the study of the folder; None if it cannot be read.
        """
        known = {cell["key"] for cell in cells}
        gone = [cell for cell in self.cells if cell["key"] not in known]
        if "study.yaml" not in self.files or (self.cells and not gone):
            return []
        if before is None:
            return [f"{len(gone)} cells of a study.yaml that is damaged"] if gone else []
        return _find_lost(before, study)

    def write(self, store: Store) -> None:
        """Write the manifest in place of the previous one."""
        data = {"cells": list(self.cells), "files": dict(self.files), "is_finished": self.is_finished}
        store.put(NAME, seal(data).encode())


def make_entry(row: Mapping[str, Any]) -> dict[str, Any]:
    """The entry of a manifest for the row of a cell."""
    return {column: row[column] for column in ENTRY if column in row}


def join_first(texts: Iterable[str], most: int = 4) -> str:
    """Texts in one line: the first ones, and the number of the others."""
    every = list(texts)
    return ", ".join(every[:most]) + (f" and {len(every) - most} more" if len(every) > most else "")


def _find_lost(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """What an old resolved study compares and a new one does not; empty if the new one has all of it."""
    found = [
        f"{kind.removesuffix('s')} {next(iter(item))}" for kind in LISTED for item in old[kind] if item not in new[kind]
    ]
    gone = [each for each in old["metrics"] if each not in new["metrics"]]
    found += [f"metric {each if isinstance(each, str) else next(iter(each))}" for each in gone]
    found += [f"{key} {_describe_difference(old[key], new[key])}" for key in STATED if old[key] != new[key]]
    found += ["cells that it excludes" for entry in new["exclude"] if entry not in old["exclude"]]
    return list(dict.fromkeys(found))


def _describe_difference(old: Any, new: Any) -> str:
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        return ", ".join(f"{key} {value}" for key, value in old.items() if new.get(key) != value)
    return str(old)
