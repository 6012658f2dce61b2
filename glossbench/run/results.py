"""What a run leaves on disk: one folder a study; each cell whole or not at all, under a key of what made it.

study.yaml          the resolved study
cells.parquet       one row a cell, in the order of the study
columns.json        of each column of that table the unit, title and role, as the run knew them
described.json      what the run knew of its methods, materials, lights, views and metrics
claims.json         the verdicts
provenance.json     versions, hardware, times
glossbench.json     which files here are this program's, and the keys of the study's cells: there from the start
cells/KEY.json      the row of one cell, with checksums of itself and of its files; it says that the cell is done
begun/KEY.begun     a mark while a cell is under way: how often the process ended in it
images/KEY.exr      its image; KEY_half_vectors.npy the pattern and KEY_state_NAME.exr pictures of its state, where a
                    method has them; KEY_flip_N.npz a FLIP map, once a page was made, of N x N pixels averaged
references/KEY.exr  a reference; KEY_standard_error.exr its error bar, KEY_deviates.npz what its groups of replicates
                    deviate by, KEY_mask.png its pixels, KEY.json its numbers
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pandas
from numpy.typing import NDArray
from PIL import Image as Picture
from torch import Tensor

from glossbench.atomic import replacing
from glossbench.envmap.formats.files import read_pixels, write_exr
from glossbench.errors import InputError
from glossbench.findings.columns import Column, columns_from_json, columns_of, columns_to_json, metric_columns
from glossbench.findings.descriptions import Descriptions, describe_study
from glossbench.findings.verdicts import judge
from glossbench.run.folder import Folder
from glossbench.run.manifest import COMPARED, KEPT, SUMMARY, Manifest, entry, listed
from glossbench.shading.image import Image
from glossbench.strict_json import dumps, loads, numbers
from glossbench.study.claims import stated_claims
from glossbench.study.document import dump, read_document
from glossbench.study.labels import with_names
from glossbench.truth.reference import Reference

AGAIN = "; the same `glossbench run` makes it again"


def key_of(parts: Any) -> str:
    """A key for the disk: the first 80 bits of the SHA-256 of some JSON data."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:20]


