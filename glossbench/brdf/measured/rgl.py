"""Files of the RGL material database: values over a square to which the material's own microfacets map half vectors."""

from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from glossbench.brdf.measured.half_difference import azimuth
from glossbench.brdf.measured.tensor_file import read_tensors
from glossbench.channels import LARGEST, Channels, scalar
from glossbench.directions import Vec3, half_vector
from glossbench.errors import InputError
from glossbench.shapes import Directions

FIELDS = {"theta_i": 1, "phi_i": 1, "sigma": 2, "ndf": 2, "vndf": 4, "luminance": 4, "rgb": 5, "jacobian": 1}


class Slices(NamedTuple):
    """Flat tables (S, ny, nx) on the corners of a grid, one per view angle; linear within tables and between them."""

    values: Tensor
    nx: int
    ny: int

    def corners(self, view: tuple[Tensor, Tensor], x: Tensor, y: Tensor) -> tuple[Tensor, ...]:
        """v00, v10, v01, v11 of the cell (x, y); x and y are integers, the first digit is the step along x."""
        return tuple(self.node(view, x + step, y + up) for up in (0, 1) for step in (0, 1))

    def node(self, view: tuple[Tensor, Tensor], x: Tensor, y: Tensor) -> Tensor:
        """The value at a node."""
        return self.interpolate(view, (view[0] * self.ny + y) * self.nx + x, self.nx * self.ny)

    def interpolate(self, view: tuple[Tensor, Tensor], at: Tensor, stride: int) -> Tensor:
        """The value at an index of a slice, interpolated between this slice and the next."""
        return self.values[at] * (1 - view[1]) + self.values[at + stride] * view[1]


