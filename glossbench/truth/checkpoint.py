"""Partial sums of a reference on disk, so that one which was killed goes on where it was."""

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
from glossbench.provenance import code_hash, source_hash
from glossbench.shading.costs import tensors_in

INTERVAL = 10.0  # seconds between two savings at the least: the sums of a large image are a hundred megabytes


class Checkpoint:
    """One file in a folder, whole or absent, under a key of all that decides the sums; or none at all.

    Attributes:
        path: of the file; None keeps nothing.
    """

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self._saved = time.monotonic()

    @staticmethod
    def of(folder: Path | None, *parts: Any) -> "Checkpoint":
        """The file in a folder for what some texts, numbers and tensors decide, and the source that adds them up.

        Of a class the source counts that it is made of.
        """
        if folder is None:
            return Checkpoint(None)
        digest = hashlib.sha256(code_hash("glossbench.truth.reference").encode())
        for part in parts:
            for piece in _bytes(part):
                digest.update(piece)
        return Checkpoint(folder / f"{digest.hexdigest()[:20]}.partial.npz")

    def load(self, sums: Tensor, done: list[int]) -> None:
        """Fill in the sums and the samples that each holds, where there are any on disk."""
        if self.path is None or not self.path.is_file():
            return
        try:
            with self.path.open("rb") as file, np.load(file) as stored:
                kept, counts = torch.from_numpy(stored["sums"]), stored["done"].tolist()
        except (OSError, ValueError, KeyError, EOFError, RuntimeError, zipfile.BadZipFile):  # damaged: begin again
            return
        if kept.shape == sums.shape and len(counts) == len(done):
            sums.copy_(kept)
            done[:] = counts

    def save(self, sums: Tensor, done: list[int]) -> None:
        """Put the sums on disk in place of the last, unless that was a moment ago."""
        if self.path is not None and time.monotonic() - self._saved >= INTERVAL:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with replacing(self.path) as part, part.open("wb") as file:
                np.savez(file, sums=sums.cpu().numpy(), done=np.array(done))
            self._saved = time.monotonic()

    def remove(self) -> None:
        """What is finished needs no partial sums."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)


def _bytes(part: Any) -> Iterator[bytes]:
    if isinstance(part, type):
        yield source_hash(part).encode()
        return
    if isinstance(part, str | int):
        yield f"{part!r} ".encode()
    for tensor in tensors_in(part):
        yield f"{tuple(tensor.shape)} {tensor.dtype} ".encode()
        yield tensor.detach().cpu().contiguous().numpy().tobytes()
