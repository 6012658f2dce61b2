"""Cook and Torrance's model: values by hand, energy with either factor, and every method on it."""

from dataclasses import dataclass, replace
from math import pi, radians, sqrt

import numpy as np
import pytest
import torch

from glossbench.brdf.cook_torrance import CookTorrance
from glossbench.errors import InputError
from oracles.chi_square import SEEDS, OneQuadrant, chi_square_p, p_limit
from oracles.hemisphere import VIEWS, WIDTHS, check_values, direction, half_of, random_hemisphere, vectors
from oracles.lobe_checks import check_finite, check_reciprocity, check_weight
from oracles.method_errors import check_methods, limits, method_errors
from oracles.quadrature import albedo_by_hand, over_slopes, pdf_in_numpy, visible_share
from oracles.texel_sums import check_sum, extrapolated, lights


def lobe_of(widths, **rest):
    return CookTorrance(m=widths, **rest).reflectance().lobes[0]


# The sampler.

CHI_CASES = [
    (widths, view, seed)
    for widths, view in (((0.2, 0.2), VIEWS[1]), ((0.3, 0.3), VIEWS[4]), ((0.1, 0.5), VIEWS[3]))
    for seed in SEEDS
]


@pytest.mark.parametrize(("widths", "view", "seed"), CHI_CASES)
def test_samples_fall_as_the_density_says(widths, view, seed):
    lobe = lobe_of(widths)

    p = chi_square_p(lobe, direction(*view), lobe.pdf, seed)

    assert p > p_limit(len(CHI_CASES))