@dataclass(frozen=True)
class AdaptiveTable:
    """f cos_i = rgb(s; theta_o) ndf(u_h) / (4 sigma(theta_o)); s is the point that the visible normals assign to u_h.

    u_h = (sqrt(2 theta_h / pi), (phi_h - phi_o) / (2 pi) + 1/2). s is in the unit square; sampling the visible normals
    `vndf` maps s to u_h, and here the inverse maps u_h to s: first the row, by its marginal, then the column. Tables
    are linear between their nodes and between the measured angles. Values below 0 are outside the gamut of Rec. 709 and
    count as 0. The authors' reader does the same. Their incident direction is the viewer here, as in their renderer: f
    is only as reciprocal as the measurement.

    Attributes:
        theta: measured angles of the viewer.
        vndf: density of u_h; the integral over each slice is 1.
        rows, columns: marginal and conditional cumulated densities of vndf.
        rgb: reflectance relative to that of the microfacets, per channel.
        ndf, sigma: density and projected area of the microfacets; empty if the file does not divide by them.
        filled: nodes as in rgb; 1 where the file states that it has no measurement.
        widest: angle of the viewer beyond which the file repeats its last slice.

    Source: Dupuy and Jakob 2018.
    """

    theta: Tensor
    vndf: Slices
    rows: Slices
    columns: Slices
    rgb: tuple[Slices, Slices, Slices]
    ndf: tuple[Slices, ...]
    sigma: tuple[Slices, ...]
    filled: Slices
    widest: Tensor

    def value(self, wo: Directions, wi: Directions) -> Channels:
        """f [1/sr]; where nothing was measured it is the value that the authors extrapolated."""
        view, u_x, u_y = self._map_to_unit_square(wo, wi)
        s_x, s_y = self._unfold(view, u_x, u_y)
        factor = 1 / wi.z.clamp(min=1e-6)
        if self.ndf:
            none = (torch.zeros_like(view[0]), torch.zeros_like(view[1]))
            u_o = torch.sqrt(torch.acos(wo.z.clamp(-1, 1)) * (2 / pi))
            sigma = _bilinear(self.sigma[0], none, u_o, torch.full_like(u_o, 0.5))
            factor = factor * _bilinear(self.ndf[0], none, u_x, u_y) / (4 * sigma)
        return tuple(_bilinear(channel, view, s_x, s_y).clamp(min=0) * factor for channel in self.rgb)

    def known(self, wo: Vec3, wi: Vec3) -> Tensor:
        """Whether all nodes around s were measured."""
        view, u_x, u_y = self._map_to_unit_square(wo, wi)
        s_x, s_y = self._unfold(view, u_x, u_y)
        return (_bilinear(self.filled, view, s_x, s_y) == 0) & (torch.acos(wo.z.clamp(-1, 1)) <= self.widest)

    def _map_to_unit_square(self, wo: Vec3, wi: Vec3) -> tuple[tuple[Tensor, Tensor], Tensor, Tensor]:
        """The slice below the view, the weight of the next slice, and u_h."""
        theta_o = torch.acos(wo.z.clamp(-1, 1))
        index = (torch.searchsorted(self.theta, theta_o.contiguous(), right=True) - 1).clamp(0, len(self.theta) - 2)
        low, high = self.theta[index], self.theta[index + 1]
        h = half_vector(wo, wi)
        e_x, e_y = azimuth(wo)
        phi = torch.atan2(h.y * e_x - h.x * e_y, h.x * e_x + h.y * e_y)
        u_x = torch.sqrt(torch.atan2(torch.sqrt(h.x * h.x + h.y * h.y), h.z) * (2 / pi))
        share = ((theta_o - low) / (high - low)).clamp(0, 1)
        return (index.int(), share), u_x, torch.remainder(phi / (2 * pi) + 0.5, 1.0)

    def _unfold(self, view: tuple[Tensor, Tensor], u_x: Tensor, u_y: Tensor) -> tuple[Tensor, Tensor]:
        """s, by the inverse of sampling vndf: the integrals of the bilinear density along the row and over the rows."""
        nx, ny = self.vndf.nx, self.vndf.ny
        x, y, f_x, f_y = _find_cell(self.vndf, u_x, u_y)
        v00, v10, v01, v11 = self.vndf.corners(view, x, y)
        c0, c1 = v00 + f_y * (v01 - v00), v10 + f_y * (v11 - v10)
        a0, a1 = (self.columns.node(view, x, y + up) for up in (0, 1))
        r0, r1 = (self.columns.node(view, torch.full_like(x, nx - 1), y + up) for up in (0, 1))
        along = f_x * (c0 + 0.5 * f_x * (c1 - c0)) + a0 + f_y * (a1 - a0)
        s_x = along / (r0 + f_y * (r1 - r0)).clamp(min=1e-30)
        s_y = f_y * (r0 + 0.5 * f_y * (r1 - r0)) + self.rows.interpolate(view, view[0] * ny + y, ny)
        return s_x.clamp(0, 1), s_y.clamp(0, 1)


