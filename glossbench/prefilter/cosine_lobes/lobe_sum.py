"""A glossy lobe as a sum of cosine lobes about the mirror direction."""

from dataclasses import dataclass
from math import pi

import numpy as np
import scipy
import torch
from numpy.typing import NDArray
from torch import Tensor

from glossbench.brdf.lobe import Lobe
from glossbench.directions import Vec3, reflect

LARGEST = 1e7  # largest exponent: no cube of texels can distinguish its lobe from a mirror
CLOSE = 1e-4  # error relative to the volume, to which float32 rounding limits the fit of an exact cosine lobe
VIEWS = 64  # number of view cosines in the table of albedos


@dataclass(frozen=True)
class LobeSum:
    """f cos_i ~ albedo(cos_o) sum of shares_k (s_k + 1) / (2 pi) cos^s_k(alpha), alpha from wi to the mirror direction.

    Attributes:
        exponents: s_k >= 1, (K,).
        shares: shares of the energy, with sum 1, (K,). Both tuples are empty if the lobe is black.
        error: integral of |f cos_i - sum| / integral of f cos_i, seen along the normal.
        albedo: directional albedo at cos_o = (i + 1) / 64, (64, 3), float32.
    """

    exponents: tuple[float, ...]
    shares: tuple[float, ...]
    error: float
    albedo: Tensor

    def interpolate_albedo(self, cos_o: Tensor) -> Tensor:
        """Directional albedo (P, 3), linear between the views of the table."""
        at = (cos_o.clamp(0, 1) * VIEWS - 1).clamp(0, VIEWS - 1)
        lower = at.long().clamp(max=VIEWS - 2)
        share = (at - lower)[:, None]
        return self.albedo[lower] * (1 - share) + self.albedo[lower + 1] * share


def no_lobe_sum(lobe: Lobe) -> str | None:
    """The reason why a lobe is not a sum of round lobes about the mirror direction; None if it is."""
    device = lobe.ks[0].device
    aslant = Vec3(*(torch.tensor([[v]], device=device) for v in (0.48, 0.36, 0.8)))
    normal = Vec3(*(torch.tensor([[v]], device=device) for v in (0.0, 0.0, 1.0)))
    axis = lobe.to_surface(aslant, reflect(lobe.viewer(aslant), normal))
    if any((a - b).abs().max() > 1e-5 for a, b in zip(axis, reflect(aslant, normal), strict=True)):
        return "the axis of its lobe is not the mirror direction"
    if not torch.allclose(lobe.widths[0], lobe.widths[1]):
        return "its lobe is anisotropic, and cosine lobes are round"
    return None


def fit_lobe_sum(lobe: Lobe, n_lobes: int) -> LobeSum:
    """The lobe seen along the normal as a sum of at most N cosine lobes, by least squares over the hemisphere.

    It uses the least number of lobes: a second lobe is not fitted if the error with one is below 1e-4. So a Phong lobe
    (s + 2) / (2 pi) cos^s, foreshortened by cos_i, which is cos(alpha) in that view, is one lobe of exponent s + 1. A
    Phong lobe without foreshortening is one lobe of exponent s. A black lobe is the empty sum.
    """
    device = lobe.ks[0].device
    cos_o = (torch.arange(VIEWS, device=device) + 1) / VIEWS
    albedo = lobe.albedo(Vec3(torch.sqrt(1 - cos_o * cos_o), torch.zeros_like(cos_o), cos_o)).float()
    away, weight, values = _sample_profile(lobe)
    total = float((weight * values).sum())
    if not total > 0:
        return LobeSum((), (), 0.0, albedo)
    values = values / total
    best = None
    for n in range(1, n_lobes + 1):
        exponents, shares = _fit(away, weight, values, n)
        error = float((weight * np.abs(_sum(away, exponents, shares) - values)).sum())
        if best is None or error < best[2]:
            best = exponents, shares, error
        if best[2] < CLOSE:
            break
    assert best is not None
    return LobeSum(tuple(best[0].tolist()), tuple(best[1].tolist()), best[2], albedo)


def _sample_profile(lobe: Lobe) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """1 - cos(alpha), weights of the solid angle, and the channel mean of f cos_i, seen along the normal."""
    # Nodes are equally spaced in the logarithm, so that lobes of all widths have equally many.
    log_away = np.linspace(np.log(1e-10), 0, 2000)
    away = np.exp(log_away)
    weight = 2 * pi * away * np.gradient(log_away)
    t = torch.tensor(away, device=lobe.ks[0].device)
    sin = torch.sqrt(t * (2 - t))
    wi = Vec3(sin.float(), torch.zeros_like(sin).float(), (1 - t).float())
    zero = torch.zeros_like(wi.z)
    f = torch.stack(lobe.f(Vec3(zero, zero, zero + 1), wi)).double().reshape(-1, len(away)).mean(0)
    return away, weight, (f * (1 - t)).cpu().numpy()


def _sum(away: NDArray[np.float64], exponents: NDArray[np.float64], shares: NDArray[np.float64]) -> NDArray[np.float64]:
    powers = np.exp(exponents * np.log1p(-np.minimum(away, 1 - 1e-15))[:, None])
    total: NDArray[np.float64] = (shares * (exponents + 1) / (2 * pi) * powers).sum(1)
    return total


def _fit(
    away: NDArray[np.float64], weight: NDArray[np.float64], values: NDArray[np.float64], n: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Exponents and shares of n lobes."""
    peak = values.max()
    # The peak of a cosine lobe is (s + 1) / (2 pi); several lobes start with exponents on both sides of this s.
    start = np.clip(2 * pi * peak - 1, 1.0, LARGEST) * 4.0 ** (np.arange(n) - (n - 1) / 2)
    scale = np.sqrt(weight / (weight * values**2).sum())

    def parts(x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        shares = np.exp(x[n:] - x[n:].max())
        return np.exp(x[:n]), shares / shares.sum()

    def residual(x: NDArray[np.float64]) -> NDArray[np.float64]:
        difference: NDArray[np.float64] = scale * (_sum(away, *parts(x)) - values)
        return difference

    bounds = np.repeat([[0.0], [np.log(LARGEST)]], n, axis=1), np.repeat([[-20.0], [20.0]], n, axis=1)
    limits = [np.concatenate([b[i] for b in bounds]) for i in (0, 1)]
    x = np.concatenate([np.log(np.clip(start, 1.001, LARGEST / 1.001)), np.zeros(n)])
    found = scipy.optimize.least_squares(residual, x, bounds=limits, xtol=1e-12, ftol=1e-12, gtol=1e-12, max_nfev=200)
    return parts(found.x)
