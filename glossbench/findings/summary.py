"""Summaries: what a finished study found, without its images, small enough to be kept in the repository."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas

from glossbench.atomic import replacing
from glossbench.errors import InputError
from glossbench.findings.columns import Column, columns_from_json, columns_to_json
from glossbench.findings.matching import without_folders
from glossbench.strict_json import dumps, loads
from glossbench.study.document import dump, read_document

FILES = ("study.yaml", "claims.json", "provenance.json", "cells.parquet")
KEPT = ("glossbench", "python", "torch", "platform", "processor", "cores", "threads", "device", "started", "finished")


@dataclass(frozen=True)
class Summary:
    """What one run of a study found.

    Attributes:
        name: of the study, as the folder of its results is called.
        study: the resolved study.
        claims: the verdicts.
        provenance: versions, machine, times.
        cells: one row for each cell.
        columns: what the columns of the cells mean; summaries of older versions lack them.
    """

    name: str
    study: dict[str, Any]
    claims: list[dict[str, Any]]
    provenance: dict[str, Any]
    cells: pandas.DataFrame
    columns: Mapping[str, Column] = field(default_factory=dict)

    @classmethod
    def read(cls, folder: Path) -> "Summary":
        """The summary in a folder.

        Raises:
            InputError: one of its files is missing.
        """
        missing = [name for name in FILES if not (folder / name).is_file()]
        if missing:
            raise InputError(f"{folder} holds no summary: {missing[0]} is missing")
        columns = folder / "columns.json"
        return cls(
            folder.name,
            read_document(folder / "study.yaml").data,
            loads((folder / "claims.json").read_bytes()),
            loads((folder / "provenance.json").read_bytes()),
            pandas.read_parquet(folder / "cells.parquet"),
            columns_from_json(loads(columns.read_bytes())) if columns.is_file() else {},
        )

    def write(self, folder: Path) -> None:
        """Write the summary into a folder. Nothing in it names a folder of this machine."""
        folder.mkdir(parents=True, exist_ok=True)
        texts = {
            "study.yaml": dump(without_folders(self.study)),
            "claims.json": dumps(self.claims, indent=1),
            "provenance.json": dumps({key: self.provenance[key] for key in KEPT if key in self.provenance}, indent=1),
        }
        if self.columns:
            texts["columns.json"] = dumps(columns_to_json(self.columns), indent=1)
        for name, text in texts.items():
            with replacing(folder / name) as part:
                part.write_text(text + "\n" if not text.endswith("\n") else text, encoding="utf-8")
        cells = self.cells.map(_shorten)
        with replacing(folder / "cells.parquet") as part:
            cells.to_parquet(part, index=False, compression="zstd")


def _shorten(value: Any) -> Any:
    """A text of a cell, shortened: JSON without the folders of files, only the last line of a traceback."""
    if not isinstance(value, str):
        return value
    if value.startswith(("{", "[")):
        return json.dumps(without_folders(json.loads(value)), sort_keys=True)
    return value.strip().splitlines()[-1] if value.startswith("Traceback") else value