def _find_cell(table: Slices, u_x: Tensor, u_y: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The cell of a point of the unit square, and the position inside."""
    at_x, at_y = u_x * (table.nx - 1), u_y * (table.ny - 1)
    x, y = at_x.int().clamp(0, table.nx - 2), at_y.int().clamp(0, table.ny - 2)
    return x, y, at_x - x, at_y - y


def _bilinear(table: Slices, view: tuple[Tensor, Tensor], u_x: Tensor, u_y: Tensor) -> Tensor:
    x, y, f_x, f_y = _find_cell(table, u_x, u_y)
    v00, v10, v01, v11 = table.corners(view, x, y)
    low, high = v00 + f_x * (v10 - v00), v01 + f_x * (v11 - v01)
    return low + f_y * (high - low)


def read_rgl(path: Path, device: str) -> tuple[AdaptiveTable, int]:
    """The table of an isotropic RGB `.bsdf` file, and the number of its negative values.

    `valid`, if the file has it, holds one bit per node, the highest bit first. A bit is set if there is no measurement:
    this follows from the published files, where it is set for all nodes of zero luminance.

    Raises:
        InputError: the file is not a tensor file, arrays are missing or do not fit, the data are spectral or
            anisotropic, or a value is not finite.
    """
    arrays = read_tensors(path)
    if "rgb" not in arrays and "spectra" in arrays:
        raise InputError(f"{path}: a spectral .bsdf file; use the one whose name ends in _rgb")
    for name, n_axes in FIELDS.items():
        if name not in arrays:
            raise InputError(f"{path}: not a BSDF file: it has no {name!r}, only {', '.join(sorted(arrays))}")
        if arrays[name].ndim != n_axes:
            raise InputError(f"{path}: BSDF file: {name!r} has {arrays[name].ndim} axes, must have {n_axes}")
        if not (np.abs(arrays[name]) <= LARGEST).all():
            raise InputError(f"{path}: BSDF file: {name!r} has values that are not finite, or above {LARGEST:g}")
    theta, rgb, vndf = arrays["theta_i"], arrays["rgb"], arrays["vndf"]
    if len(arrays["phi_i"]) > 1:
        raise InputError(
            f"{path}: an anisotropic BSDF, of {len(arrays['phi_i'])} azimuths: only isotropic ones are read"
        )
    if len(theta) < 2 or (np.diff(theta) <= 0).any():
        raise InputError(f"{path}: BSDF file: theta_i must be two angles or more that increase")
    wanted = {"vndf": (1, len(theta)), "luminance": (1, len(theta)), "rgb": (1, len(theta), 3)}
    for name, first in wanted.items():
        if arrays[name].shape[: len(first)] != first:
            raise InputError(f"{path}: BSDF file: {name!r} is {arrays[name].shape}, must begin with {first}")
    if any(n < 2 for name in ("sigma", "ndf", "vndf", "rgb") for n in arrays[name].shape[-2:]):
        raise InputError(f"{path}: BSDF file: a table of fewer than 2 x 2 nodes")
    if not (vndf.sum((2, 3)) > 0).all() or (vndf < 0).any() or not (arrays["sigma"] > 0).all():
        raise InputError(f"{path}: BSDF file: vndf must be a density and sigma positive")

    density, rows, columns = _cumulate(vndf[0].astype(np.float64))
    n_nodes = rgb.shape[3] * rgb.shape[4]
    bits = np.unpackbits(arrays.get("valid", np.zeros(0, np.uint8)).view(np.uint8))
    filled = bits if len(bits) == len(theta) * n_nodes else (arrays["luminance"] == 0)
    repeated = len(theta) > 2 and np.array_equal(rgb[0, -1], rgb[0, -2])

    def to_slices(table: NDArray[Any]) -> Slices:
        values = torch.from_numpy(np.ascontiguousarray(table, np.float32).reshape(-1)).to(device)
        return Slices(values, table.shape[-1], table.shape[-2])

    facets = bool(arrays["jacobian"][0])
    return AdaptiveTable(
        torch.from_numpy(theta.astype(np.float32)).to(device),
        to_slices(density),
        to_slices(rows[:, :, None]),
        to_slices(columns),
        (to_slices(rgb[0, :, 0]), to_slices(rgb[0, :, 1]), to_slices(rgb[0, :, 2])),
        (to_slices(_double(arrays["ndf"])),) if facets else (),
        (to_slices(_double(arrays["sigma"])),) if facets else (),
        to_slices(filled.reshape(len(theta), *rgb.shape[3:])),
        scalar(theta[-2] if repeated else theta[-1], device),
    ), int((rgb < 0).sum())


def _double(table: NDArray[Any]) -> NDArray[Any]:
    """One table as two equal slices."""
    return np.stack([table, table])


def _cumulate(v: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Densities (S, ny, nx) per cell, with integral 1 over each slice, and their cumulated rows and columns."""
    steps = (v[:, :, 1:] + v[:, :, :-1]) / 2
    columns = np.concatenate([np.zeros_like(v[:, :, :1]), steps.cumsum(2)], 2)
    ends = columns[:, :, -1]
    rows = np.concatenate([np.zeros_like(ends[:, :1]), ((ends[:, 1:] + ends[:, :-1]) / 2).cumsum(1)], 1)
    total = rows[:, -1]
    return v / total[:, None, None], rows / total[:, None], columns / total[:, None, None]
