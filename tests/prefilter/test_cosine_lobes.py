"""Phong and Lafortune: values by angles, samplers against closed forms, energy against quadrature in one angle."""

import re
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from math import acos, cos, pi, sin, sqrt

import numpy as np
import pytest
import torch
from scipy.integrate import quad
from scipy.special import beta
from scipy.stats import chi2

from glossbench.brdf.cosine_lobe import CosineLobe
from glossbench.brdf.lafortune import Lafortune
from glossbench.brdf.phong import Phong
from glossbench.directions import Vec3, dot, points_2d, reflect
from glossbench.envmap.lights.synthetic import Gradient
from glossbench.errors import InputError
from glossbench.methods.environment_sampling import EnvironmentSampling
from glossbench.methods.filtered_importance_sampling import FilteredImportanceSampling
from glossbench.methods.importance_sampling import ImportanceSampling
from glossbench.methods.regular_sampling import RegularSampling
from glossbench.scene.sphere import Sphere
from glossbench.shading.image import shade
from glossbench.shading.stage_cache import StageCache
from glossbench.truth.reference import compute_reference
from oracles.chi_square import chi_square_p, integrate_cells
from oracles.hemisphere import direction, random_hemisphere, vectors
from oracles.texel_sums import check_sum, extrapolated, lights

MIRROR = (-1.0, -1.0, 1.0)
OFF_SPECULAR, ANISOTROPIC, RETRO = (-1.0, -1.0, 0.7), (-0.6, -0.95, 1.0), (0.9, 0.9, 1.0)
LOBES = [
    *((MIRROR, s) for s in (1.0, 20.0, 400.0, 2e4)),
    (OFF_SPECULAR, 13.0),
    (ANISOTROPIC, 20.0),
    (RETRO, 30.0),
    ((-0.7, -0.7, 1e-9), 2.3),
    ((0.5, -1.0, 0.8), 7.0),
]
VIEWS = [(0.0, 0.0), (0.6, 0.8), (1.1, 4.0), (1.45, 2.0), (1.55, 0.3)]  # theta, phi; the last is 89 degrees
CASES = [(C, s, view) for C, s in LOBES for view in VIEWS]
SAMPLES = 100_000


# By hand, in float64.


def axis_by_hand(C, wo):
    """|C wo| for C scaled to its largest component, and C wo over its length."""
    a = np.array(C) / np.abs(C).max() * wo
    return np.linalg.norm(a), a / np.linalg.norm(a)


def lafortune_by_hand(C, s, wo, wi, ks=1.0):
    """ks (s + 2) / (2 pi max|C|^s) (C_x wo_x wi_x + ...)^s, the scalar product as the paper writes it."""
    product = sum(c / max(map(abs, C)) * o * i for c, o, i in zip(C, wo, wi, strict=True))
    return ks * (s + 2) / (2 * pi) * product**s if product > 0 else 0.0


def phong_by_hand(s, wo, wi, ks=1.0):
    """Lafortune and Willems 1994, by the angle to the mirror direction."""
    mirror = np.array([-wo[0], -wo[1], wo[2]])
    alpha = 2 * np.arcsin(min(np.linalg.norm(wi - mirror) / 2, 1.0))  # acos has no digits for small angles
    return ks * (s + 2) / (2 * pi) * cos(alpha) ** s if cos(alpha) > 0 else 0.0


def over_rings(s, theta, of_ring):
    """Integral over alpha of cos^s(alpha) sin(alpha) of_ring(x, y), rings alpha about an axis at theta from the normal.

    On a ring cos_i = x + y cos(phi), x = cos(theta) cos(alpha), y = sin(theta) sin(alpha).
    """
    integrand = lambda a: cos(a) ** s * sin(a) * of_ring(cos(theta) * cos(a), sin(theta) * sin(a))  # noqa: E731
    width = 12 / sqrt(s + 1)
    marks = sorted({min(m, pi / 2) for m in (pi / 2 - theta, width, width / 4)} | {0, pi / 2})
    return sum(quad(integrand, a, b, epsabs=1e-13, epsrel=1e-11)[0] for a, b in pairwise(marks))


