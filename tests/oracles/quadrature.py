"""Integrals over the hemisphere of light directions, by the slopes of half vectors."""

from math import pi

import numpy as np
import torch

from oracles.hemisphere import vectors


def over_slopes(f, wo, widths, n=512):
    """Integral of f(wo, wi) over wi above the surface, by half-vector slopes: dwi = 4 c dh = 4 c cos_h^3 dp dq.

    Slopes (w_x t cos psi, w_y t sin psi), t = s / (1 - s): midpoint in s and psi, of arrays in float64.
    """
    s, psi = ((np.arange(n) + 0.5) / n)[:, None], ((np.arange(n) + 0.5) / n * 2 * pi)[None]
    t = s / (1 - s)
    area = widths[0] * widths[1] * t / (1 - s) ** 2 * (2 * pi / n**2)
    p, q = widths[0] * t * np.cos(psi), widths[1] * t * np.sin(psi)
    h = np.stack([p, q, np.ones_like(p)], axis=-1) / np.sqrt(1 + p * p + q * q)[..., None]
    c = h @ wo
    wi = 2 * c[..., None] * h - wo
    seen = (c > 0) & (wi[..., 2] > 0)
    value = f(wo, np.where(seen[..., None], wi, [0.0, 0.0, 1.0]))
    return float(np.where(seen, value * 4 * c * h[..., 2] ** 3 * area, 0).sum())


def albedo_by_hand(f, wo, widths, n=512):
    """Integral of f cos_i."""
    return over_slopes(lambda o, i: f(o, i) * i[..., 2], wo, widths, n)


def pdf_in_numpy(lobe):
    def pdf(wo, wi):
        density = lobe.pdf(vectors([wo], torch.float64), vectors(wi.reshape(-1, 3), torch.float64))
        return density.numpy().reshape(wi.shape[:-1])

    return pdf


def visible_share(wo, widths, n=2048):
    """Of half vectors with Gaussian slopes, those that mirror wo above the surface; equal-probability midpoints."""
    u = (np.arange(n) + 0.5) / n
    r, psi = np.sqrt(-np.log(u))[:, None], (2 * pi * u)[None]
    p, q = widths[0] * r * np.cos(psi), widths[1] * r * np.sin(psi)
    cos_h = 1 / np.sqrt(1 + p * p + q * q)
    c = (wo[0] * p + wo[1] * q + wo[2]) * cos_h
    return float(((c > 0) & (2 * c * cos_h > wo[2])).mean())
