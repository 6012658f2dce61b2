"""Samplers of GGX: densities by quadrature, samples against densities, closed forms along the normal."""

from dataclasses import dataclass
from math import log, pi

import numpy as np
import pytest
import torch

from glossbench.brdf import ggx_samplers
from glossbench.brdf.ggx import GGX, SAMPLERS
from glossbench.brdf.ggx_samplers import BoundedCaps
from glossbench.brdf.kurt import Kurt
from glossbench.directions import Vec3, points_2d
from glossbench.shading.kernels.arguments import classes_of, flatten, rebuild
from oracles.chi_square import chi_square_p, p_limit
from oracles.hemisphere import direction, vectors
from oracles.lobe_checks import check_finite, check_weight

WIDTHS = [(0.1, 0.1), (0.9, 0.3), (0.05, 0.4), (1.0, 1.0)]
VIEWS = [(0.6, 0.8), (1.45, 2.0)]
CAPS = ["visible_normals", "spherical_caps", "bounded_caps"]


def lobe_of(sampler, widths, **rest):
    return GGX(alpha=widths, **rest).reflectance().lobes[0].sampled_by(sampler)


# The integral over half vectors, by their slopes: dh = cos_h^3 dp dq. Arrays in float64; only pdf / D is the library's.


def integrate_density(lobe, widths, wo, k=None, n=600):
    """Integral of D pdf_over_D 4 c dh over visible half vectors, of the cap m'_z >= -k v'_z if k is given.

    Slopes (a_x t cos psi, a_y t sin psi), t = s / (1 - s): midpoint in s and psi. m' is the mirror direction of v', the
    view in the space where the surface is a hemisphere, at the half vector there.
    """
    (a_x, a_y), s = widths, ((np.arange(n) + 0.5) / n)[:, None]
    psi, t = (np.arange(n) + 0.5) / n * 2 * pi, s / (1 - s)
    p, q = a_x * t * np.cos(psi), a_y * t * np.sin(psi)
    cos_h = 1 / np.sqrt(1 + p * p + q * q)
    h = np.stack([p * cos_h, q * cos_h, cos_h], axis=-1).reshape(-1, 3)
    c = h @ wo
    D = 1 / (pi * a_x * a_y * cos_h**4 * (1 + t * t) ** 2)
    over_D = lobe.pdf_over_D(vectors([wo], torch.float64), vectors(h, torch.float64), torch.tensor(c))
    inside = c > 0
    if k is not None:
        v, m = np.array([a_x, a_y, 1]) * wo, h / np.array([a_x, a_y, 1])
        v, m = v / np.linalg.norm(v), m / np.linalg.norm(m, axis=1, keepdims=True)
        inside &= 2 * (m @ v) * m[:, 2] - v[2] >= -k * v[2]
    area = a_x * a_y * t / (1 - s) ** 2 * 2 * pi / n**2 * cos_h**3
    value = D.ravel() * over_D.expand(len(h)).numpy() * 4 * c * area.ravel()
    return float(value[inside].sum())


def bound(widths, wo):
    """Eto and Tokuyoshi 2023, eq. 5, in numbers."""
    a, s = min(1, *widths), 1 + float(np.hypot(wo[0], wo[1]))
    return (1 - a * a) * s * s / (s * s + a * a * wo[2] * wo[2])


@pytest.mark.parametrize("widths", WIDTHS)
@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("sampler", CAPS)
def test_density_of_half_vectors_integrates_to_one(sampler, widths, view):
    wo = direction(*view)

    total = integrate_density(lobe_of(sampler, widths), widths, wo, bound(widths, wo) if "bounded" in sampler else None)

    # Measured 1e-7 for whole caps, and 3.5e-4 for bounded ones, whose edge the midpoints cut.
    assert total == pytest.approx(1, abs=1e-3 if "bounded" in sampler else 1e-6)


@pytest.mark.parametrize("fault", ["widths swapped", "the whole cap"])
def test_the_integral_notices(fault):
    widths, wo = (0.9, 0.3), direction(1.1, 0.1)
    lobe = lobe_of("bounded_caps", widths[::-1] if fault == "widths swapped" else widths)

    total = integrate_density(lobe, widths, wo, 1.0 if fault == "the whole cap" else bound(widths, wo))

    assert total != pytest.approx(1, abs=1e-2)


# Samples against the density.

CASES = [(s, w, v) for s in ("normals", "spherical_caps", "bounded_caps") for w in WIDTHS[1:] for v in VIEWS]


@pytest.mark.parametrize(("sampler", "widths", "view"), CASES)
def test_samples_fall_as_the_density_says(sampler, widths, view):
    lobe = lobe_of(sampler, widths)

    assert chi_square_p(lobe, direction(*view), lobe.pdf) > p_limit(len(CASES))


@dataclass(frozen=True)
class Unbounded(BoundedCaps):
    """Planted: the bound is in the density, but not in the samples."""

    def half_vectors(self, widths, wo, points):
        return ggx_samplers.SphericalCaps().half_vectors(widths, wo, points)


@pytest.mark.parametrize("planted", ["normals", "unbounded"])
def test_chi_square_notices_the_density_of_another_sampler(planted, monkeypatch):
    widths, wo = (0.9, 0.3), direction(1.45, 2.0)
    monkeypatch.setitem(SAMPLERS, "visible_normals", Unbounded())
    lobe = lobe_of("normals" if planted == "normals" else "visible_normals", widths)
    density = lobe_of("spherical_caps", widths).pdf if planted == "normals" else lobe.pdf

    assert chi_square_p(lobe, wo, density) < p_limit(len(CASES))