def seen(x, y):
    """Half the azimuth that lies above the surface."""
    return acos(min(max(-x / y, -1), 1)) if y > 0 else pi


def visible_share(s, theta):
    """Share of the sampler's density above the surface."""
    return (s + 1) / (2 * pi) * over_rings(s, theta, lambda x, y: 2 * seen(x, y))


def albedo_by_rings(C, s, wo, cosine=True):
    """Albedo of a lobe of ks = 1; without its cosine, the integral of f alone."""
    length, a = axis_by_hand(C, wo)
    above = lambda x, y: 2 * (x * seen(x, y) + y * sin(seen(x, y)))  # noqa: E731
    alone = lambda x, y: 2 * seen(x, y)  # noqa: E731
    return (s + 2) / (2 * pi) * length**s * over_rings(s, acos(min(a[2], 1)), above if cosine else alone)


def lobe_of(C, s, **rest):
    return Lafortune(C=C, s=s, **rest).reflectance().lobes[0]


def in_double(lobe):
    return replace(
        lobe, s=lobe.s.double(), C=Vec3(*(c.double() for c in lobe.C)), ks=tuple(k.double() for k in lobe.ks)
    )


# The sampler against its density.


def ring_chi_square_p(C, s, view, exponent=None):
    """p value of cos^(s + 1)(alpha) and phi, about the axis by hand, being uniform on 20 x 20 cells."""
    wo = direction(*view)
    lobe = lobe_of(C, s)
    u = points_2d(SAMPLES, "random", 11)
    wi = np.stack([c.expand(1, SAMPLES)[0].double() for c in lobe.sample(vectors([wo]), lobe.sample_points(u)).wi], 1)
    a = axis_by_hand(C, wo)[1]
    t = np.cross(a, [0.0, 1.0, 0.0] if abs(a[1]) < 0.7 else [1.0, 0.0, 0.0])
    t = t / np.linalg.norm(t)

    chord = ((wi - a) ** 2).sum(1)
    uniform = np.exp(((s if exponent is None else exponent) + 1) * np.log1p(-np.minimum(chord / 2, 1 - 1e-12)))
    phi = np.arctan2(wi @ np.cross(a, t), wi @ t) / (2 * pi) + 0.5
    counts = np.histogram2d(uniform, phi, bins=20, range=((0, 1), (0, 1)))[0]

    return chi2.sf(((counts - SAMPLES / 400) ** 2).sum() / (SAMPLES / 400), 399)


# One false alarm in a hundred for all cases together, Sidak.
P_LIMIT = 1 - 0.99 ** (1 / len(CASES))


@pytest.mark.parametrize(("C", "s", "view"), CASES)
def test_samples_lie_about_the_axis_as_a_power_of_the_cosine(C, s, view):
    assert ring_chi_square_p(C, s, view) > P_LIMIT


@pytest.mark.parametrize("fault", [{"C": RETRO}, {"exponent": 21.0}, {"C": (-0.95, -0.6, 1.0)}])
def test_chi_square_about_the_axis_notices_another_axis_and_another_exponent(fault, monkeypatch):
    right = lobe_of(ANISOTROPIC, 20.0)
    monkeypatch.setattr(f"{__name__}.lobe_of", lambda C, s: right)

    p = ring_chi_square_p(fault.get("C", ANISOTROPIC), 20.0, (0.6, 0.8), fault.get("exponent"))

    assert p < P_LIMIT


# Cells about the mirror direction's azimuth: not for lobes that lie elsewhere, which the test above has.
MIRRORED = [(C, s, view) for C, s, view in CASES if s > 1 and C in (MIRROR, OFF_SPECULAR, ANISOTROPIC)]


@pytest.mark.parametrize(("C", "s", "view"), MIRRORED)
def test_samples_fall_as_the_density_says(C, s, view):
    lobe = lobe_of(C, s)

    p = chi_square_p(lobe, direction(*view), lobe.pdf)

    assert p > P_LIMIT


