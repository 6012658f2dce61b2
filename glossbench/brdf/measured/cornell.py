"""Files of Cornell's goniometer: scattered spectral samples, interpolated by homomorphic factorization."""

from dataclasses import dataclass
from math import pi, radians, sin
from pathlib import Path

import numpy as np
import scipy
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from scipy.sparse import csr_array
from torch import Tensor

from glossbench.brdf.measured.colorimetry import WAVELENGTHS, rec709
from glossbench.brdf.measured.half_difference import half_difference
from glossbench.channels import LARGEST, Channels
from glossbench.directions import Vec3, spherical
from glossbench.errors import InputError
from glossbench.factorization import FactorMap, factorize, grid_laplacian, grid_rows
from glossbench.file_bytes import require_size
from glossbench.shapes import Directions

Floats = NDArray[np.float64]
# Nodes of p lie at multiples of 10 degrees, where the goniometer measured: no sample would determine a node between
# them. Of 12 to 90 rings, 20 predict held-out samples best (within noise) and reproduce the samples best.
ENDS, DIFFERENCES, RINGS = 10, 19, 20  # nodes of p and of theta_d from 0 to 90 degrees; texels along theta_h
SMOOTHNESS = 0.1
FLOOR = 1e-4  # [1/sr] smallest value whose logarithm is taken: a diffuse albedo of 0.0003
REACH = radians(7)  # from the centre to a corner of a cell of 10 x 10 degrees, which is the spacing of samples
MAX_BYTES = 1 << 26  # of text: 40 times the largest published file
CELLS = 45  # per axis: of 2 degrees for theta_i and theta_o, of 4 degrees for the azimuth between them


@dataclass(frozen=True)
class FactoredTable:
    """f = p(theta_o) q(theta_h, theta_d) p(theta_i); the logarithms are linear between texels.

    Attributes:
        p: log p per channel (10,), at 0, 10 ... 90 degrees.
        q: log q per channel (19 * 20,), flat over (theta_d, theta_h): theta_d at 0, 5 ... 90 degrees, theta_h at
            ((i + 1/2) / 20)^2 pi/2.
        near: whether a sample lies within 7 degrees, flat over (theta_i, theta_o, azimuth between them).

    Source: McCool et al. 2001, p(wo) q(h) p(wi); Latta and Kolb 2002 section 3.3. Differs: the BRDF is isotropic, so p
    and q depend only on angles to the normal; q depends on theta_d too, because q(theta_h) misses the highlights of
    car paints, which Fresnel's equations make 70 times as strong towards grazing angles.
    """

    p: tuple[Float[Tensor, "10"], ...]
    q: tuple[Float[Tensor, "19*20"], ...]
    near: Tensor

    def value(self, wo: Directions, wi: Directions) -> Channels:
        """The product of the factors, also where nothing was measured."""
        theta_h, theta_d, _ = half_difference(wo, wi)
        ends = [_bracket(_locate(torch.acos(v.z.clamp(0, 1)), ENDS), ENDS) for v in (wo, wi)]
        d, ring = _bracket(_locate(theta_d, DIFFERENCES), DIFFERENCES), _bracket(_find_ring(theta_h), RINGS)
        at = d[0] * RINGS + ring[0]
        found = []
        for p, q in zip(self.p, self.q, strict=True):
            low = q[at] * (1 - ring[1]) + q[at + 1] * ring[1]
            high = q[at + RINGS] * (1 - ring[1]) + q[at + RINGS + 1] * ring[1]
            log = low * (1 - d[1]) + high * d[1]
            for i, share in ends:
                log = log + p[i] * (1 - share) + p[i + 1] * share
            found.append(torch.exp(log))
        return tuple(found)

    def known(self, wo: Vec3, wi: Vec3) -> Tensor:
        """Whether a sample lies within 7 degrees."""
        i, o = (((torch.acos(v.z.clamp(0, 1)) * (2 * CELLS / pi)).int()).clamp(0, CELLS - 1) for v in (wi, wo))
        across, along = wo.x * wi.y - wo.y * wi.x, wo.x * wi.x + wo.y * wi.y
        phi = (torch.atan2(across.abs(), along) * (CELLS / pi)).int().clamp(0, CELLS - 1)
        return self.near[(i * CELLS + o) * CELLS + phi]


def _locate(angle: Tensor, n: int) -> Tensor:
    """Position of an angle among n nodes from 0 to 90 degrees; node i is at i + 1/2, like the centre of a texel."""
    return angle * (2 * (n - 1) / pi) + 0.5


def _find_ring(theta_h: Tensor) -> Tensor:
    return torch.sqrt(theta_h * (2 / pi)) * RINGS


def _bracket(place: Tensor, size: int) -> tuple[Tensor, Tensor]:
    """The texel below a position (centres at half-integers) and the weight of the next one; clamped at both ends."""
    x = (place - 0.5).clamp(0, size - 1)
    lower = x.int().clamp(max=size - 2)
    return lower, x - lower


@dataclass(frozen=True)
class Samples:
    """Scattered samples: directions to the light and the viewer, (S,) each, and f in linear Rec. 709, (S, 3) [1/sr]."""

    wi: Vec3
    wo: Vec3
    f: Floats


