"""The results of a run: one folder or other store per study. A cell is stored whole or not at all, under its key.

study.yaml          the resolved study
cells.parquet       one row per cell, in the order of the study
columns.json        unit, title and role of each column of that table, from the version of the run
described.json      descriptions of its methods, materials, lights, views and metrics, from the version of the run
kernels.json        how each kernel ran, eagerly or compiled, which a resumed run keeps
claims.json         the verdicts
provenance.json     versions, hardware, times
glossbench.json     the list of files that this program wrote, and the keys of the study's cells; exists from the start
reports.json        what each report was made of: a run leaves a report that a new one would equal
cells/KEY.json      the row of one cell, with checksums of itself and of its files; the cell is done if it exists
begun/KEY.begun     a mark while a cell is computed: how often the process ended during this cell
begun/run.json      the run that writes to this folder now
images/KEY.exr      the image of a cell. KEY_half_vectors.npy is its pattern and KEY_state_NAME.exr are pictures of its
                    state, if the method has them; KEY_flip_N.npz is a FLIP map of a page, averaged over N x N pixels
references/KEY.exr  a reference. KEY_standard_error.exr is its standard error, KEY_deviates.npz holds the deviations of
                    its groups of replicates, KEY_mask.png its pixels, KEY.json its numbers
"""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any

import pandas

from glossbench.errors import InputError
from glossbench.findings.columns import Column, collect_columns, columns_from_json, columns_to_json, read_metric_options
from glossbench.findings.descriptions import Descriptions, describe_study
from glossbench.findings.verdicts import judge
from glossbench.metrics import METRICS, Metric
from glossbench.run.cell_files import CellFiles
from glossbench.run.manifest import COMPARED, KEPT, SUMMARY, Manifest, join_first, make_entry
from glossbench.run.records import encode_table
from glossbench.strict_json import dumps, loads
from glossbench.study.claims import read_claims
from glossbench.study.document import dump, read_document
from glossbench.study.labels import with_names

AGAIN = "; the same `glossbench run` makes it again"