PLANTED_DENSITIES = {
    "exponent off by a tenth": lambda lobe: replace(lobe, s=1.1 * lobe.s).pdf,
    "normalised as f is": lambda lobe: lambda o, i: (lobe.s + 2) / (lobe.s + 1) * lobe.pdf(o, i),
    "cosine of wi in it": lambda lobe: lambda o, i: lobe.pdf(o, i) * i.z,
    "x and y of the axis swapped": lambda lobe: replace(lobe, C=Vec3(lobe.C.y, lobe.C.x, lobe.C.z)).pdf,
}


@pytest.mark.parametrize("fault", PLANTED_DENSITIES)
def test_chi_square_notices_a_planted_fault_of_the_density(fault):
    lobe = lobe_of(ANISOTROPIC, 20.0)

    p = chi_square_p(lobe, direction(0.6, 0.8), PLANTED_DENSITIES[fault](lobe))

    assert p < P_LIMIT


@pytest.mark.parametrize(("C", "s", "view"), CASES)
def test_density_integrates_to_the_share_of_the_lobe_above_the_surface(C, s, view):
    wo = direction(*view)
    a = axis_by_hand(C, wo)[1]
    theta, phi = acos(min(a[2], 1)), np.arctan2(a[1], a[0])
    fine = np.unique(np.clip(theta + np.linspace(-12, 12, 49) / sqrt(s + 1), 0, pi / 2))
    across = np.linspace(-pi, pi, 97) if theta < 0.1 else np.unique(np.clip(np.linspace(-12, 12, 97), -pi, pi))
    if s > 100 and theta >= 0.1:
        across = np.unique(np.clip(np.linspace(-12, 12, 97) / sqrt(s) / sin(theta), -pi, pi))

    total = integrate_cells(lobe_of(C, s).pdf, wo, fine, across, phi).sum()

    # Measured: 7e-8 where the lobe is smooth, 2.1e-6 for s = 1, which has a kink where it ends.
    assert total == pytest.approx(visible_share(s, theta), abs=4e-6 if s < 2 else 2e-7)


@pytest.mark.parametrize(("C", "s"), [*LOBES, (MIRROR, 0.0)])
def test_weight_of_a_sample_is_f_cos_over_pdf(C, s):
    lobe = in_double(lobe_of(C, s, ks=0.3))
    wo = Vec3(*(c[:, None] for c in vectors(random_hemisphere(40, 4), torch.float64)))

    wi, pdf, (weight,) = lobe.sample(wo, lobe.sample_points(points_2d(500, "random", 5).double()))
    (f,), density = lobe.f_and_pdf(wo, wi)
    above = (wi.z > 1e-3) & (density > 1e-12)

    assert above.any()
    # Measured in float64: 1.8e-13.
    torch.testing.assert_close(pdf.expand_as(density)[above], density[above], rtol=1e-12, atol=0)
    torch.testing.assert_close(weight[above], (f * wi.z / density)[above], rtol=1e-12, atol=0)
    assert (weight[wi.z <= 0] == 0).all()
    assert (lobe.pdf(wo, wi)[wi.z <= 0] == 0).all()


# Values.


@dataclass(frozen=True)
class Pair:
    """Directions of float32, and the unit vectors in float64 that they approximate."""

    wo: np.ndarray
    wi: np.ndarray

    @classmethod
    def near(cls, C, s, n=300):
        """wi within some widths of the axis of wo, and anywhere."""
        rng = np.random.default_rng(3)
        wo = random_hemisphere(n, 1)
        a = np.array([axis_by_hand(C, o)[1] for o in wo]) + rng.normal(size=(n, 3)) * 1.5 / sqrt(s + 1)
        a = a / np.linalg.norm(a, axis=1, keepdims=True)
        near = a[:, 2] > 0.02
        wi = np.where(near[:, None], a, random_hemisphere(n, 2))
        return cls(wo.astype(np.float32), wi.astype(np.float32))

    def unit(self):
        for o, i in zip(self.wo.astype(float), self.wi.astype(float), strict=True):
            yield o / np.linalg.norm(o), i / np.linalg.norm(i)


