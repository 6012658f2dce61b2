"""Samples of a lobe against a density: chi-square over cells of theta and phi."""

from dataclasses import dataclass
from math import atan2, pi

import numpy as np
import torch
from scipy.stats import chi2

from glossbench.directions import points_2d
from oracles.hemisphere import vectors

SAMPLES, SEEDS = 100_000, (2, 3, 5)


def draw(lobe, wo, n, seed):
    """Light directions (n, 3) in float64."""
    wi = lobe.sample(vectors([wo]), lobe.sample_points(points_2d(n, "random", seed))).wi
    return torch.stack([c.expand(1, n)[0] for c in wi], dim=1).double().numpy()


def angles_about(wi, azimuth):
    """theta from the normal, phi from the azimuth, in [-pi, pi)."""
    phi = np.arctan2(wi[:, 1], wi[:, 0]) - azimuth
    return np.arctan2(np.hypot(wi[:, 0], wi[:, 1]), wi[:, 2]), (phi + pi) % (2 * pi) - pi


def edges_of(values, first, last):
    """Cell borders that share out the values, denser in the tails than a tail's mass asks for."""
    inner = np.unique(np.quantile(values, [0.0005, 0.003, *np.linspace(0.01, 0.99, 25), 0.997, 0.9995]))
    inner = inner[(inner > first + 1e-9) & (inner < last - 1e-9)]
    outer = np.linspace(0, 1, 7)[:-1] ** 2
    below, above = first + (inner[0] - first) * (1 - outer[::-1]), last - (last - inner[-1]) * (1 - outer)
    return np.unique(np.concatenate([[first], below, inner, above, [last]]))


def integrate_cells(pdf, wo, theta, phi, azimuth, n_nodes=10):
    """Integral of the pdf over every cell of theta and phi, by Gauss and Legendre, float64."""
    node, weight = np.polynomial.legendre.leggauss(n_nodes)
    half_t, half_p = np.diff(theta)[:, None] / 2, np.diff(phi)[:, None] / 2
    t = ((theta[:-1] + theta[1:])[:, None] / 2 + half_t * node).reshape(-1, 1)
    p = ((phi[:-1] + phi[1:])[:, None] / 2 + half_p * node).reshape(1, -1) + azimuth
    wi = np.stack(np.broadcast_arrays(np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)), axis=-1)
    density = pdf(vectors([wo], torch.float64), vectors(wi.reshape(-1, 3), torch.float64)).numpy().reshape(wi.shape[:2])
    measure = (half_t * weight).reshape(-1, 1) * (half_p * weight).reshape(1, -1) * np.sin(t)
    shape = len(half_t), n_nodes, len(half_p), n_nodes
    return (density * measure).reshape(shape).sum((1, 3))


def chi_square_p(lobe, wo, pdf, seed=SEEDS[0], bounded=False):
    """p value of 100 000 samples against a density; all samples below the surface are one cell.

    Of a lobe that ends (bounded) the cells end there too, with a margin: no quadrature finds a lobe in a wide cell.
    """
    azimuth = atan2(-wo[1], -wo[0])
    pilot, wi = draw(lobe, wo, 20_000, seed=1), draw(lobe, wo, SAMPLES, seed)
    above = wi[wi[:, 2] > 0]
    limits = [(0, pi / 2), (-pi, pi)]
    if bounded:
        margin = [0.02 * np.ptp(v) for v in angles_about(above, azimuth)]
        seen = [(v.min() - d, v.max() + d) for v, d in zip(angles_about(above, azimuth), margin, strict=True)]
        limits = [(max(a, c), min(b, d)) for (a, b), (c, d) in zip(limits, seen, strict=True)]
    cells = [edges_of(v, *ends) for v, ends in zip(angles_about(pilot[pilot[:, 2] > 0], azimuth), limits, strict=True)]

    counts = np.histogram2d(*angles_about(above, azimuth), bins=cells)[0].ravel()
    expected = SAMPLES * integrate_cells(pdf, wo, *cells, azimuth).ravel()

    counts, expected = np.append(counts, SAMPLES - counts.sum()), np.append(expected, SAMPLES - expected.sum())
    # The smallest cells together, until none that is left and neither their sum expects less than 10.
    order = np.argsort(expected)
    n = max((expected < 10).sum(), np.searchsorted(np.cumsum(expected[order]), 10) + 1)
    merged = [np.append(c[order[n:]], c[order[:n]].sum()) for c in (counts, expected)]
    return chi2.sf(((merged[0] - merged[1]) ** 2 / merged[1]).sum(), len(merged[0]) - 1)


def p_limit(n_cases):
    """One false alarm in a hundred for all cases together, Bonferroni."""
    return 0.01 / n_cases


@dataclass(frozen=True)
class OneQuadrant:
    """A sampler whose azimuth misses three quadrants."""

    lobe: object

    def sample_points(self, u):
        return self.lobe.sample_points(u * torch.tensor([1.0, 0.25]))

    def sample(self, wo, points):
        return self.lobe.sample(wo, points)
