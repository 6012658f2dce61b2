"""Partial sums of a reference on disk, so that a killed computation can be continued."""

import hashlib
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from glossbench.atomic import replacing
from glossbench.provenance import compute_code_hash, compute_source_hash
from glossbench.shading.costs import find_tensors

INTERVAL = 10.0  # least seconds between two savings: the sums of a large image take a hundred megabytes


class Checkpoint:
    """A file with partial sums. Its name is a key of everything that decides the sums. It is written whole or not.

    Attributes:
        path: path of the file; None if nothing is stored.
    """

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self._saved = time.monotonic()

    @staticmethod
    def of(folder: Path | None, *parts: Any) -> "Checkpoint":
        """The file in a folder whose name depends on the parts (texts, numbers, tensors) and on the source code.

        A part that is a class counts by the hash of its source.
        """
        if folder is None:
            return Checkpoint(None)
        digest = hashlib.sha256(compute_code_hash("glossbench.truth.reference").encode())
        for part in parts:
            for piece in _to_bytes(part):
                digest.update(piece)
        return Checkpoint(folder / f"{digest.hexdigest()[:20]}.partial.npz")

    def load(self, sums: Tensor, done: list[int]) -> None:
        """Read the sums, and the number of samples in each, from disk; without a file nothing changes."""
        if self.path is None or not self.path.is_file():
            return
        try:
            with self.path.open("rb") as file, np.load(file) as stored:
                kept, counts = torch.from_numpy(stored["sums"]), stored["done"].tolist()
        except (OSError, ValueError, KeyError, EOFError, RuntimeError, zipfile.BadZipFile):  # damaged: start again
            return
        if kept.shape == sums.shape and len(counts) == len(done):
            sums.copy_(kept)
            done[:] = counts

    def save(self, sums: Tensor, done: list[int]) -> None:
        """Write the sums to disk in place of the last ones, unless these are younger than `INTERVAL`."""
        if self.path is not None and time.monotonic() - self._saved >= INTERVAL:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with replacing(self.path) as part, part.open("wb") as file:
                np.savez(file, sums=sums.cpu().numpy(), done=np.array(done))
            self._saved = time.monotonic()

    def remove(self) -> None:
        """Delete the file: a finished reference does not need partial sums."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)


def _to_bytes(part: Any) -> Iterator[bytes]:
    if isinstance(part, type):
        yield compute_source_hash(part).encode()
        return
    if isinstance(part, str | int):
        yield f"{part!r} ".encode()
    for tensor in find_tensors(part):
        yield f"{tuple(tensor.shape)} {tensor.dtype} ".encode()
        yield tensor.detach().cpu().contiguous().numpy().tobytes()