def check_values(f, expected, relative):
    f, expected = f.double().numpy(), np.array(expected)
    normal = expected > 1e-3 * expected.max()
    assert normal.sum() > 30
    np.testing.assert_allclose(f[normal], expected[normal], rtol=relative)
    assert (f[~normal] < 1.01e-3 * expected.max()).all()


@pytest.mark.parametrize("s", [0.0, 1.0, 20.0, 400.0, 2e4, 1e5])
def test_phong_is_its_formula_written_out_in_angles(s):
    pair = Pair.near(MIRROR, s)

    f = Phong(s=s, ks=0.3).f(vectors(pair.wo), vectors(pair.wi))[0]

    # Float32, measured: 2.5e-5 for s = 1, at cosines of 1e-3, 1.6e-6 for s = 400, 2.7e-5 for s = 1e5.
    check_values(f, [phong_by_hand(s, o, i, 0.3) for o, i in pair.unit()], 5e-5)


@pytest.mark.parametrize(("C", "s"), LOBES)
def test_lafortune_is_its_scalar_product_to_a_power(C, s):
    pair = Pair.near(C, s)

    f = Lafortune(C=tuple(0.6 * c for c in C), s=s, ks=0.3).f(vectors(pair.wo), vectors(pair.wi))[0]

    check_values(f, [lafortune_by_hand(C, s, o, i, 0.3) for o, i in pair.unit()], 5e-5)


@pytest.mark.parametrize("wrong", [(ANISOTROPIC, 21.0), ((-0.95, -0.6, 1.0), 20.0), ((0.6, 0.95, 1.0), 20.0)])
def test_scalar_product_notices_another_exponent_and_another_diagonal(wrong):
    pair = Pair.near(ANISOTROPIC, 20.0)

    f = Lafortune(C=ANISOTROPIC, s=20.0).f(vectors(pair.wo), vectors(pair.wi))[0]

    with pytest.raises(AssertionError):
        check_values(f, [lafortune_by_hand(*wrong, o, i) for o, i in pair.unit()], 5e-5)


def test_lafortune_without_normalisation_is_the_papers_equation_4():
    """The Cornell fit of a light blue house paint, its red channel: blLfrtn in Cornell's material format."""
    fit = [
        ((0.870567, 0.870567, 0.774290), 21.820103),
        ((-0.451218, -0.451218, 0.023123), 3.029342),
        ((-1.031545, -1.031545, 0.706734), 66.899060),
    ]
    wo, wi = random_hemisphere(300, 1), random_hemisphere(300, 2)
    lobes = tuple({"C": C, "s": s} for C, s in fit)

    f = Lafortune(lobes=lobes, kd=0.3264, normalisation="none").f(vectors(wo), vectors(wi))[0]

    products = [[sum(c * o * i for c, o, i in zip(C, a, b, strict=True)) for C, _ in fit] for a, b in zip(wo, wi)]  # noqa: B905
    expected = [0.3264 / pi + sum(max(p, 0) ** s for p, (_, s) in zip(of, fit, strict=True)) for of in products]
    np.testing.assert_allclose(f.numpy(), expected, rtol=2e-6)  # measured: 4.7e-7


@pytest.mark.parametrize("s", [1.0, 20.0, 2e4])
def test_phong_is_lafortune_of_the_mirror(s):
    wo, wi = vectors(random_hemisphere(200, 1)), vectors(random_hemisphere(200, 2))

    phong, lafortune = Phong(s=s, ks=0.4, kd=0.1).f(wo, wi), Lafortune(C=(-3, -3, 3), s=s, ks=0.4, kd=0.1).f(wo, wi)

    assert (phong[0] == lafortune[0]).all()