FAULTS = {
    "missing quadrants": lambda lobe: (OneQuadrant(lobe), lobe.pdf),
    "squared width": lambda lobe: (lobe, lobe_of((0.1**2, 0.5**2)).pdf),
    "dropped cosine": lambda lobe: (lobe, lambda o, i: lobe.pdf(o, i) / half_of(o, i)[0][2]),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_chi_square_notices_a_planted_fault(fault):
    sampler, pdf = FAULTS[fault](lobe_of((0.1, 0.5)))

    p = chi_square_p(sampler, direction(0.6, 0.8), pdf, SEEDS[0])

    assert p < p_limit(len(CHI_CASES))


@pytest.mark.parametrize("view", VIEWS)
def test_density_integrates_to_the_visible_share(view):
    wo, widths = direction(*view), (0.5, 0.2)

    total = over_slopes(pdf_in_numpy(lobe_of(widths)), wo, widths)

    # Measured: 3e-5, where the horizon cuts the cells of both counts.
    assert total == pytest.approx(visible_share(wo, widths), abs=1e-4)


@pytest.mark.parametrize("widths", WIDTHS)
def test_weight_of_a_sample_is_f_cos_over_pdf(widths):
    check_weight(lobe_of(widths, f0=(0.9, 0.5, 0.1), ks=0.7))


# Values.


def cook_torrance_by_hand(wo, wi, m_x, m_y, f0=1.0, divisor=4.0, shadowing=True):
    """F D G / (divisor cos cos) by angles, c as the cosine of half the angle between the directions."""
    h = wo + wi
    h = h / np.linalg.norm(h, axis=-1, keepdims=True)
    alpha, phi = np.arccos(np.clip(h[..., 2], -1, 1)), np.arctan2(h[..., 1], h[..., 0])
    c = np.cos(np.arccos(np.clip((wo * wi).sum(-1), -1, 1)) / 2)
    slope2 = np.tan(alpha) ** 2 * (np.cos(phi) ** 2 / m_x**2 + np.sin(phi) ** 2 / m_y**2)
    D = np.exp(-slope2) / (pi * m_x * m_y * np.cos(alpha) ** 4)
    cos_o, cos_i = wo[..., 2], wi[..., 2]
    G = np.minimum(1, np.minimum(2 * np.cos(alpha) * cos_o / c, 2 * np.cos(alpha) * cos_i / c)) if shadowing else 1
    return (f0 + (1 - f0) * (1 - c) ** 5) * D * G / (divisor * cos_o * cos_i)


@pytest.mark.parametrize("widths", WIDTHS[1:])
@pytest.mark.parametrize(("factor", "divisor"), [("1/4", 4), ("1/pi", pi)])
def test_cook_torrance_is_its_formula_written_out_in_angles(widths, factor, divisor):
    wo, wi = random_hemisphere(300, 1), random_hemisphere(300, 2)

    f = CookTorrance(m=widths, f0=0.3, factor=factor).f(vectors(wo), vectors(wi))[0]

    # Float32, measured: 2.2e-5, where the exponent is 69 and its last digit counts.
    check_values(f, cook_torrance_by_hand(wo, wi, *widths, 0.3, divisor), 5e-5)


@pytest.mark.parametrize(
    ("fault", "options"),
    [
        ("squared width", {"m_x": 0.09, "m_y": 0.81}),
        ("swapped widths", {"m_x": 0.9, "m_y": 0.3}),
        ("the paper's factor", {"divisor": pi}),
        ("no shadowing", {"shadowing": False}),
        ("no Fresnel", {"f0": 1.0}),
    ],
)
def test_formula_in_angles_notices(fault, options):
    wo, wi = random_hemisphere(300, 1), random_hemisphere(300, 2)

    f = CookTorrance(m=(0.3, 0.9), f0=0.3).f(vectors(wo), vectors(wi))[0]

    with pytest.raises(AssertionError):
        check_values(f, cook_torrance_by_hand(wo, wi, **({"m_x": 0.3, "m_y": 0.9, "f0": 0.3} | options)), 5e-5)


def test_half_of_a_groove_is_dark_where_the_light_grazes():
    """wo = n, cos_i = cos 80: h at 40 degrees, c = cos_h, G = 2 cos_i = 0.347; f = D G / (4 cos_i) = D / 2."""
    wo, wi = vectors([[0.0, 0.0, 1.0]]), vectors([direction(radians(80), 0.0)])

    f = CookTorrance(m=0.7).f(wo, wi)[0].item()

    slope, cos_h = np.tan(radians(40)) / 0.7, np.cos(radians(40))
    assert f == pytest.approx(np.exp(-(slope**2)) / (pi * 0.49 * cos_h**4) / 2, rel=1e-6)


@pytest.mark.parametrize("widths", WIDTHS[1:])
def test_light_and_viewer_may_be_exchanged(widths):
    check_reciprocity(CookTorrance(m=widths, f0=0.4, kd=0.1))


# Energy.


@pytest.mark.parametrize("widths", WIDTHS)
@pytest.mark.parametrize("view", VIEWS)
def test_albedo_is_the_integral_over_slopes(widths, view):
    wo = direction(*view)

    albedo = CookTorrance(m=widths, f0=0.2).albedo(vectors([wo]), n_samples=1 << 14)[0]

    expected = albedo_by_hand(lambda o, i: cook_torrance_by_hand(o, i, *widths, 0.2), wo, widths)
    # Measured: 1.2e-4 at worst, m = 1 at 89 degrees.
    assert albedo.tolist() == pytest.approx([expected] * 3, rel=3e-4)


@pytest.mark.parametrize("widths", WIDTHS)
def test_returns_no_more_light_than_it_receives(widths):
    views = [direction(radians(t), phi) for t in (0, 30, 60, 75, 85, 89, 89.9) for phi in (0.0, 0.8, 1.5)]

    albedo = CookTorrance(m=widths).albedo(vectors(views), 1 << 14)

    # Where no facet is shadowed it is 1, and 16384 points may be off: measured 4.5e-6, m = 0.02.
    assert albedo.max() <= 1 + 1e-5


def test_with_the_printed_factor_smooth_metal_returns_four_pi_ths_of_the_light():
    """A flat field of facets: G = 1, f cos_i / pdf = 4 / pi."""
    albedo = CookTorrance(m=0.01, factor="1/pi").albedo(vectors([direction(0.5, 0.0)]))[0, 0].item()

    # Measured: 2.3e-7.
    assert albedo == pytest.approx(4 / pi, rel=1e-6)


@pytest.mark.parametrize(
    ("fault", "options"),
    [("no shadowing", {"shadowing": False}), ("squared width", {"m_x": 0.25, "m_y": 0.25}), ("1/pi", {"divisor": pi})],
)
def test_albedo_check_notices(fault, options):
    wo = direction(1.1, 4.0)
    options = {"m_x": 0.5, "m_y": 0.5} | options
    wrong = albedo_by_hand(lambda o, i: cook_torrance_by_hand(o, i, **options), wo, (0.5, 0.5))

    albedo = CookTorrance(m=0.5).albedo(vectors([wo]), 1 << 14)[0, 0].item()

    assert albedo != pytest.approx(wrong, rel=1e-2)


# Hard directions, fusion, methods, the reference.


@pytest.mark.parametrize("widths", [(1e-3, 1e-3), (0.1, 0.1), (1.0, 1e-3), (1.0, 1.0)])
def test_values_are_finite_at_grazing_angles(widths):
    check_finite(CookTorrance(m=widths))


@pytest.mark.parametrize(
    ("material", "bounds"),
    [
        # Measured: 0.0051, 0.0048, 0.0018, 0.0073.
        (CookTorrance(m=0.2, f0=(0.9, 0.6, 0.3)), limits(0.008, 0.008, 0.003, 0.012)),
        # 0.0173, 0.0048, 0.0017, 0.0044: regular sampling is cut off at xi, most where the horizon cuts too.
        (CookTorrance(m=(0.4, 0.15), kd=0.2), limits(0.025, 0.008, 0.003, 0.007)),
    ],
    ids=["isotropic", "anisotropic"],
)
def test_every_method_comes_near_the_reference(material, bounds):
    errors = method_errors(material)

    check_methods(errors, bounds)


@dataclass(frozen=True)
class ByHand:
    """What is summed over texels."""

    widths: tuple[float, float]
    kd: float = 0.0
    width_factor: float = 1.0

    def material(self):
        return CookTorrance(m=self.widths, f0=(0.9, 0.6, 0.2), kd=self.kd)

    def f(self, wo, wi):
        widths = [w * self.width_factor for w in self.widths]
        value = [cook_torrance_by_hand(wo, wi, *widths, f0) for f0 in (0.9, 0.6, 0.2)]
        return self.kd / pi + np.stack(value, axis=1)


BY_HAND = {"isotropic": ByHand((0.2, 0.2), kd=0.3), "anisotropic": ByHand((0.4, 0.15))}


@pytest.mark.parametrize("name", BY_HAND)
def test_reference_is_the_exact_sum_over_texels(name):
    truth = extrapolated(BY_HAND[name], lights()["rough"])

    check_sum(truth, BY_HAND[name].material())


def test_exact_sum_notices_a_width_squared_by_2_percent():
    wrong = extrapolated(replace(BY_HAND["isotropic"], width_factor=sqrt(1.02)), lights()["rough"])

    with pytest.raises(AssertionError):
        check_sum(wrong, BY_HAND["isotropic"].material())


def test_unknown_factor_is_refused():
    with pytest.raises(InputError, match=r"cook_torrance\.factor must be '1/4' or '1/pi', got '1/2'"):
        CookTorrance(factor="1/2")


def test_colours_of_f0_and_ks_are_kept():
    up = vectors([[0.0, 0.0, 1.0]])

    f = torch.stack(CookTorrance(m=0.5, f0=(0.9, 0.5, 0.1), ks=(1.0, 0.5, 0.25)).f(up, up))

    assert (f[:, 0] * pi).tolist() == pytest.approx([0.9, 0.25, 0.025], rel=1e-6)
