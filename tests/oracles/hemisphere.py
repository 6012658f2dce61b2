"""Directions over a surface, as arrays in float64 and as vectors of the project, and values compared there."""

from math import cos, pi, sin

import numpy as np
import torch

from glossbench.directions import Vec3

WIDTHS = [(0.02, 0.02), (0.1, 0.1), (0.5, 0.5), (0.9, 0.3), (0.05, 0.4), (1.0, 1.0)]
VIEWS = [(0.0, 0.0), (0.6, 0.8), (1.1, 4.0), (1.45, 2.0), (1.55, 0.3)]  # theta, phi; the last is 89 degrees


def direction(theta, phi):
    return np.array([sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta)])


def vectors(values, dtype=torch.float32):
    return Vec3(*torch.tensor(np.asarray(values), dtype=dtype).T)


def random_hemisphere(n, seed):
    rng = np.random.default_rng(seed)
    z, phi = rng.uniform(0.05, 1, n), rng.uniform(0, 2 * pi, n)
    return np.stack([np.sqrt(1 - z * z) * np.cos(phi), np.sqrt(1 - z * z) * np.sin(phi), z], axis=1)


def half_of(wo, wi):
    h = torch.stack([o + i for o, i in zip(wo, wi, strict=True)])
    h = h / h.norm(dim=0)
    return h, wo.x * h[0] + wo.y * h[1] + wo.z * h[2]


def check_values(f, expected, relative):
    f, expected = f.double().numpy(), np.array(expected)
    normal = expected > 1e-30  # below that float32 has no seven digits
    np.testing.assert_allclose(f[normal], expected[normal], rtol=relative)
    assert (f[~normal] < 1e-29).all()