def test_fits_of_ngan_and_others_can_be_held_and_have_their_value_along_the_normal(shared_data):
    text = (shared_data / "brdfs" / "ngan_lafortune.fit").read_text()
    number = r"([-+.\deE]+)"
    lobe = rf"NganLafortune\(albedo = \[(.*?)\], Cxy = {number}, Cz = {number}, sharpness = {number}"
    fits = [([float(v) for v in kd.split(",")], [float(v) for v in ks.split(",")], *map(float, rest))
            for kd, ks, *rest in re.findall(rf"\(albedo = \[(.*?)\]\), {lobe}", text)]  # fmt: skip
    up = vectors([[0.0, 0.0, 1.0]])

    values = [Lafortune(C=(xy, xy, z), s=n, ks=ks, kd=kd).f(up, up) for kd, ks, xy, z, n in fits]

    assert len(fits) > 50
    assert max(max(ks) for _, ks, *_ in fits) > 1
    for f, (kd, ks, xy, z, n) in zip(values, fits, strict=True):
        peak = (n + 2) / (2 * pi) * (z / max(abs(xy), abs(z))) ** n
        expected = [d / pi + k * peak for d, k in zip(kd, ks, strict=True)]
        np.testing.assert_allclose([c.item() for c in f], expected, rtol=1e-4)  # measured: 3e-5


@pytest.mark.parametrize(("C", "s"), LOBES)
def test_light_and_viewer_may_be_exchanged(C, s):
    pair = Pair.near(C, s, 2000)
    a, b = (vectors(v / np.linalg.norm(v, axis=1, keepdims=True), torch.float64) for v in
            (pair.wo.astype(float), pair.wi.astype(float)))  # fmt: skip
    lobe = in_double(lobe_of(C, s))

    there, back = lobe.f(a, b)[0], lobe.f(b, a)[0]

    # Measured: 1.3e-15 of s + 2, which is the largest value up to a factor.
    torch.testing.assert_close(there, back, rtol=1e-11, atol=1e-14 * (s + 2))


def test_exchange_notices_an_axis_that_is_not_shortened(monkeypatch):
    monkeypatch.setattr(CosineLobe, "_shrinkage", lambda self, wo: torch.ones_like(wo.z))

    with pytest.raises(AssertionError):
        test_light_and_viewer_may_be_exchanged(OFF_SPECULAR, 13.0)


@pytest.mark.parametrize("material", [Phong(s=3, kd=0.5), Lafortune(C=OFF_SPECULAR, s=3, kd=0.5)], ids=["phong", "la"])
def test_value_is_zero_below_the_surface(material):
    above = vectors(random_hemisphere(500, 8))
    below = Vec3(above.x, above.y, -above.z)

    values = [material.f(above, below), material.f(below, above), material.f(below, below)]

    assert (material.f(above, above)[0] > 0).all()
    assert all((channel == 0).all() for f in values for channel in f)


EXTREME = [*LOBES, (MIRROR, 0.0), (MIRROR, 1e5), ((-1.0, -1.0, 0.0), 3.0), ((0.0, 0.0, 1.0), 5.0),
           ((-1.0, -1.0, -0.5), 9.0), ((-0.577, -0.577, 0.51), 16600.0)]  # fmt: skip


@pytest.mark.parametrize(("C", "s"), EXTREME)
def test_everything_is_finite_and_not_negative_from_the_normal_to_89_9_degrees(C, s):
    lobe = lobe_of(C, s)
    angles = [0.0, 1e-4, 0.3, 1.2, 1.55, np.radians(89.9)]
    wo = Vec3(*(c[:, None] for c in vectors([direction(t, 0.4) for t in angles])))

    wi, pdf, weight = lobe.sample(wo, lobe.sample_points(points_2d(4096)))
    values, density = lobe.f_and_pdf(wo, wi)
    viewer = lobe.viewer(wo)
    h = vectors([direction(t, 0.9) for t in np.linspace(0, 0.5, 50)])
    h = Vec3(*(c[None] for c in h))
    over_D = lobe.f_over_D(wo, lobe.to_surface(wo, reflect(viewer, h)), h, dot(viewer, h).clamp(min=1e-4))

    assert ((pdf > 0) & torch.isfinite(pdf)).all()
    for channel in (*weight, *values, density):
        assert (torch.isfinite(channel) & (channel >= 0)).all()
    # f / D is evaluated where D is above xi of its peak.
    kept = lobe.slope2(h).expand_as(over_D[0]) < 9
    assert torch.isfinite(over_D[0][kept]).all()


