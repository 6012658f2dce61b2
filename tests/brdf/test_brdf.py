"""Reflectance models: values by hand, samplers against densities, energy against independent quadrature."""

from math import acos, atan2, cos, exp, pi, sin, sqrt, tan

import numpy as np
import pytest
import torch
from scipy.special import erfcx

from glossbench.brdf.ggx import GGX
from glossbench.brdf.kurt import Kurt
from glossbench.directions import Vec3, points_2d
from oracles.chi_square import chi_square_p
from oracles.hemisphere import VIEWS, WIDTHS, check_values, direction, half_of, random_hemisphere, vectors

MODELS = {
    "kurt": lambda widths, **rest: Kurt(m=widths, **rest),
    "ggx": lambda widths, **rest: GGX(alpha=widths, **rest),
}
CASES = [(model, widths, view) for model in MODELS for widths in WIDTHS for view in VIEWS]
# Float32, measured: 2.3e-5, where the exponent is 69 and its last digit counts; 1.4e-6 without one.
KURT_ERROR, GGX_ERROR = 5e-5, 4e-6


# The models by hand in float64: angles for numbers, components for arrays. None calls glossbench.


def kurt_by_hand(wo, wi, m_x, m_y, f0=1.0, shadowing=0.0):
    """Luksch et al. 2014 eq. 2 to 5, by the angles of the half vector."""
    h = (wo + wi) / np.linalg.norm(wo + wi)
    theta, phi, u = acos(h[2]), atan2(h[1], h[0]), float(wo @ h)
    q = exp(-(tan(theta) ** 2) * (cos(phi) ** 2 / m_x**2 + sin(phi) ** 2 / m_y**2))
    D = q / (pi * m_x * m_y * cos(theta) ** 4)
    fresnel = f0 + (1 - f0) * (1 - u) ** 5
    return fresnel * D / (4 * u * (wi[2] * wo[2]) ** shadowing)


def ggx_by_hand(wo, wi, a_x, a_y, f0=1.0):
    """Heitz 2014: D of eq. 85, Lambda of eq. 72 with the projected width of eq. 80, G2 of eq. 99."""
    h = (wo + wi) / np.linalg.norm(wo + wi)
    theta, phi, u = acos(h[2]), atan2(h[1], h[0]), float(wo @ h)
    stretched = tan(theta) ** 2 * (cos(phi) ** 2 / a_x**2 + sin(phi) ** 2 / a_y**2)
    D = 1 / (pi * a_x * a_y * cos(theta) ** 4 * (1 + stretched) ** 2)

    def big_lambda(v):
        angle, azimuth = acos(v[2]), atan2(v[1], v[0])
        alpha = sqrt(cos(azimuth) ** 2 * a_x**2 + sin(azimuth) ** 2 * a_y**2)
        a = 1 / (alpha * tan(angle)) if angle > 0 else float("inf")
        return (-1 + sqrt(1 + 1 / a**2)) / 2

    fresnel = f0 + (1 - f0) * (1 - u) ** 5
    return fresnel * D / ((1 + big_lambda(wo) + big_lambda(wi)) * 4 * wo[2] * wi[2])


def albedo_by_slopes(model, widths, wo, f0=1.0, shadowing=0.0, n=256, cosine=True):
    """Integral of f cos_i dwi over half-vector slopes, dwi = 4 c dh = 4 c cos_h^3 dp dq.

    Slopes (w_x t cos psi, w_y t sin psi), t = s / (1 - s): midpoint in s and psi, of arrays in float64.
    """
    w_x, w_y = widths
    s, psi = ((np.arange(n) + 0.5) / n)[:, None], ((np.arange(n) + 0.5) / n * 2 * pi)[None]
    t = s / (1 - s)
    area = w_x * w_y * t / (1 - s) ** 2 * (2 * pi / n**2)
    p, r = w_x * t * np.cos(psi), w_y * t * np.sin(psi)
    cos_h = 1 / np.sqrt(1 + p * p + r * r)
    c = (wo[0] * p + wo[1] * r + wo[2]) * cos_h
    wi = [2 * c * p * cos_h - wo[0], 2 * c * r * cos_h - wo[1], 2 * c * cos_h - wo[2]]
    seen = (c > 0) & (wi[2] > 0)
    c, cos_i = np.where(seen, c, 1), np.where(seen, wi[2], 1)
    if model == "kurt":
        D = np.exp(-t * t) / (pi * w_x * w_y * cos_h**4)
        f = D / (4 * c * (cos_i * wo[2]) ** shadowing)
    else:
        D = 1 / (pi * w_x * w_y * cos_h**4 * (1 + t * t) ** 2)
        tails = [
            (np.sqrt(1 + ((w_x * v[0]) ** 2 + (w_y * v[1]) ** 2) / z**2) - 1) / 2 for v, z in ((wo, wo[2]), (wi, cos_i))
        ]
        f = D / (4 * cos_i * wo[2] * (1 + tails[0] + tails[1]))
    f = f * (f0 + (1 - f0) * (1 - c) ** 5)
    return float(np.where(seen, f * (cos_i if cosine else 1) * 4 * c * cos_h**3 * area, 0).sum())