@pytest.mark.parametrize("widths", WIDTHS)
@pytest.mark.parametrize("sampler", SAMPLERS)
def test_weight_of_a_sample_is_f_cos_over_pdf(sampler, widths):
    check_weight(lobe_of(sampler, widths, f0=0.2))


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_samples_at_grazing_views_are_finite(sampler, monkeypatch):
    material = GGX(alpha=(0.02, 0.7))
    reflectance = material.reflectance().sampled_by(sampler)
    monkeypatch.setattr(GGX, "reflectance", lambda self: reflectance)

    check_finite(material)


# Along the normal, isotropic: closed forms.

UP = Vec3(*torch.tensor([[0.0], [0.0], [1.0]]).double())


@pytest.mark.parametrize("alpha", [0.05, 0.3, 1.0])
def test_along_the_normal_densities_are_a_quarter_of_D_and_bounded_ones_more(alpha):
    wi = vectors([direction(t, 0.4) for t in np.linspace(0, 1.5, 20)], torch.float64)
    lobes = {sampler: lobe_of(sampler, (alpha, alpha)) for sampler in SAMPLERS}
    h = Vec3(*(c / torch.sqrt(2 + 2 * wi.z) for c in (wi.x, wi.y, wi.z + 1)))
    quarter = lobes["normals"].D(h) / 4
    a = torch.tensor(alpha).double()

    found = {sampler: lobe.pdf(UP, wi) for sampler, lobe in lobes.items()}

    for sampler in ("visible_normals", "spherical_caps", "normals"):
        torch.testing.assert_close(found[sampler], quarter, rtol=1e-12, atol=0)
    torch.testing.assert_close(found["bounded_caps"], quarter * (1 + a * a), rtol=1e-7, atol=0)  # the width is float32


@pytest.mark.parametrize("alpha", [0.3, 1.0])
def test_along_the_normal_weights_are_shadowing_over_masking(alpha):
    """G1(wo) = 1 there; G2 = 2 cos_i / (cos_i + sqrt(alpha^2 + (1 - alpha^2) cos_i^2))."""
    u = points_2d(200, "r2").double()

    for sampler in SAMPLERS:
        lobe = lobe_of(sampler, (alpha, alpha))
        wi, _, (weight,) = lobe.sample(UP, lobe.sample_points(u))
        z, weight = wi.z[wi.z > 0], weight[wi.z > 0]
        g2 = 2 * z / (z + torch.sqrt(alpha**2 + (1 - alpha**2) * z * z))
        share = 1 + alpha**2 if sampler == "bounded_caps" else 1

        torch.testing.assert_close(weight, g2 / share, rtol=1e-6, atol=0)  # the width is float32


def mean_cos2(alpha, u_max=1.0):
    """Mean of cos_h^2 = (1 - u) / (1 + b u), b = alpha^2 - 1, over u in [0, u_max]: an elementary integral."""
    b = alpha**2 - 1
    return (-u_max / b + (1 + b) / b**2 * log(1 + b * u_max)) / u_max


@pytest.mark.parametrize("alpha", [0.1, 0.5])
@pytest.mark.parametrize("sampler", SAMPLERS)
def test_mean_square_cosine_along_the_normal_has_a_closed_form(sampler, alpha):
    """A bounded cap ends at u = 1 / (1 + alpha^2), where cos_h^2 = 1/2 and wi is on the horizon."""
    lobe = lobe_of(sampler, (alpha, alpha))

    wi = lobe.sample(UP, lobe.sample_points(points_2d(4096).double())).wi

    cos2 = float((1 + wi.z).mean() / 2)
    expected = mean_cos2(alpha, 1 / (1 + alpha**2) if sampler == "bounded_caps" else 1.0)
    assert cos2 == pytest.approx(expected, abs=1e-6)  # measured 2.5e-7, of the points and of a float32 width
    assert abs(expected - mean_cos2(alpha, 1.0 if sampler == "bounded_caps" else 1 / (1 + alpha**2))) > 1e-3


@pytest.mark.parametrize("alpha", [0.2, 1.0])
def test_no_bounded_sample_along_the_normal_is_below_the_surface(alpha):
    below = {}
    for sampler in SAMPLERS:
        lobe = lobe_of(sampler, (alpha, alpha))
        wi = lobe.sample(UP, lobe.sample_points(points_2d(4096).double())).wi
        below[sampler] = float((wi.z < -1e-7).double().mean())

    assert below.pop("bounded_caps") == 0
    # 1 - 1 / (1 + alpha^2): half of the samples at alpha 1.
    assert list(below.values()) == pytest.approx([alpha**2 / (1 + alpha**2)] * 3, abs=1e-3)


# Materials.


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_a_kernel_takes_a_lobe_apart_and_puts_it_together_with_its_sampler(sampler):
    lobe = lobe_of(sampler, (0.1, 0.4))

    form, tensors = flatten(lobe)

    assert rebuild(form, tensors).sampler == lobe.sampler
    assert type(lobe.sampler) in set(classes_of(form))  # so its source is in the key of a compiled kernel


def test_beckmann_lobes_have_normals_but_no_visible_normals():
    reflectance = Kurt(m=0.2).reflectance()

    assert reflectance.explain_sampler("normals") is None
    assert reflectance.explain_sampler("visible_normals") == (
        "a lobe of the material has no sampler 'visible_normals', it has own, normals"
    )