@pytest.mark.parametrize(("C", "s"), [(MIRROR, 20.0), (OFF_SPECULAR, 13.0), (RETRO, 30.0), (ANISOTROPIC, 7.0)])
def test_the_frame_of_the_lobe_has_its_z_where_the_lobe_is_largest(C, s):
    wo = direction(0.7, 0.8)
    n = 120
    z, phi = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n * 2 * pi, indexing="ij")
    wi = np.stack([np.sqrt(1 - z * z) * np.cos(phi), np.sqrt(1 - z * z) * np.sin(phi), z], axis=-1).reshape(-1, 3)
    largest = wi[np.argmax([lafortune_by_hand(C, s, wo, i) for i in wi])]

    axis = np.array([c.item() for c in lobe_of(C, s).to_surface(vectors([wo]), vectors([[0, 0, 1]]))])

    # The grid's spacing is 0.05 in phi and, at the axis, 0.01 in theta.
    np.testing.assert_allclose(axis, largest, atol=0.05)


def test_widths_are_those_of_the_half_vectors_at_normal_incidence():
    """D of the Beckmann lobe over the half vector density of cos^s, within 2 widths."""
    s = 400.0
    lobe = lobe_of(MIRROR, s)
    theta = np.linspace(0, 2 / sqrt(2 * s), 20)

    D = lobe.D(vectors([direction(t, 0.3) for t in theta])).numpy()

    # pdf of wi is D cos_h / (4 c), and c = cos_h. Measured: 0.0076, the next order in 1 / s.
    np.testing.assert_allclose(D, 4 * (s + 1) / (2 * pi) * np.cos(2 * theta) ** s, rtol=0.01)


# Energy.


@pytest.mark.parametrize("s", [0.0, 1.0, 20.0, 400.0, 2e4])
def test_phong_along_the_normal_returns_ks(s):
    albedo = Phong(s=s, ks=(0.3, 0.5, 1.0)).albedo(vectors([[0.0, 0.0, 1.0]]))[0]

    # The sampler's mean of (s + 2) / (s + 1) cos_i over 4096 Hammersley points; measured: 2.7e-6.
    assert albedo.tolist() == pytest.approx([0.3, 0.5, 1.0], rel=1e-5)


@pytest.mark.parametrize("s", [0.0, 1.0, 20.0, 400.0, 2e4])
def test_phong_at_grazing_view_returns_a_beta_function(s):
    wo = vectors([[1.0, 0.0, 1e-7]])
    closed = (s + 2) / (2 * pi) * beta((s + 1) / 2, 1.5)

    albedo = Phong(s=s).albedo(wo, n_samples=1 << 14)[0, 0].item()

    assert albedo == pytest.approx(closed, rel=6e-5)  # measured: 2.9e-5, s = 2e4
    assert albedo_by_rings(MIRROR, s, np.array([1.0, 0.0, 0.0])) == pytest.approx(closed, rel=1e-8)


@pytest.mark.parametrize(("C", "s", "view"), CASES)
def test_albedo_is_the_integral_over_rings_about_the_axis(C, s, view):
    wo = direction(*view)

    albedo = Lafortune(C=C, s=s, ks=0.5).albedo(vectors([wo]), n_samples=1 << 14)[0, 0].item()

    # Measured: 1.1e-4 at 83 degrees, 1.5e-5 where most of the lobe is seen, and 3e-9 where |C wo| is 0: its square is
    # known to 6e-8.
    assert albedo == pytest.approx(0.5 * albedo_by_rings(C, s, wo), rel=2e-4, abs=1e-8)