def kurt_albedo_at_normal(m):
    """Albedo of an isotropic Kurt lobe, F = 1, shadowing = 0, seen along the normal, in closed form.

    With s = 1 / cos^2(theta_h): e^(1/m^2) / m^2 times the integral over s from 1 to 2 of
    e^(-s/m^2) (2 - s) / sqrt(s).
    """
    tail = exp(-1 / m**2)
    return (2 - m * m / 2) * sqrt(pi) / m * (erfcx(1 / m) - tail * erfcx(sqrt(2) / m)) + sqrt(2) * tail - 1


def lobe_of(model, widths, **rest):
    return MODELS[model](widths, **rest).reflectance().lobes[0]


# The sampler against its density.


# One false alarm in a hundred for all cases together, Sidak.
P_LIMIT = 1 - 0.99 ** (1 / len(CASES))


@pytest.mark.parametrize(("model", "widths", "view"), CASES)
def test_samples_fall_as_the_density_says(model, widths, view):
    lobe = lobe_of(model, widths)

    p = chi_square_p(lobe, direction(*view), lobe.pdf)

    # Cells change by at most 6e-5 from 10 to 20 nodes, 2e-4 in sum: 20 of 100 000 samples.
    assert p > P_LIMIT


PLANTED_DENSITIES = {
    "alpha squared": lambda model, w, lobe: lobe_of(model, (w[0] ** 2, w[1] ** 2)).pdf,
    "m_x and m_y swapped": lambda model, w, lobe: lobe_of(model, w[::-1]).pdf,
    "no Jacobian 1 / (4 c)": lambda model, w, lobe: lambda o, i: lobe.pdf(o, i) * 4 * half_of(o, i)[1],
    "cosine of h dropped": lambda model, w, lobe: lambda o, i: lobe.pdf(o, i) / half_of(o, i)[0][2],
}


@pytest.mark.parametrize("fault", PLANTED_DENSITIES)
@pytest.mark.parametrize("model", MODELS)
def test_chi_square_notices_a_planted_fault_of_the_density(model, fault):
    lobe, widths = lobe_of(model, (0.05, 0.4)), (0.05, 0.4)

    p = chi_square_p(lobe, direction(0.6, 0.8), PLANTED_DENSITIES[fault](model, widths, lobe))

    assert p < P_LIMIT


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("widths", WIDTHS)
def test_density_and_weight_are_zero_for_samples_below_the_surface(model, widths):
    lobe, wo = lobe_of(model, widths), vectors([direction(1.55, 0.3)])

    wi, pdf, weight = lobe.sample(wo, lobe.sample_points(points_2d(20_000, "random", 3)))
    below = wi.z <= 0

    assert below.any()
    assert (lobe.pdf(wo, wi)[below] == 0).all()
    assert (lobe.f(wo, wi)[0].expand_as(wi.z)[below] == 0).all()
    assert (weight[0][below] == 0).all()
    assert ((pdf > 0) & torch.isfinite(pdf)).all()


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("widths", WIDTHS)
def test_weight_of_a_sample_is_f_cos_over_pdf(model, widths):
    lobe = lobe_of(model, widths, f0=0.2)
    wo = Vec3(*(c[:, None] for c in vectors(random_hemisphere(40, 4), torch.float64)))

    wi, pdf, (weight,) = lobe.sample(wo, lobe.sample_points(points_2d(500, "random", 5).double()))
    (f,), density = lobe.f_and_pdf(wo, wi)
    seen = wi.z > 1e-3

    # Measured in float64: 4e-14, the half vector of wo and wi against the one that was drawn.
    torch.testing.assert_close(pdf[seen], density[seen], rtol=1e-12, atol=0)
    torch.testing.assert_close(weight[seen], (f * wi.z / density)[seen], rtol=1e-12, atol=0)