def read_samples(path: Path) -> Samples:
    """The samples of a `.brdf` file; their colours may be negative.

    The file is text; comments begin with #. It holds the number of wavelengths, the wavelengths [nm], then the samples,
    each theta_i, phi_i, theta_s, phi_s [radians] and f [1/sr] at each wavelength; i is the light, s the viewer.

    Raises:
        InputError: the file is not such text or has more than 64 MiB, wavelengths are not 400, 410 ... 700, the last
            sample is cut off, a number is not finite, or a direction is not above the surface.
    """
    require_size(path, "goniometer file", MAX_BYTES)
    try:
        lines = path.read_text(encoding="ascii").splitlines()
        numbers = np.array(" ".join(line for line in lines if not line.lstrip().startswith("#")).split(), np.float64)
    except ValueError:
        raise InputError(f"{path}: not a goniometer file: it holds more than numbers and comments") from None
    n, width = len(WAVELENGTHS), len(WAVELENGTHS) + 4
    if not len(numbers) or numbers[0] != n or not np.array_equal(numbers[1 : 1 + n], WAVELENGTHS):
        raise InputError(f"{path}: not a goniometer file of {n} wavelengths from 400 to 700 nm")
    rows = numbers[1 + n :]
    if not len(rows) or len(rows) % width:
        raise InputError(
            f"{path}: goniometer file truncated: {len(rows)} numbers after its header, must be a multiple of {width}"
        )
    rows = rows.reshape(-1, width)
    wrong = ~(np.abs(rows) <= LARGEST)
    if wrong.any():
        told = f"{int(wrong.sum())} numbers that are not finite, or above {LARGEST:g}"
        raise InputError(f"{path}: goniometer file with {told}")
    theta = rows[:, [0, 2]]
    if (theta < 0).any() or (theta >= pi / 2).any():
        raise InputError(
            f"{path}: goniometer file: angles to the normal must be in [0, pi/2), got {_pick_outside(theta)}"
        )
    angles = torch.from_numpy(rows[:, :4])
    return Samples(spherical(angles[:, 0], angles[:, 1]), spherical(angles[:, 2], angles[:, 3]), rec709(rows[:, 4:]))


def _pick_outside(theta: Floats) -> float:
    return float(theta.min() if theta.min() < 0 else theta.max())


def read_cornell(path: Path, device: str) -> tuple[FactoredTable, int]:
    """The table of a `.brdf` file, and the number of negative values: colours outside the gamut, which count as 0.

    Raises:
        InputError: see `read_samples`.
    """
    samples = read_samples(path)
    return factor_samples(samples, device), int((samples.f < 0).sum())


def factor_samples(samples: Samples, device: str) -> FactoredTable:
    """The factors of the samples; values below 1e-4 count as 1e-4."""
    theta_h, theta_d, _ = half_difference(samples.wo, samples.wi)
    ends = [_locate(torch.acos(v.z), ENDS).numpy() for v in (samples.wi, samples.wo)]
    line = np.full(len(theta_h), 0.5)
    p = csr_array(grid_rows(line, ends[0], (1, ENDS)) + grid_rows(line, ends[1], (1, ENDS)))
    q = grid_rows(_locate(theta_d, DIFFERENCES).numpy(), _find_ring(theta_h).numpy(), (DIFFERENCES, RINGS))
    maps = [FactorMap(p, grid_laplacian((1, ENDS))), FactorMap(q, grid_laplacian((DIFFERENCES, RINGS)))]
    logs = factorize(np.log(np.maximum(samples.f, FLOOR)), maps, SMOOTHNESS).logs
    p_logs, q_logs = (tuple(torch.from_numpy(c.copy()).float().to(device) for c in log.T) for log in logs)
    return FactoredTable(p_logs, q_logs, _mark_near(samples).to(device))


def _mark_near(samples: Samples) -> Tensor:
    """Which cells lie within 7 degrees of a sample, or of a sample with light and viewer swapped."""
    tree = scipy.spatial.cKDTree(
        np.concatenate([_canonicalize(samples.wi, samples.wo), _canonicalize(samples.wo, samples.wi)])
    )
    centre = (torch.arange(CELLS, dtype=torch.float64) + 0.5) / CELLS
    i, o, phi = (c.flatten() for c in torch.meshgrid(centre * pi / 2, centre * pi / 2, centre * pi, indexing="ij"))
    cells = _canonicalize(spherical(i, torch.zeros_like(i)), spherical(o, phi))
    return torch.from_numpy(tree.query(cells)[0] <= 2 * sin(REACH / 2))


def _canonicalize(a: Vec3, b: Vec3) -> Floats:
    """Pairs of directions, turned and mirrored so that a has azimuth 0 and b a positive azimuth: (S, 5)."""
    length = torch.sqrt(a.x**2 + a.y**2)
    e_x = torch.where(length > 1e-9, a.x / length.clamp(min=1e-9), 1.0)
    e_y = torch.where(length > 1e-9, a.y / length.clamp(min=1e-9), 0.0)
    turned = Vec3(b.x * e_x + b.y * e_y, (b.y * e_x - b.x * e_y).abs(), b.z)
    return torch.stack([length, a.z, *turned], dim=1).numpy()