@pytest.mark.parametrize(
    ("planted", "wrong"),
    [
        ("no cosine", lambda wo: albedo_by_rings(ANISOTROPIC, 20.0, wo, cosine=False)),
        ("normalised as the density is", lambda wo: 21 / 22 * albedo_by_rings(ANISOTROPIC, 20.0, wo)),
        ("axis not shortened", lambda wo: albedo_by_rings(MIRROR, 20.0, wo)),
    ],
)
def test_albedo_check_notices(planted, wrong):
    wo = direction(0.6, 0.8)

    albedo = Lafortune(C=ANISOTROPIC, s=20.0).albedo(vectors([wo]))[0, 0].item()

    assert albedo != pytest.approx(wrong(wo), rel=1e-2), planted


@pytest.mark.parametrize(("C", "s"), EXTREME)
def test_normalised_lobe_returns_no_more_than_ks(C, s):
    wo = vectors([direction(theta, phi) for theta in np.linspace(0, 1.57, 24) for phi in (0.0, 0.7, pi / 2)])

    albedo = Lafortune(C=C, s=s).albedo(wo)

    # Of a mirror it is 1 along the normal; Hammersley points, measured: 2.9e-6 above.
    assert albedo.max() <= 1 + 1e-5


def test_lobe_of_the_papers_equation_4_may_return_more_than_it_receives():
    """Its bound 2 pi / (s + 2) max|C|^s counts: for C = (-1.2, -1.2, 1), s = 20 that is 11, not 1."""
    wo = vectors([direction(theta, 0.0) for theta in (0.0, 1.0, 1.3)])

    albedo = Lafortune(C=(-1.2, -1.2, 1.0), s=20.0, normalisation="none").albedo(wo)[:, 0]

    bound = 2 * pi / 22 * 1.2**20
    expected = [bound * albedo_by_rings((-1.2, -1.2, 1.0), 20.0, direction(t, 0.0)) for t in (0.0, 1.0, 1.3)]
    assert albedo.tolist() == pytest.approx(expected, rel=1e-4)  # measured: 3.2e-5
    assert albedo.max() > 2


# Options.


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"C": (0, 0, 0)}, r"lafortune\.C must have a component other than 0, got \(0, 0, 0\)"),
        ({"s": -1}, r"lafortune\.s must be greater than or equal to 0, got -1"),
        ({"ks": -0.1}, r"lafortune\.ks\[0\] must be greater than or equal to 0, got -0\.1"),
        ({"lobes": [{"s": 1}, {"s": -1}]}, r"lafortune\.lobes\[1\]: lobe\.s must be greater than or equal to 0, got"),
        ({"lobes": [{"c": 1}]}, r"lafortune\.lobes\[0\]: lobe: unknown option 'c'; did you mean 'C'\?"),
        ({"C": (2, 0, 0), "s": 1000, "normalisation": "none"}, r"lafortune: max\|C\|\^s must be below 1e30"),
    ],
)
def test_bad_options_are_refused_by_name_rule_and_value(options, message):
    with pytest.raises(InputError, match=f"^{message}"):
        Lafortune.create(options)


def test_lobes_from_a_study_and_from_python_are_the_same():
    lobes = [{"C": [-1, -1, 0.8], "s": 30, "ks": [0.5, 0.0, 0.0]}, {"s": 7.0}]

    material = Lafortune.create({"lobes": lobes, "kd": 0.1})

    assert Lafortune.create(material.as_dict()) == material
    assert [lobe.s for lobe in material.lobes] == [30.0, 7.0]
    assert len(material.reflectance().lobes[0].ks) == 3


# With everything that shades.


@dataclass(frozen=True)
class Glossy:
    """A material by hand, of one lobe, as sums over texels ask for it."""

    C: tuple[float, float, float]
    s: float
    ks: tuple[float, float, float] = (1.0, 1.0, 1.0)
    kd: tuple[float, float, float] = (0.0, 0.0, 0.0)
    exponent_factor: float = 1.0

    def material(self):
        if self.C == MIRROR:
            return Phong(s=self.s, ks=self.ks, kd=self.kd)
        return Lafortune(C=self.C, s=self.s, ks=self.ks, kd=self.kd)

    def f(self, wo, wi):
        """BRDF (N, 3) for light directions (N, 3), all above the surface."""
        product = np.maximum(wi @ (np.array(self.C) / np.abs(self.C).max() * wo), 0)
        value = (self.s + 2) / (2 * pi) * product ** (self.exponent_factor * self.s)
        return np.array(self.kd) / pi + value[:, None] * np.array(self.ks)


