"""The files of the cells and references of a study: each whole or not at all, under a key of what made it."""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture
from torch import Tensor

from glossbench.atomic import replacing
from glossbench.envmap.formats.files import read_pixels, write_exr
from glossbench.run.folder import Folder
from glossbench.shading.image import Image
from glossbench.strict_json import restore_numbers
from glossbench.truth.reference import Reference


def make_key(parts: Any) -> str:
    """A key for files: the first 80 bits of the SHA-256 of JSON data."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:20]


class CellFiles:
    """The cells and references in a folder of results.

    Args:
        folder: a folder that `glossbench run` made, or will make.
    """

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        self.disk = Folder(self.folder)

    # Cells.

    def has_cell(self, key: str) -> bool:
        """Whether this cell is done, skipped or failed."""
        return self.disk.path(f"cells/{key}.json").is_file()

    def remove_cell(self, key: str) -> None:
        """Remove the row of a cell, so that it counts as new."""
        self.disk.path(f"cells/{key}.json").unlink(missing_ok=True)

    def cell(self, key: str) -> dict[str, Any]:
        """The row of one cell; ValueError if its file is damaged."""
        return restore_numbers(self.disk.read(f"cells/{key}.json"))

    def find_cell_damage(self, key: str) -> str:
        """The damage to the files of an existing cell, in words; "" if all are as they were written."""
        return self.disk.find_damage(f"cells/{key}.json")

    def add_cell(self, row: dict[str, Any], image: Image | None, half_vectors: NDArray[np.float32] | None) -> None:
        """Write a cell. Its row comes last, because the row marks the cell as done."""
        key, written = row["key"], []
        for path in self.disk.path("images").glob(f"{key}_flip_*.npz"):
            path.unlink(missing_ok=True)  # a map of the image that is replaced now
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

    def find_reference_damage(self, key: str) -> str:
        """The damage to the files of an existing reference, in words; "" if all are as they were written."""
        return self.disk.find_damage(f"references/{key}.json")

    def add_reference(self, key: str, truth: Reference, seconds: float) -> None:
        """Write a reference. Its numbers come last, because they mark it as done."""
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
        numbers = {"n_samples": truth.n_samples, "seconds": seconds, "method": truth.method}
        self.disk.write_with(f"references/{key}.json", numbers, written)

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
        with self.disk.path(f"references/{key}_deviates.npz").open("rb") as file, np.load(file) as stored:
            return np.asarray(stored["deviates"])

    def mask(self, key: str) -> NDArray[np.bool_]:
        """Pixels (H, W) of a reference that show the surface."""
        with Picture.open(self.disk.path(f"references/{key}_mask.png")) as picture:
            return np.asarray(picture) > 0

    def half_vectors(self, key: str) -> NDArray[np.float32] | None:
        """The pattern (N, 2), theta and phi, of a cell; None if the method has none."""
        path = self.disk.path(f"images/{key}_half_vectors.npy")
        return np.load(path, allow_pickle=False) if path.is_file() else None

    def pictures(self, key: str) -> dict[str, NDArray[np.float32]]:
        """Pictures (H, W, 3) of the state of a cell's method, by name."""
        stem = f"{key}_state_"
        names = sorted(path.name for path in self.disk.path("images").glob(f"{stem}*.exr"))
        return {name.removeprefix(stem).removesuffix(".exr"): self._read_pixels(f"images/{name}") for name in names}

    def _read_pixels(self, name: str) -> NDArray[np.float32]:
        return np.asarray(read_pixels(self.disk.path(name)))

    def _write_image(self, name: str, image: Tensor) -> str:
        write_exr(self.disk.path(name), image)
        return name
