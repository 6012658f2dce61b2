"""What a run leaves on disk: one folder a study; each cell whole or not at all, under a key of what made it.

study.yaml          the resolved study
cells.parquet       one row a cell, in the order of the study
claims.json         the verdicts
provenance.json     versions, hardware, times
cells/KEY.json      the row of one cell; its presence means that the cell is done
begun/KEY.begun     a mark while a cell is under way: how often the process ended in it
images/KEY.exr      its image; KEY_half_vectors.npy the pattern and KEY_state_NAME.exr pictures of its state, where a
                    method has them; KEY_flip_N.npz a FLIP map, once a page was made, of N x N pixels averaged
references/KEY.exr  a reference; KEY_standard_error.exr its error bar, KEY_mask.png its pixels,
references/KEY.json its numbers
"""

import hashlib
import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas
from numpy.typing import NDArray
from PIL import Image as Picture
from torch import Tensor

from glossbench.atomic import replacing
from glossbench.envmap.files import read_pixels, write_exr
from glossbench.errors import InputError
from glossbench.ground_truth import Reference
from glossbench.shading import Image
from glossbench.yaml_marks import dump, read_document


def key_of(parts: Any) -> str:
    """A key for the disk: the first 80 bits of the SHA-256 of some JSON data."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:20]


def _is_abandoned(part: Path) -> bool:
    """Whether it is half-written, and its writer is no more."""
    writer = re.match(r"\.+(\d+)\.", part.name)
    if writer is None or os.name != "posix" or not part.is_file():
        return False
    try:
        os.kill(int(writer[1]), 0)
    except ProcessLookupError:
        return True
    except (PermissionError, OverflowError):
        return False
    return int(writer[1]) == os.getpid()


def _write_image(path: Path, image: Tensor) -> None:
    with replacing(path) as part:
        write_exr(part, image)


class Results:
    """The folder of one study's run, to read and to add to.

    Args:
        folder: as `glossbench run` made it.

    Raises:
        InputError: the folder cannot be made or written (create), or holds no results (read).
    """

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)

    @classmethod
    def open(cls, folder: Path | str) -> "Results":
        """Results that are there."""
        results = cls(folder)
        for name in ("cells.parquet", "study.yaml", "claims.json", "provenance.json"):
            if not (results.folder / name).is_file():
                raise InputError(f"{results.folder} holds no results: there is no {name} in it")
        return results

    def create(self) -> None:
        """Make the folders, or say why they cannot be made; remove what a killed run left half-written."""
        try:
            for name in ("cells", "images", "references"):
                (self.folder / name).mkdir(parents=True, exist_ok=True)
            with replacing(self.folder / "cells" / ".probe") as part:
                part.write_text("")
            (self.folder / "cells" / ".probe").unlink(missing_ok=True)  # another run may be at the same
            for part in self.folder.rglob(".*"):
                if _is_abandoned(part):
                    part.unlink(missing_ok=True)
        except OSError as error:
            raise InputError(f"cannot write results to {self.folder}: {error.strerror}") from None

    # Cells.

    def has_cell(self, key: str) -> bool:
        """Whether this cell is done, skipped or failed."""
        return (self.folder / "cells" / f"{key}.json").is_file()

    def remove_cell(self, key: str) -> None:
        """Forget that a cell is done."""
        (self.folder / "cells" / f"{key}.json").unlink(missing_ok=True)

    def cell(self, key: str) -> dict[str, Any]:
        """The row of one cell."""
        row: dict[str, Any] = json.loads((self.folder / "cells" / f"{key}.json").read_text())
        return row

    def add_cell(self, row: dict[str, Any], image: Image | None, half_vectors: NDArray[np.float32] | None) -> None:
        """Write a cell; its row comes last, because the row says that it is done."""
        key = row["key"]
        for path in (self.folder / "images").glob(f"{key}_flip_*.npz"):
            path.unlink()  # of an image that now goes
        if image is not None:
            _write_image(self.folder / "images" / f"{key}.exr", image.radiance)
            for name, picture in image.pictures.items():
                _write_image(self.folder / "images" / f"{key}_state_{name}.exr", picture.cpu())
        if half_vectors is not None:
            with (
                replacing(self.folder / "images" / f"{key}_half_vectors.npy") as part,
                part.open("wb") as file,
            ):
                np.save(file, half_vectors)
        self._write_json(f"cells/{key}.json", row)

    # References.

    def has_reference(self, key: str) -> bool:
        """Whether this reference is done."""
        return (self.folder / "references" / f"{key}.json").is_file()

    def add_reference(self, key: str, truth: Reference, seconds: float) -> None:
        """Write a reference, its numbers last."""
        stem = self.folder / "references" / key
        _write_image(stem.with_suffix(".exr"), truth.radiance)
        _write_image(stem.with_name(f"{key}_standard_error.exr"), truth.standard_error)
        with replacing(stem.with_name(f"{key}_mask.png")) as part:
            Picture.fromarray(truth.mask.numpy().astype(np.uint8) * 255).save(part, format="PNG")
        numbers = {"n_samples": truth.n_samples, "seconds": seconds}
        self._write_json(f"references/{key}.json", numbers)

    def reference_numbers(self, key: str) -> dict[str, Any]:
        """n_samples and seconds of a reference."""
        numbers: dict[str, Any] = json.loads((self.folder / "references" / f"{key}.json").read_text())
        return numbers

    # The whole study.

    def finish(
        self,
        study: dict[str, Any],
        verdicts: list[dict[str, Any]],
        rows: list[dict[str, Any]],
        provenance: dict[str, Any],
    ) -> None:
        """Write the study, its verdicts, its provenance, and last the table of cells: that says that all is there."""
        for partial in (self.folder / "references").glob("*.partial.npz"):  # of a study that has changed since
            partial.unlink(missing_ok=True)
        with replacing(self.folder / "study.yaml") as part:
            part.write_text(dump(study), encoding="utf-8")
        self._write_json("claims.json", verdicts)
        self._write_json("provenance.json", provenance)
        with replacing(self.folder / "cells.parquet") as part:
            pandas.DataFrame(rows).to_parquet(part, index=False)

    @property
    def study(self) -> dict[str, Any]:
        """The resolved study."""
        return read_document(self.folder / "study.yaml").data

    @property
    def cells(self) -> pandas.DataFrame:
        """One row a cell."""
        return pandas.read_parquet(self.folder / "cells.parquet")

    @property
    def claims(self) -> list[dict[str, Any]]:
        """The verdicts."""
        loaded: list[dict[str, Any]] = json.loads((self.folder / "claims.json").read_text())
        return loaded

    @property
    def provenance(self) -> dict[str, Any]:
        """Versions, hardware, times."""
        loaded: dict[str, Any] = json.loads((self.folder / "provenance.json").read_text())
        return loaded

    def image(self, key: str) -> NDArray[np.float32]:
        """Radiance (H, W, 3) of a cell."""
        return np.asarray(read_pixels(self.folder / "images" / f"{key}.exr"))

    def reference(self, key: str) -> NDArray[np.float32]:
        """Radiance (H, W, 3) of a reference."""
        return np.asarray(read_pixels(self.folder / "references" / f"{key}.exr"))

    def standard_error(self, key: str) -> NDArray[np.float32]:
        """Standard error (H, W, 3) of a reference."""
        return np.asarray(read_pixels(self.folder / "references" / f"{key}_standard_error.exr"))

    def mask(self, key: str) -> NDArray[np.bool_]:
        """Pixels (H, W) of a reference that show the surface."""
        with Picture.open(self.folder / "references" / f"{key}_mask.png") as picture:
            return np.asarray(picture) > 0

    def half_vectors(self, key: str) -> NDArray[np.float32] | None:
        """The pattern (N, 2), theta and phi, of a cell; None where the method has none."""
        path = self.folder / "images" / f"{key}_half_vectors.npy"
        return np.load(path) if path.is_file() else None

    def pictures(self, key: str) -> dict[str, NDArray[np.float32]]:
        """Pictures (H, W, 3) of the state of a cell's method, by name."""
        paths = sorted((self.folder / "images").glob(f"{key}_state_*.exr"))
        return {path.stem.removeprefix(f"{key}_state_"): np.asarray(read_pixels(path)) for path in paths}

    def _write_json(self, name: str, data: Any) -> None:
        with replacing(self.folder / name) as part:
            part.write_text(json.dumps(data, indent=1, allow_nan=True))