GLOSSY = {
    "phong": Glossy(MIRROR, 30.0, (0.5, 0.4, 0.3), (0.5, 0.3, 0.1)),
    "off_specular": Glossy(OFF_SPECULAR, 20.0),
    "anisotropic": Glossy(ANISOTROPIC, 20.0, (0.9, 0.6, 0.2)),
    "retro": Glossy(RETRO, 30.0),
}


@cache
def exact(material):
    return extrapolated(GLOSSY[material], lights()["rough"])


@pytest.mark.parametrize("material", GLOSSY)
def test_reference_is_the_exact_sum_over_texels(material):
    check_sum(exact(material), GLOSSY[material].material())


def test_sum_over_texels_notices_an_exponent_that_is_off_by_3_percent():
    wrong = extrapolated(replace(GLOSSY["phong"], exponent_factor=1.03), lights()["rough"])

    with pytest.raises(AssertionError):
        check_sum(wrong, GLOSSY["phong"].material())


VIEW, CACHE = Sphere(resolution=16), StageCache()
SMOOTH = Gradient(resolution=32).cubemap()
METHODS = {
    "regular_sampling": RegularSampling(samples=60, xi=0.01, normalisation="exact"),
    "filtered_importance_sampling": FilteredImportanceSampling(samples=256),
    "importance_sampling": ImportanceSampling(samples=1024),
    "environment_sampling": EnvironmentSampling(samples=4096),
}


# RMS error over the mean, measured; filtered importance sampling: the filter's; environment sampling: noise.
MEASURED = {
    "regular_sampling": {"phong": 0.0023, "off_specular": 0.017, "anisotropic": 0.011, "retro": 0.0051},
    "filtered_importance_sampling": {"phong": 0.0013, "off_specular": 0.0097, "anisotropic": 0.0039, "retro": 0.0018},
    "importance_sampling": {"phong": 0.0005, "off_specular": 0.0016, "anisotropic": 0.0008, "retro": 0.0012},
    "environment_sampling": {"phong": 0.0033, "off_specular": 0.012, "anisotropic": 0.0053, "retro": 0.0023},
}


@cache
def truth(material):
    return compute_reference(SMOOTH, GLOSSY[material].material(), VIEW, relative_error=1e-3)


def error_of(method, material):
    """RMS over the mean."""
    right = truth(material)
    image = shade(METHODS[method], SMOOTH, GLOSSY[material].material(), VIEW, cache=CACHE, time_it=False)
    return float((image.radiance - right.radiance)[right.mask].square().mean().sqrt()) / right.mean


@pytest.mark.parametrize("material", GLOSSY)
@pytest.mark.parametrize("method", METHODS)
def test_every_method_shades_it_under_a_smooth_light(method, material):
    assert error_of(method, material) < 1.5 * MEASURED[method][material] + truth(material).noise / truth(material).mean


@pytest.mark.parametrize(
    ("planted", "method", "name", "wrong"),
    [
        ("axis taken for the mirror direction", "regular_sampling", "to_surface", lambda self, wo, d: d),
        ("axis not shortened", "importance_sampling", "_shrinkage", lambda self, wo: torch.ones_like(wo.z)),
        ("axis that is not unit", "environment_sampling", "_axis", lambda self, wo: Vec3(*(2 * c for c in wo))),
    ],
)
def test_smooth_light_notices(monkeypatch, planted, method, name, wrong):
    truth("retro")
    monkeypatch.setattr(CosineLobe, name, wrong)

    assert error_of(method, "retro") > 5 * MEASURED[method]["retro"], planted