class Results:
    """The folder of one study's run, to read and to add to.

    Args:
        folder: as `glossbench run` made it.

    Raises:
        InputError: the folder cannot be made or written (begin), or holds no results (read).
    """

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        self.disk = Folder(self.folder)

    @classmethod
    def open(cls, folder: Path | str) -> "Results":
        """Results that are there, of a run that is finished or not."""
        results = cls(folder)
        for name in ["study.yaml"] if results.disk.manifest.cells else ["cells.parquet", *SUMMARY]:
            if not results.disk.path(name).is_file():
                raise InputError(f"{results.folder} holds no results: there is no {name} in it")
        return results

    def create(self) -> None:
        """Make the folders, or say why they cannot be made; remove what a killed run left half-written.

        Raises:
            InputError: the folder cannot be written, or holds files of somebody else that would be lost.
        """
        self.disk.manifest.check_foreign(self.folder, (*SUMMARY, *KEPT))
        self.disk.create()

    # A run, from its beginning to its end.

    def begin(self, study: Mapping[str, Any], rows: Sequence[Mapping[str, Any]], provenance: Mapping[str, Any]) -> str:
        """Note in the folder a study and the cells that it will have; says what of a fuller one stays.

        A study that has all that an earlier one of this folder compares takes its place. One that is a part of the
        earlier one adds to that, which stays.

        Raises:
            InputError: the folder holds results of another study, or files of somebody else; nothing is written.
        """
        old, cells, before = self.disk.manifest, tuple(map(entry, rows)), self._study_before()
        missing = old.missing(before, study, cells)
        is_part = bool(missing) and before is not None and all(cell in old.cells for cell in cells)
        if missing and not is_part:
            raise InputError(
                f"{self.folder} holds results that this run does not have, and that would be lost: {listed(missing)}; "
                "name another folder by -o"
            )
        if is_part:
            return f"{self.folder} keeps what else it has of this study: {listed(missing)}"
        if cells != old.cells or study != before:
            Manifest(cells, {**old.files, **dict.fromkeys((*SUMMARY, *KEPT))}).write(self.folder)
            self.disk.write("study.yaml", dump(dict(study)))
            self.disk.write("provenance.json", dumps({**provenance, "finished": "not yet"}, indent=1))
        self.disk.own(*KEPT)
        self.disk.write("columns.json", dumps(columns_to_json(columns_of(study["metrics"]))))
        self.disk.write("described.json", dumps(describe_study(study).as_dict()))
        return ""

    def finish(
        self,
        study: dict[str, Any],
        verdicts: list[dict[str, Any]],
        rows: list[dict[str, Any]],
        provenance: dict[str, Any],
    ) -> None:
        """Write the study, its verdicts, its provenance, and last the table of cells: that says that all is there.

        Where the folder has a fuller study, that is the one which stays, with these rows among its own.
        """
        old = self.disk.manifest
        by_entry = {dumps(entry(row)): row for row in rows}
        if any(dumps(cell) not in by_entry for cell in old.cells):
            found = [by_entry.get(dumps(cell)) or self._row(cell) for cell in old.cells]
            study, rows = self.study, [row for row in found if row is not None]
            if len(rows) < len(found):
                return
            verdicts = self._judged(pandas.DataFrame(rows))
        for partial in self.disk.path("references").glob(f"{'[0-9a-f]' * 20}.partial.npz"):
            partial.unlink(missing_ok=True)  # of a study that has changed since
        self.disk.write("study.yaml", dump(study))
        self.disk.write("claims.json", dumps(verdicts, indent=1))
        self.disk.write("provenance.json", dumps(provenance, indent=1))
        self.disk.write_table("cells.parquet", with_names(rows))
        files = {name: self.disk.checksum(name) for name in (*SUMMARY, *KEPT)}
        Manifest(tuple(map(entry, rows)), {**old.files, **files}, True).write(self.folder)

    # Cells.

    def has_cell(self, key: str) -> bool:
        """Whether this cell is done, skipped or failed."""
        return self.disk.path(f"cells/{key}.json").is_file()

    def remove_cell(self, key: str) -> None:
        """Forget that a cell is done."""
        self.disk.path(f"cells/{key}.json").unlink(missing_ok=True)

    def cell(self, key: str) -> dict[str, Any]:
        """The row of one cell; ValueError where its file is damaged."""
        return numbers(self.disk.read(f"cells/{key}.json"))

    def damage_of_cell(self, key: str) -> str:
        """What is wrong with the files of a cell that is there; nothing where all are as they were written."""
        return self.disk.damage(f"cells/{key}.json")

    def add_cell(self, row: dict[str, Any], image: Image | None, half_vectors: NDArray[np.float32] | None) -> None:
        """Write a cell; its row comes last, because the row says that it is done."""
        key, written = row["key"], []
        for path in self.disk.path("images").glob(f"{key}_flip_*.npz"):
            path.unlink(missing_ok=True)  # of an image that now goes
        if image is not None:
            written = [self._write_image(f"images/{key}.exr", image.radiance)]
            for name, picture in image.pictures.items():
                written.append(self._write_image(f"images/{key}_state_{name}.exr", picture.cpu()))
        if half_vectors is not None:
            written.append(f"images/{key}_half_vectors.npy")
            with replacing(self.disk.path(written[-1])) as part, part.open("wb") as file:
                np.save(file, half_vectors)
        self.disk.write_with(f"cells/{key}.json", row, written)

    # References.

    def has_reference(self, key: str) -> bool:
        """Whether this reference is done."""
        return self.disk.path(f"references/{key}.json").is_file()

    def damage_of_reference(self, key: str) -> str:
        """What is wrong with the files of a reference that is there; nothing where all are as they were written."""
        return self.disk.damage(f"references/{key}.json")

    def add_reference(self, key: str, truth: Reference, seconds: float) -> None:
        """Write a reference, its numbers last."""
        written = [
            self._write_image(f"references/{key}.exr", truth.radiance),
            self._write_image(f"references/{key}_standard_error.exr", truth.standard_error),
            f"references/{key}_deviates.npz",
            f"references/{key}_mask.png",
        ]
        with replacing(self.disk.path(written[2])) as part, part.open("wb") as file:
            np.savez_compressed(file, deviates=truth.deviates.numpy())
        with replacing(self.disk.path(written[-1])) as part:
            Picture.fromarray(truth.mask.numpy().astype(np.uint8) * 255).save(part, format="PNG")
        self.disk.write_with(f"references/{key}.json", {"n_samples": truth.n_samples, "seconds": seconds}, written)

    def reference_numbers(self, key: str) -> dict[str, Any]:
        """n_samples and seconds of a reference."""
        return self.disk.read(f"references/{key}.json")

    # The whole study.

    @property
    def study(self) -> dict[str, Any]:
        """The resolved study."""
        return read_document(self.disk.path("study.yaml")).data

    @property
    def cells(self) -> pandas.DataFrame:
        """One row a cell that is there; a cell whose files are damaged has failed, and its reason says which."""
        manifest = self.disk.manifest
        cells = self.disk.table("cells.parquet") if manifest.is_finished else None
        if cells is None and not manifest.cells:
            raise InputError(f"{self.folder}/cells.parquet is damaged{AGAIN}")
        if cells is None:
            rows = [row for row in map(self._row, manifest.cells) if row is not None]
            cells = pandas.DataFrame(with_names(rows))
        if cells.empty:
            raise InputError(f"{self.folder}: none of {len(manifest.cells)} cells is done yet")
        if not {"key", "reference_key", "status", "reason"} <= set(cells.columns):
            raise InputError(f"{self.folder}/cells.parquet is no table of cells{AGAIN}")
        damage: dict[str, str] = {}
        for i, row in enumerate(cells.to_dict("records")):
            if row["status"] == "done":
                reference = row["reference_key"]
                if reference not in damage:
                    damage[reference] = self.damage_of_reference(reference)
                if found := self.damage_of_cell(row["key"]) or damage[reference]:
                    cells.loc[i, ["status", "reason"]] = ["failed", found + AGAIN]
        return cells

    @property
    def columns(self) -> dict[str, Column]:
        """The columns of the cells by name, as the run knew them; of older results, as this version knows them."""
        if not self.disk.is_altered("columns.json"):
            with suppress(OSError, ValueError, InputError):
                return columns_from_json(loads(self.disk.path("columns.json").read_bytes()))
        return columns_of(self.study["metrics"])

    @property
    def metrics(self) -> list[str]:
        """The columns of the study's metrics, in their order."""
        return [column.name for column in metric_columns(self.study["metrics"])]

    @property
    def descriptions(self) -> Descriptions:
        """What the run knew of all that its study names; of older results, what is installed here."""
        if not self.disk.is_altered("described.json"):
            with suppress(OSError, ValueError, InputError):
                return Descriptions.of_dict(loads(self.disk.path("described.json").read_bytes()))
        return describe_study(self.study, is_of_run=False)

    @property
    def claims(self) -> list[dict[str, Any]]:
        """The verdicts; of a run that is not finished those on the cells that are there, and each says so."""
        if self.disk.manifest.is_finished and not self.disk.is_altered("claims.json"):
            with suppress(OSError, json.JSONDecodeError):
                loaded: list[dict[str, Any]] = loads(self.disk.path("claims.json").read_bytes())
                return loaded
        return self._judged(self.cells)

    @property
    def provenance(self) -> dict[str, Any]:
        """Versions, hardware, times; nothing where the file is damaged."""
        loaded: dict[str, Any] = {}
        with suppress(OSError, json.JSONDecodeError, UnicodeDecodeError):
            loaded = json.loads(self.disk.path("provenance.json").read_bytes())
        return loaded

    def remarks(self, cells: pandas.DataFrame) -> list[str]:
        """What of the folder is not as a finished run leaves it, a line each.

        Args:
            cells: of these results.
        """
        of = self.disk.manifest.cells
        found = [f"{len(cells)} of {len(of)} cells are done: the claims are judged on these"]
        damaged = [reason.removesuffix(AGAIN) for reason in map(str, cells["reason"]) if reason.endswith(AGAIN)]
        more = f", and {len(damaged) - 1} more cells have damaged files" if len(damaged) > 1 else ""
        altered = [self.disk.fault(name) for name in (*SUMMARY, *KEPT) if self.disk.is_altered(name)]
        lines = [f"{first}{more}{AGAIN}" for first in damaged[:1]] + [f"{line}{AGAIN}" for line in altered]
        return (found if len(cells) < len(of) else []) + lines

    def image(self, key: str) -> NDArray[np.float32]:
        """Radiance (H, W, 3) of a cell."""
        return self._pixels(f"images/{key}.exr")

    def reference(self, key: str) -> NDArray[np.float32]:
        """Radiance (H, W, 3) of a reference."""
        return self._pixels(f"references/{key}.exr")

    def standard_error(self, key: str) -> NDArray[np.float32]:
        """Standard error (H, W, 3) of a reference."""
        return self._pixels(f"references/{key}_standard_error.exr")

    def deviates(self, key: str) -> NDArray[np.float16]:
        """What each group of replicates of a reference deviates by (G, H, W, 3), in standard errors."""
        with self.disk.path(f"references/{key}_deviates.npz").open("rb") as file, np.load(file) as stored:
            return np.asarray(stored["deviates"])

    def mask(self, key: str) -> NDArray[np.bool_]:
        """Pixels (H, W) of a reference that show the surface."""
        with Picture.open(self.disk.path(f"references/{key}_mask.png")) as picture:
            return np.asarray(picture) > 0

    def half_vectors(self, key: str) -> NDArray[np.float32] | None:
        """The pattern (N, 2), theta and phi, of a cell; None where the method has none."""
        path = self.disk.path(f"images/{key}_half_vectors.npy")
        return np.load(path, allow_pickle=False) if path.is_file() else None

    def pictures(self, key: str) -> dict[str, NDArray[np.float32]]:
        """Pictures (H, W, 3) of the state of a cell's method, by name."""
        stem = f"{key}_state_"
        names = sorted(path.name for path in self.disk.path("images").glob(f"{stem}*.exr"))
        return {name.removeprefix(stem).removesuffix(".exr"): self._pixels(f"images/{name}") for name in names}

    def _pixels(self, name: str) -> NDArray[np.float32]:
        return np.asarray(read_pixels(self.disk.path(name)))

    def _write_image(self, name: str, image: Tensor) -> str:
        write_exr(self.disk.path(name), image)
        return name

    def _study_before(self) -> dict[str, Any] | None:
        """The study on disk; None where there is none that can be read."""
        with suppress(InputError):
            study = self.study
            return study if set(COMPARED) <= set(study) else None
        return None

    def _row(self, cell: Mapping[str, Any]) -> dict[str, Any] | None:
        """The row of a cell of the manifest; None where it is not there, or damaged."""
        with suppress(OSError, ValueError):
            return self.cell(cell["key"]) | dict(cell)
        return None

    def _judged(self, cells: pandas.DataFrame) -> list[dict[str, Any]]:
        """The verdicts of the study on disk on some of its cells."""
        verdicts = judge(stated_claims(self.study), cells) if len(cells) else []
        n, of = len(cells), len(self.disk.manifest.cells)
        said = f"over {n} of {of} cells: " if n < of else ""
        return [verdict | {"summary": said + verdict["summary"]} for verdict in verdicts]