# Values.


@pytest.mark.parametrize("widths", WIDTHS[1:])
@pytest.mark.parametrize("shadowing", [0.0, 0.3, 1.0])
def test_kurt_is_its_formula_written_out_in_angles(widths, shadowing):
    wo, wi = random_hemisphere(300, 1), random_hemisphere(300, 2)

    f = Kurt(m=widths, f0=0.3, shadowing=shadowing).f(vectors(wo), vectors(wi))[0]

    expected = [kurt_by_hand(o, i, *widths, 0.3, shadowing) for o, i in zip(wo, wi, strict=True)]
    check_values(f, expected, KURT_ERROR)


@pytest.mark.parametrize("widths", WIDTHS[1:])
def test_ggx_is_its_formula_written_out_in_angles(widths):
    wo, wi = random_hemisphere(300, 1), random_hemisphere(300, 2)

    f = GGX(alpha=widths, f0=0.3).f(vectors(wo), vectors(wi))[0]

    expected = [ggx_by_hand(o, i, *widths, 0.3) for o, i in zip(wo, wi, strict=True)]
    check_values(f, expected, GGX_ERROR)


@pytest.mark.parametrize("model", MODELS)
def test_formula_in_angles_notices_swapped_widths(model):
    wo, wi = random_hemisphere(300, 1), random_hemisphere(300, 2)
    by_hand = kurt_by_hand if model == "kurt" else ggx_by_hand

    f = MODELS[model]((0.3, 0.9)).f(vectors(wo), vectors(wi))[0]

    with pytest.raises(AssertionError):
        check_values(f, [by_hand(o, i, 0.9, 0.3) for o, i in zip(wo, wi, strict=True)], KURT_ERROR)


def test_value_along_the_normal_is_f0_over_four_pi_widths():
    """h = n: D = 1 / (pi w_x w_y), c = cos_i = cos_o = 1, no shadowing."""
    up = vectors([[0.0, 0.0, 1.0]])

    kurt = Kurt(m=(0.2, 0.05), f0=0.5, shadowing=0.7).f(up, up)[0]
    ggx = GGX(alpha=(0.2, 0.05), f0=0.5).f(up, up)[0]

    assert kurt.item() == pytest.approx(0.5 / (4 * pi * 0.01), rel=1e-6)
    assert ggx.item() == pytest.approx(0.5 / (4 * pi * 0.01), rel=1e-6)


@pytest.mark.parametrize("widths", WIDTHS)
@pytest.mark.parametrize("model", MODELS)
def test_microfacet_area_projects_to_one(model, widths):
    """Integral of D cos_h over the hemisphere of h, Gauss and Legendre in theta, midpoint in phi."""
    node, weight = np.polynomial.legendre.leggauss(600)
    theta, phi = (node + 1) * pi / 4, (np.arange(512) + 0.5) / 512 * 2 * pi
    t, p = theta[:, None], phi[None]
    h = np.stack(np.broadcast_arrays(np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)), axis=-1)

    D = lobe_of(model, widths).D(vectors(h.reshape(-1, 3), torch.float64)).numpy().reshape(600, 512)

    projected = (D * np.cos(t) * np.sin(t) * (weight * pi / 4)[:, None]).sum() * 2 * pi / 512
    # Widths are float32: 3e-8 of each.
    assert projected == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("widths", WIDTHS[1:])
@pytest.mark.parametrize("model", MODELS)
def test_light_and_viewer_may_be_exchanged(model, widths):
    a, b = (vectors(random_hemisphere(2000, seed), torch.float64) for seed in (6, 7))
    material = MODELS[model](widths, f0=0.4, kd=0.1)

    there, back = material.f(a, b)[0], material.f(b, a)[0]

    torch.testing.assert_close(there, back, rtol=1e-12, atol=0)


