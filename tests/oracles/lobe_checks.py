"""Checks of every lobe: weights, reciprocity, finite values."""

from math import pi, radians

import numpy as np
import torch

from glossbench.directions import Vec3, points_2d
from oracles.hemisphere import direction, random_hemisphere, vectors


def check_weight(lobe):
    """Where cos_i > 1e-3: below, f is bounded."""
    wo = Vec3(*(c[:, None] for c in vectors(random_hemisphere(40, 4), torch.float64)))

    wi, pdf, weight = lobe.sample(wo, lobe.sample_points(points_2d(500, "random", 5).double()))
    f, density = lobe.f_and_pdf(wo, wi)
    seen = wi.z > 1e-3

    # Measured in float64: 2e-13, the half vector of wo and wi against the one that was drawn.
    torch.testing.assert_close(pdf.expand_as(wi.z)[seen], density[seen], rtol=1e-12, atol=0)
    for channel, value in zip(weight, f, strict=True):
        # A weight at the edge of a lump may be 1e-11, with so many digits fewer.
        found = channel.double().expand_as(wi.z)[seen]
        torch.testing.assert_close(found, (value * wi.z / density)[seen], rtol=1e-12, atol=1e-15)


def check_reciprocity(material):
    a, b = (vectors(random_hemisphere(2000, seed), torch.float64) for seed in (6, 7))

    there, back = material.f(a, b)[0], material.f(b, a)[0]

    # Measured: 2e-13.
    torch.testing.assert_close(there, back, rtol=1e-12, atol=0)


def grazing_directions():
    """(24, 3): at 0, 60, 89.9 and 89.999 degrees."""
    return np.array([direction(radians(t), phi) for t in (0, 60, 89.9, 89.999) for phi in np.arange(6) * pi / 3])


def check_finite(material):
    d = grazing_directions()
    wo, wi = (Vec3(*c) for c in (vectors(d), vectors(d)))
    column = Vec3(*(c[:, None] for c in wo))
    (lobe,) = material.reflectance().lobes

    f, density = lobe.f_and_pdf(column, Vec3(*(c[None] for c in wi)))
    sample = lobe.sample(column, lobe.sample_points(points_2d(4096, "random", 3)))

    for values in (*f, density, *sample.weight, sample.pdf):
        assert torch.isfinite(values).all()
        assert (values >= 0).all()
    assert (sample.pdf > 0).all()
    assert all((w.expand_as(sample.wi.z)[sample.wi.z <= 0] == 0).all() for w in sample.weight)
