"""Homomorphic factorization: a positive function as a product of maps, by least squares on its logarithm.

log f(x_s) ~ sum over j of log t_j(pi_j(x_s)): each sample s reads each map t_j at one place, with bilinear weights of
the texels around it. These weights are a row of a sparse matrix A_j. A Laplacian L_j keeps a map smooth where no sample
reads it:

    [ A_1 ... A_J ]                [ log f ]
    [ lambda L_1  ]  log t   =     [ 0     ]
    [       ...   ]                [ ...   ]

Any map of texels can be used (faces of a cube, a paraboloid, a table of angles): only its rows and its Laplacian
matter. The channels of f share the matrix.

Source: McCool et al. 2001, sections 4 and 5; Latta and Kolb 2002, section 3.1, eq. 8.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array, csr_array

from glossbench.errors import InputError

Floats = NDArray[np.float64]
Solver = Literal["qmr", "lsmr", "cg"]


@dataclass(frozen=True)
class FactorMap:
    """One map of T texels as S samples read it.

    Attributes:
        rows: (U, T) sparse: weights of the texels; each row has the sum 1. See `weight_rows`.
        laplacian: (T, T) sparse, 0 for a constant map. See `grid_laplacian`.
        of_sample: (S,) the row of each sample, if several samples read one place; by default sample s has row s.
    """

    rows: csr_array
    laplacian: csr_array
    of_sample: NDArray[np.int64] | None = None

    def read(self, values: Floats) -> Floats:
        """The values (S, C) that the samples read from a map (T, C)."""
        read: Floats = self.rows @ values
        return read if self.of_sample is None else read[self.of_sample]

    def gather(self, samples: Floats) -> Floats:
        """The transpose of `read`: for each texel, the weighted sum of (S, C) over the samples that read it, (T, C)."""
        sums: Floats = self.rows.T @ (samples if self.of_sample is None else self._shared.T @ samples)
        return sums

    def sum_squares(self) -> Floats:
        """Sum of the squared weights of each texel, (T,): the diagonal of A^T A."""
        counts = 1 if self.of_sample is None else np.bincount(self.of_sample, minlength=self.rows.shape[0])
        squares: Floats = self.rows.power(2).T @ (np.ones(self.rows.shape[0]) * counts)
        return squares

    @property
    def _shared(self) -> csr_array:
        assert self.of_sample is not None
        n = len(self.of_sample)
        return csr_array((np.ones(n), self.of_sample, np.arange(n + 1)), shape=(n, self.rows.shape[0]))


@dataclass(frozen=True)
class Factors:
    """The result of a factorization.

    Attributes:
        logs: log t_j of each map, (T_j, C). Adding a constant to one map and subtracting it from another one does not
            change the product.
        iterations: the number of iterations of the solver.
    """

    logs: tuple[Floats, ...]
    iterations: int


def weight_rows(texels: ArrayLike, weights: ArrayLike, n_texels: int) -> csr_array:
    """Rows (S, T) of a map from texel indices (S, K) and their weights (S, K); a row may name one texel twice.

    Raises:
        InputError: an index is not that of a texel.
    """
    index, values = np.asarray(texels), np.asarray(weights, dtype=np.float64)
    if index.size and not 0 <= index.min() <= index.max() < n_texels:
        raise InputError(f"texels must be in [0, {n_texels}), got {index.min()} to {index.max()}")
    n, k = index.shape
    rows = csr_array((values.ravel(), index.ravel(), np.arange(0, n * k + 1, k)), shape=(n, n_texels))
    rows.sum_duplicates()
    return rows


def grid_rows(row: ArrayLike, column: ArrayLike, shape: tuple[int, int]) -> csr_array:
    """Bilinear rows (S, H W) at places of an image (H, W), clamped at its rim.

    Places are in texels; the centres of texels are at half-integers.
    """
    taps = []
    for place, size in zip((row, column), shape, strict=True):
        x = np.clip(np.asarray(place, dtype=np.float64) - 0.5, 0, size - 1)
        lower = np.minimum(x.astype(np.int64), max(size - 2, 0))
        taps.append(((lower, np.minimum(lower + 1, size - 1)), (1 - (x - lower), x - lower)))
    (rows, v), (columns, u) = taps
    index = np.stack([r * shape[1] + c for r in rows for c in columns], axis=1)
    weights = np.stack([a * b for a in v for b in u], axis=1)
    return weight_rows(index, weights, shape[0] * shape[1])


def grid_laplacian(shape: tuple[int, int]) -> csr_array:
    """Laplacian (H W, H W) of an image: the sum of (texel - neighbour) over its four neighbours, fewer at the rim."""
    index = np.arange(shape[0] * shape[1]).reshape(shape)
    pairs = [(index[1:], index[:-1]), (index[:, 1:], index[:, :-1])]
    return neighbour_laplacian(np.concatenate([np.stack([a.ravel(), b.ravel()], 1) for a, b in pairs]), index.size)


def neighbour_laplacian(pairs: NDArray[np.int64], n_texels: int) -> csr_array:
    """Laplacian (T, T) from pairs of neighbours (K, 2), each pair once.

    The diagonal holds the number of neighbours of a texel; the entry of each pair is -1.
    """
    a, b = pairs.T
    rows, columns = np.concatenate([a, b, a, b]), np.concatenate([b, a, a, b])
    values = np.repeat([-1.0, 1.0], 2 * len(pairs))
    return csr_array(coo_array((values, (rows, columns)), shape=(n_texels, n_texels)))


def average_start(log_f: Floats, maps: Sequence[FactorMap]) -> list[Floats]:
    """Maps (T, C) to start from: for each texel, the weighted mean of the samples that read it.

    From each of J maps, (J - 1) / J of the mean of all samples is subtracted, so that the product has the right level.
    A texel that no sample reads gets the mean of its known neighbours, starting with texels next to known ones.

    Source: Latta and Kolb 2002, section 3.1. Differs: the level; the neighbours, where the paper weights the nearest
    samples by the inverse of their distance.
    """
    level = log_f.mean(0) * (1 - 1 / len(maps))
    starts = []
    for one in maps:
        weight = one.gather(np.ones((len(log_f), 1)))
        known = weight[:, 0] > 0
        values = np.where(known[:, None], one.gather(log_f) / np.where(known[:, None], weight, 1), 0.0)
        starts.append(_spread(values, known, one.laplacian) - level)
    return starts


def _spread(values: Floats, known: NDArray[np.bool_], laplacian: csr_array) -> Floats:
    """Values of unknown texels from their known neighbours, ring by ring.

    Texels that are not connected to a known texel get the mean of the known texels.
    """
    beside = csr_array(laplacian.copy())
    beside.setdiag(0)
    beside.eliminate_zeros()
    beside.data = np.ones_like(beside.data)
    known = known.copy()
    while not known.all():
        n_beside = beside @ known.astype(np.float64)
        ring = ~known & (n_beside > 0)
        if not ring.any():
            values[~known] = values[known].mean(0) if known.any() else 0.0
            break
        values[ring] = (beside[ring] @ (values * known[:, None])) / n_beside[ring, None]
        known |= ring
    return values


def factorize(
    log_f: Floats,
    maps: Sequence[FactorMap],
    smoothness: float,
    solver: Solver = "qmr",
    tolerance: float = 1e-6,
    max_iterations: int = 500,
    start: Sequence[Floats] | None = None,
) -> Factors:
    """The maps whose product is nearest to f in the logarithm: they minimize |A log t - log f|^2 + |lambda L log t|^2.

    Args:
        log_f: (S, C).
        smoothness: lambda, the weight of the Laplacian against the samples: with more samples it must be larger.
        solver: "qmr" (quasi-minimal residual) or "cg" for the normal equations, which are square, as these need; or
            "lsmr" for the least-squares problem itself. All three scale texels by the diagonal of the normal equations.
        tolerance: the solver stops at this residual, relative to that of a start from zero; for "lsmr", the tolerance
            of its own two tests.
        start: maps (T_j, C); by default `average_start`.

    Raises:
        InputError: a sample is not finite, or the number of samples differs from that of a map.
    """
    for j, one in enumerate(maps):
        n = one.rows.shape[0] if one.of_sample is None else len(one.of_sample)
        if n != len(log_f):
            raise InputError(f"map {j} is read by {n} samples, but there are {len(log_f)}")
    if not np.isfinite(log_f).all():
        raise InputError("the logarithm of a sample is not finite: raise samples that are not above 0 first")
    begin = np.concatenate(average_start(log_f, maps) if start is None else list(start))
    system = _System(maps, smoothness, log_f.shape[1])
    found, iterations = system.solve(log_f, begin, solver, tolerance, max_iterations)
    ends = np.cumsum([one.rows.shape[1] for one in maps])[:-1]
    return Factors(tuple(np.split(found, ends)), iterations)


class _System:
    """Eq. 8 for all channels at once, with texels scaled so that the diagonal of the normal equations is 1."""

    def __init__(self, maps: Sequence[FactorMap], smoothness: float, n_channels: int) -> None:
        self.maps, self.smoothness = maps, smoothness
        diagonal = np.concatenate([m.sum_squares() + smoothness**2 * m.laplacian.power(2).sum(0) for m in maps])
        self.scale = np.where(diagonal > 0, 1 / np.sqrt(np.maximum(diagonal, 1e-300)), 1.0)[:, None]
        self.shape = len(self.scale), n_channels
        self.ends = np.cumsum([m.rows.shape[1] for m in maps])[:-1]
        self._last: tuple[Floats, Floats] | None = None

    def solve(
        self, log_f: Floats, start: Floats, solver: Solver, tolerance: float, max_iterations: int
    ) -> tuple[Floats, int]:
        """Logarithms of all texels (T, C), and the number of iterations."""
        from scipy.sparse.linalg import LinearOperator, cg, lsmr, qmr  # late: few runs factorize

        n = self.shape[0] * self.shape[1]
        # The solver finds the difference from the start; its tolerance is relative to a start from zero.
        data = log_f - self._read(start)
        missing = self._gather(data, [-self.smoothness * (m.laplacian @ x) for m, x in self._split_by_map(start)])
        whole = self._gather(log_f, [np.zeros((m.rows.shape[1], self.shape[1])) for m in self.maps])
        enough = tolerance * float(np.linalg.norm(whole))
        iterations = 0

        def count(_: Any) -> None:
            nonlocal iterations
            iterations += 1

        if np.linalg.norm(missing) <= enough:
            return start, 0
        if solver == "lsmr":
            smooth = [-self.smoothness * (m.laplacian @ x) for m, x in self._split_by_map(start)]
            right = np.concatenate([data, *smooth]).ravel()
            operator = LinearOperator((len(right), n), self._apply, self._apply_transpose, dtype=np.float64)
            found, _, iterations, *_ = lsmr(operator, right, atol=tolerance, btol=tolerance, maxiter=max_iterations)
        else:
            operator = LinearOperator((n, n), self._apply_normal, self._apply_normal, dtype=np.float64)
            solve = {"qmr": qmr, "cg": cg}[solver]
            found, _ = solve(operator, missing.ravel(), rtol=0, atol=enough, maxiter=max_iterations, callback=count)
        return start + self.scale * found.reshape(self.shape), iterations

    def _split_by_map(self, values: Floats) -> Any:
        return zip(self.maps, np.split(values, self.ends), strict=True)

    def _read(self, values: Floats) -> Floats:
        """A log t, (S, C)."""
        return sum((m.read(x) for m, x in self._split_by_map(values)), np.zeros(()))

    def _gather(self, samples: Floats, smooth: Sequence[Floats]) -> Floats:
        """Scaled texels (T, C): transpose of the whole matrix, times values of its sample rows and Laplacian rows."""
        pairs = zip(self.maps, smooth, strict=True)
        return self.scale * np.concatenate(
            [m.gather(samples) + self.smoothness * (m.laplacian.T @ x) for m, x in pairs]
        )

    def _apply_normal(self, vector: Floats) -> Floats:
        """The normal equations' matrix times a vector."""
        # The matrix is symmetric: QMR asks for its product with the same vector twice, as matrix and as transpose.
        if self._last is not None and np.array_equal(self._last[0], vector):
            return self._last[1]
        values = self.scale * vector.reshape(self.shape)
        smooth = [self.smoothness * (m.laplacian @ x) for m, x in self._split_by_map(values)]
        product = self._gather(self._read(values), smooth).ravel()
        self._last = vector.copy(), product
        return product

    def _apply(self, vector: Floats) -> Floats:
        values = self.scale * vector.reshape(self.shape)
        smooth = [self.smoothness * (m.laplacian @ x) for m, x in self._split_by_map(values)]
        return np.concatenate([self._read(values), *smooth]).ravel()

    def _apply_transpose(self, vector: Floats) -> Floats:
        rows = vector.reshape(-1, self.shape[1])
        n = len(rows) - self.shape[0]
        return self._gather(rows[:n], np.split(rows[n:], self.ends)).ravel()