@pytest.mark.parametrize("material", [Kurt(m=0.3, kd=0.5), GGX(alpha=0.3, kd=0.5)], ids=["kurt", "ggx"])
def test_value_is_zero_below_the_surface(material):
    above = vectors(random_hemisphere(500, 8))
    below = Vec3(above.x, above.y, -above.z)

    values = [material.f(above, below), material.f(below, above), material.f(below, below)]

    assert (material.f(above, above)[0] > 0).all()
    assert all((channel == 0).all() for f in values for channel in f)


# Energy.


@pytest.mark.parametrize(("model", "widths", "view"), CASES)
def test_albedo_is_the_integral_over_slopes(model, widths, view):
    wo = direction(*view)
    coarse, fine = (albedo_by_slopes(model, widths, wo, n=n) for n in (256, 512))

    albedo = MODELS[model](widths).albedo(vectors([wo]))[0]

    # Quadrature, measured: 4e-4 at worst, GGX 0.1 at 89 degrees, where the horizon cuts the lobe.
    assert coarse == pytest.approx(fine, rel=5e-4)
    # 4096 Hammersley points, measured: 6e-4 at worst, Kurt (0.05, 0.4) at 89 degrees.
    assert albedo.tolist() == pytest.approx([fine] * 3, rel=1e-3)


@pytest.mark.parametrize("shadowing", [0.2, 0.5, 0.9])
@pytest.mark.parametrize("view", VIEWS[:3])
def test_albedo_with_fresnel_and_shadowing_is_the_integral_over_slopes(view, shadowing):
    wo = direction(*view)
    options = {"f0": 0.04, "shadowing": shadowing}

    albedo = Kurt(m=(0.3, 0.15), **options).albedo(vectors([wo]), n_samples=1 << 16)[0]

    expected = albedo_by_slopes("kurt", (0.3, 0.15), wo, n=512, **options)
    # Measured: 1e-4 at shadowing 0.9, half of it quadrature: the integrand ends as cos_i^0.1 at the horizon.
    assert albedo[0].item() == pytest.approx(expected, rel=2e-4)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("view", VIEWS[:4])
def test_integral_over_slopes_is_the_integral_over_light_directions(model, view):
    """Midpoint in cos_i and phi_i of the formula in angles: no half vector measure in it."""
    wo, widths, n = direction(*view), (0.5, 0.7), 96
    z, phi = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n * 2 * pi, indexing="ij")
    wi = np.stack([np.sqrt(1 - z * z) * np.cos(phi), np.sqrt(1 - z * z) * np.sin(phi), z], axis=-1).reshape(-1, 3)
    by_hand = kurt_by_hand if model == "kurt" else ggx_by_hand

    over_directions = np.mean([by_hand(wo, i, *widths) * i[2] for i in wi]) * 2 * pi

    # Measured: 3.4e-5 at 96, 7e-6 at 192.
    assert over_directions == pytest.approx(albedo_by_slopes(model, widths, wo), rel=1e-4)


@pytest.mark.parametrize("m", [0.02, 0.1, 0.3, 0.5, 1.0])
def test_albedo_of_a_kurt_lobe_along_the_normal_has_a_closed_form(m):
    albedo = Kurt(m=m).albedo(vectors([[0.0, 0.0, 1.0]]), n_samples=4096)[0, 0].item()

    # Measured: 3e-6, m = 1.
    assert albedo == pytest.approx(kurt_albedo_at_normal(m), rel=1e-5)
    assert albedo_by_slopes("kurt", (m, m), direction(0, 0), n=512) == pytest.approx(albedo, rel=5e-5)


@pytest.mark.parametrize(
    ("planted", "options"), [("alpha squared", {"widths": (0.25, 0.25)}), ("no cosine", {"cosine": False})]
)
def test_albedo_check_notices(planted, options):
    wo = direction(0.6, 0.8)
    wrong = albedo_by_slopes("kurt", wo=wo, **({"widths": (0.5, 0.5)} | options))

    albedo = Kurt(m=0.5).albedo(vectors([wo]))[0, 0].item()

    assert albedo != pytest.approx(wrong, rel=1e-2), planted


