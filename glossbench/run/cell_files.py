"""The files of cells and references in a store: each whole or not at all, under a key of what made it."""

import hashlib
import json
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture

from glossbench.envmap.formats.exr import encode_exr
from glossbench.envmap.formats.files import read_pixels
from glossbench.errors import InputError
from glossbench.run.folder import Folder
from glossbench.run.records import Records
from glossbench.run.store import Store, open_store
from glossbench.shading.image import Image
from glossbench.strict_json import restore_numbers
from glossbench.truth.reference import Reference


def make_key(parts: Any) -> str:
    """A key for files: the first 80 bits of the SHA-256 of JSON data."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:20]


class CellFiles:
    """The cells and references of a run.

    Args:
        where: a folder, or an address of fsspec, to which `glossbench run` wrote or will write.
    """

    def __init__(self, where: Path | str | Store) -> None:
        self.store = open_store(where)
        self.disk = Records(self.store)

    @property
    def where(self) -> Path | str:
        """The folder or address, as it is handed to reports."""
        return self.store.root if isinstance(self.store, Folder) else self.store.address

    @property
    def folder(self) -> Path:
        """The folder; InputError if the results lie elsewhere."""
        if not isinstance(self.store, Folder):
            raise InputError(f"{self.store.address} is not a folder of this machine")
        return self.store.root

    # Cells.

    def has_cell(self, key: str) -> bool:
        """Whether this cell is done, skipped or failed."""
        return self.store.has(f"cells/{key}.json")

    def remove_cell(self, key: str) -> None:
        """Remove the row of a cell, so that it counts as new."""
        self.store.remove(f"cells/{key}.json")

    def cell(self, key: str) -> dict[str, Any]:
        """The row of one cell; ValueError if its file is damaged."""
        return restore_numbers(self.disk.read(f"cells/{key}.json"))

    def find_cell_damage(self, key: str) -> str:
        """The damage to the files of an existing cell, in words; "" if all are as they were written."""
        return self.disk.find_damage(f"cells/{key}.json")

    def add_cell(self, row: dict[str, Any], image: Image | None, half_vectors: NDArray[np.float32] | None) -> int:
        """Write a cell; the bytes written. Its row comes last, because the row marks the cell as done.

        The disk is not waited for, which would take longer than a small cell: after a power failure the checksum finds
        a file that is not whole, and this cell is made again.
        """
        key, files = row["key"], {}
        if self.store.has(f"images/{key}.exr"):  # to list the images for each cell would take long
            for name in self.store.list(f"images/{key}_flip_"):
                self.store.remove(name)  # a map of the image that is replaced now
        if image is not None:
            files[f"images/{key}.exr"] = encode_exr(image.radiance)
            for name, picture in image.pictures.items():
                files[f"images/{key}_state_{name}.exr"] = encode_exr(picture)
        if half_vectors is not None:
            files[f"images/{key}_half_vectors.npy"] = _encode(np.save, half_vectors)
        return self.disk.write_with(f"cells/{key}.json", row, files, lasts=False)

    # References.

    def has_reference(self, key: str) -> bool:
        """Whether this reference is done."""
        return self.store.has(f"references/{key}.json")

    def find_reference_damage(self, key: str) -> str:
        """The damage to the files of an existing reference, in words; "" if all are as they were written."""
        return self.disk.find_damage(f"references/{key}.json")

    def add_reference(self, key: str, truth: Reference, seconds: float) -> int:
        """Write a reference; the bytes written. Its numbers come last, because they mark it as done."""
        mask = Picture.fromarray(truth.mask.numpy().astype(np.uint8) * 255)
        files = {
            f"references/{key}.exr": encode_exr(truth.radiance),
            f"references/{key}_standard_error.exr": encode_exr(truth.standard_error),
            f"references/{key}_deviates.npz": _encode(np.savez_compressed, deviates=truth.deviates.numpy()),
            f"references/{key}_mask.png": _encode(mask.save, format="PNG"),
        }
        numbers = {"n_samples": truth.n_samples, "seconds": seconds, "method": truth.method}
        return self.disk.write_with(f"references/{key}.json", numbers, files)

    def reference_numbers(self, key: str) -> dict[str, Any]:
        """n_samples, seconds and method of a reference."""
        return self.disk.read(f"references/{key}.json")

    def image(self, key: str) -> NDArray[np.float32]:
        """Radiance (H, W, 3) of a cell's image."""
        return self._read_pixels(f"images/{key}.exr")

    def reference(self, key: str) -> NDArray[np.float32]:
        """Radiance (H, W, 3) of a reference."""
        return self._read_pixels(f"references/{key}.exr")

    def standard_error(self, key: str) -> NDArray[np.float32]:
        """Standard error (H, W, 3) of a reference."""
        return self._read_pixels(f"references/{key}_standard_error.exr")

    def deviates(self, key: str) -> NDArray[np.float16]:
        """Deviations (G, H, W, 3) of the groups of replicates of a reference [standard errors]."""
        with np.load(BytesIO(self.store.get(f"references/{key}_deviates.npz"))) as stored:
            return np.asarray(stored["deviates"])

    def mask(self, key: str) -> NDArray[np.bool_]:
        """Pixels (H, W) of a reference that show the surface."""
        with Picture.open(BytesIO(self.store.get(f"references/{key}_mask.png"))) as picture:
            return np.asarray(picture) > 0

    def half_vectors(self, key: str) -> NDArray[np.float32] | None:
        """The pattern (N, 2), theta and phi, of a cell; None if the method has none."""
        name = f"images/{key}_half_vectors.npy"
        return np.load(BytesIO(self.store.get(name)), allow_pickle=False) if self.store.has(name) else None

    def pictures(self, key: str) -> dict[str, NDArray[np.float32]]:
        """Pictures (H, W, 3) of the state of a cell's method, by name."""
        stem = f"images/{key}_state_"
        return {name.removeprefix(stem).removesuffix(".exr"): self._read_pixels(name) for name in self.store.list(stem)}

    def _read_pixels(self, name: str) -> NDArray[np.float32]:
        with self.store.file(name) as path:
            return np.asarray(read_pixels(path))


def _encode(write: Callable[..., Any], *arguments: Any, **options: Any) -> bytes:
    """What a function writes into a file that it is given as its first argument."""
    file = BytesIO()
    write(file, *arguments, **options)
    return file.getvalue()
