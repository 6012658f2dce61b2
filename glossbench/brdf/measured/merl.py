"""Files of the MERL database: 90 x 90 x 180 values per channel over half vector and difference."""

from dataclasses import dataclass
from math import pi
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from glossbench.brdf.measured.half_difference import half_difference
from glossbench.channels import LARGEST, Channels
from glossbench.directions import Vec3
from glossbench.errors import InputError
from glossbench.shapes import Directions

SHAPE = (90, 90, 180)  # theta_h, theta_d, phi_d
SCALES = (1 / 1500, 1.15 / 1500, 1.66 / 1500)  # of red, green, blue: stored value -> 1/sr
SIZE = 12 + 3 * 8 * 90 * 90 * 180


@dataclass(frozen=True)
class HalfDifferenceTable:
    """f over the angle theta_h of the half vector and the direction (theta_d, phi_d) of wi about it.

    Values are constant over a cell, as in the authors' reader. Cell i of theta_h begins at (i / 90)^2 pi/2; theta_d has
    90 cells of one degree, phi_d 180 cells of one degree. phi_d and phi_d + pi are the same cell, because swapping wo
    and wi turns the difference by pi.

    Attributes:
        values: red, green and blue [1/sr], each flat over (theta_h, theta_d, phi_d); 0 in cells without measurement.
        measured: whether a cell has a measurement, flat.

    Source: Matusik et al. 2003; coordinates, Rusinkiewicz 1998.
    """

    values: tuple[Float[Tensor, "cells"], ...]
    measured: Tensor

    def value(self, wo: Directions, wi: Directions) -> Channels:
        """The value of the cell."""
        at = _find_cell(wo, wi)
        return tuple(channel[at] for channel in self.values)

    def known(self, wo: Vec3, wi: Vec3) -> Tensor:
        """Whether the cell has a value."""
        return self.measured[_find_cell(wo, wi)]


def _find_cell(wo: Vec3, wi: Vec3) -> Tensor:
    theta_h, theta_d, phi_d = half_difference(wo, wi)
    i = (torch.sqrt(theta_h * (2 / pi)) * 90).int().clamp(0, 89)
    j = (theta_d * (180 / pi)).int().clamp(0, 89)
    k = (phi_d * (180 / pi)).int().clamp(0, 179)
    return (i * 90 + j) * 180 + k


def read_merl(path: Path, device: str) -> tuple[HalfDifferenceTable, int]:
    """The table of a `.binary` file, and the number of its negative values.

    The file holds three int32 dimensions, then the doubles of red, of green and of blue. A cell with a negative channel
    has no measurement: it is black and not known.

    Raises:
        InputError: size or dimensions are wrong, or a value is not finite or above 1e30.
    """
    size = path.stat().st_size
    if size < 12:
        raise InputError(f"{path}: not a MERL file: {size} bytes cannot hold three dimensions")
    with path.open("rb") as file:
        dimensions = tuple(int(n) for n in np.frombuffer(file.read(12), "<i4"))
        if dimensions != SHAPE:
            raise InputError(f"{path}: not a MERL file of an isotropic BRDF: dimensions {dimensions}, must be {SHAPE}")
        if size != SIZE:
            what = "truncated" if size < SIZE else "too long"
            raise InputError(f"{path}: MERL file {what}: {size} bytes, must be {SIZE}")
        stored = np.fromfile(file, "<f8").reshape(3, -1)
    wrong = ~(np.abs(stored) <= LARGEST)
    if wrong.any():
        raise InputError(f"{path}: MERL file with {int(wrong.sum())} values that are not finite, or above {LARGEST:g}")
    measured = torch.from_numpy((stored >= 0).all(0)).to(device)
    scaled = torch.from_numpy(stored * np.array(SCALES)[:, None]).to(device)
    values = tuple(torch.where(measured, channel, 0.0).float() for channel in scaled)
    return HalfDifferenceTable(values, measured), int((stored < 0).sum())