@pytest.mark.parametrize("widths", WIDTHS)
def test_ggx_returns_no_more_light_than_it_receives(widths):
    wo = vectors([direction(theta, 0.7) for theta in np.linspace(0, 1.55, 32)])

    albedo = GGX(alpha=widths).albedo(wo)

    # Every weight is G2 / G1(wo) <= 1: exact except for float32.
    assert albedo.max() <= 1 + 1e-6


def test_kurt_without_shadowing_exponent_returns_no_more_light_than_it_receives():
    wo = vectors([direction(theta, 0.7) for theta in np.linspace(0, 1.55, 32)])

    albedo = torch.cat([Kurt(m=widths).albedo(wo) for widths in WIDTHS])

    assert albedo.max() <= 1 + 1e-6


# Colours, several lobes, budgets.


def test_fresnel_runs_from_f0_to_white_and_keeps_the_colour_of_ks():
    lobe = Kurt(f0=(0.9, 0.5, 0.1), ks=(1.0, 0.5, 0.25)).reflectance().lobes[0]

    facing, middle, grazing = (lobe.F(torch.tensor(c)) for c in (1.0, 0.5, 0.0))

    assert [c.item() for c in facing] == pytest.approx([0.9, 0.25, 0.025])
    assert [c.item() for c in middle] == pytest.approx([0.9 + 0.1 / 32, (0.5 + 0.5 / 32) / 2, (0.1 + 0.9 / 32) / 4])
    assert [c.item() for c in grazing] == pytest.approx([1.0, 0.5, 0.25])


def test_grey_material_has_one_channel_and_a_coloured_one_three():
    up = vectors([[0.0, 0.0, 1.0]])

    counts = [len(m.f(up, up)) for m in (Kurt(f0=0.3), Kurt(f0=0.3, kd=(0.1, 0.2, 0.3)), GGX(ks=(1.0, 0.5, 0.1)))]

    assert counts == [1, 3, 3]


def test_several_lobes_and_a_diffuse_part_add_up():
    options = [{"m": (0.1, 0.3), "ks": (0.5, 0.4, 0.3)}, {"m": 0.4, "f0": 0.2, "shadowing": 0.3, "ks": 0.4}]
    wo, wi = vectors(random_hemisphere(200, 9)), vectors(random_hemisphere(200, 10))

    f = torch.stack(Kurt(lobes=tuple(options), kd=(0.1, 0.2, 0.3)).f(wo, wi))
    albedo = Kurt(lobes=tuple(options), kd=(0.1, 0.2, 0.3)).albedo(wo)

    kd = torch.tensor([0.1, 0.2, 0.3])
    parts = [torch.stack([c.expand(200) for c in Kurt(**o).f(wo, wi)]).expand(3, 200) for o in options]
    torch.testing.assert_close(f, sum(parts) + kd[:, None] / pi, rtol=1e-6, atol=0)
    torch.testing.assert_close(albedo, sum(Kurt(**o).albedo(wo) for o in options) + kd.double(), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(
    "ks", [(1.0,), (0.5, 0.5), (0.7, 0.2, 0.1), (1.0, 0.01, 0.01), (0.0, 0.0), (1.0, 0.0, 0.3, 0.3)]
)
def test_shares_of_a_budget_sum_to_the_budget(ks):
    reflectance = Kurt(lobes=tuple({"ks": k} for k in ks)).reflectance()

    shares = {n: reflectance.share(n) for n in range(len(ks), 200)}

    assert all(sum(share) == n for n, share in shares.items())
    assert all(min(share) >= 1 for share in shares.values())


def test_shares_of_a_budget_follow_the_strength_of_the_lobes():
    shares = Kurt(lobes=({"ks": 0.6}, {"ks": 0.3}, {"ks": 0.1})).reflectance().share(50)

    assert shares == [30, 15, 5]


def test_budget_smaller_than_the_number_of_lobes_gives_one_sample_each():
    shares = Kurt(lobes=({"ks": 0.6}, {"ks": 0.3}, {"ks": 0.1})).reflectance().share(2)

    assert shares == [1, 1, 1]