class Results(CellFiles):
    """The results of one study in a store, to be read or extended.

    Args:
        where: a folder, or an address of fsspec, to which `glossbench run` wrote or will write.

    Raises:
        InputError: the store cannot be made or written (begin), or does not hold results (read).
    """

    @classmethod
    def open(cls, where: Path | str) -> "Results":
        """Existing results, of a finished or unfinished run."""
        results = cls(where)
        for name in ["study.yaml"] if results.disk.manifest.cells else ["cells.parquet", *SUMMARY]:
            if not results.store.has(name):
                raise InputError(f"{results.store.address} holds no results: {name} is missing")
        return results

    def create(self) -> None:
        """Make the store, and remove files that a killed run left half-written.

        Raises:
            InputError: the store cannot be written, or holds foreign files that would be lost.
        """
        self.disk.manifest.check_foreign(self.store, (*SUMMARY, *KEPT))
        self.store.create()

    # A run, from its beginning to its end.

    def begin(self, study: Mapping[str, Any], rows: Sequence[Mapping[str, Any]], provenance: Mapping[str, Any]) -> str:
        """Record a study and its future cells in the folder.

        A study that compares everything that the folder's earlier study compares replaces it. A study that is a part
        of the earlier one adds its results to it, and the earlier study stays: the returned line says what it keeps.

        Raises:
            InputError: the folder holds results of another study, or foreign files; nothing is written.
        """
        old, cells, before = self.disk.manifest, tuple(map(make_entry, rows)), self._read_study()
        missing = old.find_missing(before, study, cells)
        is_part = bool(missing) and before is not None and all(cell in old.cells for cell in cells)
        if missing and not is_part:
            lost = join_first(missing)
            raise InputError(
                f"{self.store.address} holds results that this run does not have, and that would be lost: {lost}; "
                "choose another folder with -o"
            )
        if is_part:
            return f"{self.store.address} keeps its other results of this study: {join_first(missing)}"
        if cells != old.cells or study != before:
            Manifest(cells, {**old.files, **dict.fromkeys((*SUMMARY, *KEPT))}).write(self.store)
            self.disk.write("study.yaml", dump(dict(study)))
            self.disk.write("provenance.json", dumps({**provenance, "finished": "not yet"}, indent=1))
        self.disk.own(*KEPT)
        self.disk.write("columns.json", dumps(columns_to_json(collect_columns(study["metrics"]))))
        self.disk.write("described.json", dumps(describe_study(study).as_dict()))
        return ""

    def finish(
        self,
        study: dict[str, Any],
        verdicts: list[dict[str, Any]],
        rows: list[dict[str, Any]],
        provenance: dict[str, Any],
    ) -> None:
        """Write the study, its verdicts, its provenance and, last, the table of cells, which marks the run as finished.

        If the folder keeps an earlier study with more cells, these rows are added to those of the earlier study. A run
        that computed nothing leaves the provenance of the run that did.
        """
        old = self.disk.manifest
        by_entry = {dumps(make_entry(row)): row for row in rows}
        if any(dumps(cell) not in by_entry for cell in old.cells):
            found = [by_entry.get(dumps(cell)) or self._read_row(cell) for cell in old.cells]
            study, rows = self.study, [row for row in found if row is not None]
            if len(rows) < len(found):
                return
            verdicts = self._judge(pandas.DataFrame(rows))
        for name in self.store.list("references/"):
            if name.endswith(".partial.npz"):
                self.store.remove(name)  # left by a study that has changed since
        table = encode_table(with_names(rows))
        if old.is_finished and sha256(table).hexdigest() == old.files.get("cells.parquet"):
            provenance = self.provenance or provenance
        self.disk.write("study.yaml", dump(study))
        self.disk.write("claims.json", dumps(verdicts, indent=1))
        self.disk.write("provenance.json", dumps(provenance, indent=1))
        self.store.put("cells.parquet", table)
        files = {name: self.disk.compute_checksum(name) for name in (*SUMMARY, *KEPT)}
        Manifest(tuple(map(make_entry, rows)), {**old.files, **files}, True).write(self.store)

    # The whole study.

    @property
    def study(self) -> dict[str, Any]:
        """The resolved study."""
        with self.store.file("study.yaml") as path:
            return read_document(path).data

    @property
    def cells(self) -> pandas.DataFrame:
        """One row per existing cell; a cell with damaged files counts as failed, and its reason names the file."""
        manifest = self.disk.manifest
        cells = self.disk.read_table("cells.parquet") if manifest.is_finished else None
        if cells is None and not manifest.cells:
            raise InputError(f"{self.store.address}/cells.parquet is damaged{AGAIN}")
        if cells is None:
            rows = [row for row in map(self._read_row, manifest.cells) if row is not None]
            cells = pandas.DataFrame(with_names(rows))
        if cells.empty:
            raise InputError(f"{self.store.address}: none of {len(manifest.cells)} cells is done yet")
        if not {"key", "reference_key", "status", "reason"} <= set(cells.columns):
            raise InputError(f"{self.store.address}/cells.parquet is not a table of cells{AGAIN}")
        damage: dict[str, str] = {}
        for i, row in enumerate(cells.to_dict("records")):
            if row["status"] == "done":
                reference = row["reference_key"]
                if reference not in damage:
                    damage[reference] = self.find_reference_damage(reference)
                if found := self.find_cell_damage(row["key"]) or damage[reference]:
                    cells.loc[i, ["status", "reason"]] = ["failed", found + AGAIN]
        return cells

    @property
    def columns(self) -> dict[str, Column]:
        """The columns of the cells by name, as the run stored them; for older results, those of this version."""
        if not self.disk.is_altered("columns.json"):
            with suppress(OSError, ValueError, InputError):
                return columns_from_json(loads(self.store.get("columns.json")))
        return collect_columns(self.study["metrics"])

    @property
    def metrics(self) -> list[str]:
        """The columns of the study's metrics, in their order."""
        return list(read_metric_options(self.study["metrics"]))

    def metric(self, column: str) -> Metric | None:
        """The metric of a column, with the options that the study states; None if it is not installed here."""
        name, options = read_metric_options(self.study["metrics"]).get(column, (column, {}))
        return METRICS.create(name, options) if name in METRICS.names() else None

    @property
    def descriptions(self) -> Descriptions:
        """The descriptions of everything that the study names, as the run stored them; else those installed here."""
        if not self.disk.is_altered("described.json"):
            with suppress(OSError, ValueError, InputError):
                return Descriptions.from_dict(loads(self.store.get("described.json")))
        return describe_study(self.study, is_of_run=False)

    @property
    def claims(self) -> list[dict[str, Any]]:
        """The verdicts; for an unfinished run, verdicts on the existing cells, and each summary says so."""
        if self.disk.manifest.is_finished and not self.disk.is_altered("claims.json"):
            with suppress(OSError, json.JSONDecodeError):
                loaded: list[dict[str, Any]] = loads(self.store.get("claims.json"))
                return loaded
        return self._judge(self.cells)

    @property
    def provenance(self) -> dict[str, Any]:
        """Versions, hardware, times; empty if the file is damaged."""
        loaded: dict[str, Any] = {}
        with suppress(OSError, json.JSONDecodeError, UnicodeDecodeError):
            loaded = json.loads(self.store.get("provenance.json"))
        return loaded

    def remarks(self, cells: pandas.DataFrame) -> list[str]:
        """What differs in the folder from a finished run, as lines: missing cells and damaged files.

        Args:
            cells: the cells of these results.
        """
        of = self.disk.manifest.cells
        found = [f"{len(cells)} of {len(of)} cells are done: the claims are judged on these"]
        damaged = [reason.removesuffix(AGAIN) for reason in map(str, cells["reason"]) if reason.endswith(AGAIN)]
        more = f", and {len(damaged) - 1} more cells have damaged files" if len(damaged) > 1 else ""
        altered = [self.disk.explain_fault(name) for name in (*SUMMARY, *KEPT) if self.disk.is_altered(name)]
        lines = [f"{first}{more}{AGAIN}" for first in damaged[:1]] + [f"{line}{AGAIN}" for line in altered]
        return (found if len(cells) < len(of) else []) + lines

    def _read_study(self) -> dict[str, Any] | None:
        """The study on disk; None if it cannot be read or is not complete."""
        with suppress(InputError):
            study = self.study
            return study if set(COMPARED) <= set(study) else None
        return None

    def _read_row(self, cell: Mapping[str, Any]) -> dict[str, Any] | None:
        """The row of a cell of the manifest; None if it is missing or damaged."""
        with suppress(OSError, ValueError):
            return self.cell(cell["key"]) | dict(cell)
        return None

    def _judge(self, cells: pandas.DataFrame) -> list[dict[str, Any]]:
        """The verdicts on some cells, for the claims of the study on disk."""
        verdicts = judge(read_claims(self.study), cells) if len(cells) else []
        n, of = len(cells), len(self.disk.manifest.cells)
        said = f"over {n} of {of} cells: " if n < of else ""
        return [verdict | {"summary": said + verdict["summary"]} for verdict in verdicts]
