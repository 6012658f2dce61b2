"""The halfway-vector disk: values by hand, the disk itself, energy, sampler, and every method on it."""

from dataclasses import dataclass, replace
from math import hypot, pi, radians, sin, sqrt

import numpy as np
import pytest
import torch

from glossbench.brdf.halfway_vector_disk import HalfwayVectorDisk
from glossbench.directions import points_2d
from glossbench.errors import InputError
from oracles.chi_square import SEEDS, OneQuadrant, chi_square_p, p_limit
from oracles.hemisphere import VIEWS, check_values, direction, half_of, random_hemisphere, vectors
from oracles.lobe_checks import check_finite, check_reciprocity, check_weight
from oracles.method_errors import check_methods, limits, method_errors
from oracles.quadrature import pdf_in_numpy
from oracles.texel_sums import check_sum, extrapolated, lights

SHAPES = [((0.3, 0.3), 8.0), ((0.6, 0.2), 6.0), ((1.0, 1.0), 3.0), ((0.5, 0.5), 200.0)]  # radius, exponent


def lobe_of(radius, exponent, **rest):
    return HalfwayVectorDisk(radius=radius, exponent=exponent, **rest).reflectance().lobes[0]


def lump_by_hand(wo, wi, radius, exponent, fitted=True):
    """Density of wi: half vector unnormalised and scaled to the height of wo, as edwards06.brdf has it.

    c is the cosine of half the angle between the directions, cos_h is (cos_i + cos_o) / |wo + wi|.
    """
    total = wo + wi
    s = wo[..., 2:] * total[..., :2] / total[..., 2:]
    fit = np.minimum(1, (1 - np.hypot(wo[..., 0], wo[..., 1])) / max(radius)) if fitted else np.ones_like(wo[..., 2])
    r_x, r_y = (np.broadcast_to(r * fit, s.shape[:-1]) for r in radius)
    rest = 1 - (s[..., 0] / r_x) ** 2 - (s[..., 1] / r_y) ** 2
    lit, value = rest > 0, np.zeros(rest.shape)
    wo, wi, total = (np.broadcast_to(v, total.shape)[lit] for v in (wo, wi, total))
    p = (exponent + 1) / (pi * r_x[lit] * r_y[lit]) * rest[lit] ** exponent
    c = np.cos(np.arccos(np.clip((wo * wi).sum(-1), -1, 1)) / 2)
    cos_h = total[:, 2] / np.linalg.norm(total, axis=-1)
    value[lit] = p * wo[:, 2] ** 2 / (4 * c * cos_h**3)
    return value


def f_by_hand(wo, wi, radius, exponent, reciprocal=False, fitted=True):
    value = lump_by_hand(wo, wi, radius, exponent, fitted) / wi[..., 2]
    if reciprocal:
        value = np.minimum(value, lump_by_hand(wi, wo, radius, exponent, fitted) / wo[..., 2])
    return value


# Values.


@pytest.mark.parametrize(("radius", "exponent"), SHAPES)
@pytest.mark.parametrize("reciprocal", [False, True])
def test_halfway_vector_disk_is_its_formula_written_out(radius, exponent, reciprocal):
    wo, wi = near_mirror(300)

    f = HalfwayVectorDisk(radius=radius, exponent=exponent, reciprocal=reciprocal).f(vectors(wo), vectors(wi))[0]

    expected = f_by_hand(wo, wi, radius, exponent, reciprocal)
    # Towards the edge of the lump its value is a difference of float32: those within 1e-3 of the peak are compared.
    inside = expected > 1e-3 * expected.max()
    assert inside.sum() > 50
    # Measured: 4.5e-4 at exponent 200, 6e-5 below.
    check_values(f[torch.tensor(inside)], expected[inside], 1e-3)


def near_mirror(n):
    """Directions to the viewer, and to light that comes from near the mirror direction."""
    wo = random_hemisphere(n, 1)
    wi = wo * [-1, -1, 1] + np.random.default_rng(2).normal(0, 0.08, (n, 3)) * wo[:, 2:] ** 2
    wi[:, 2] = np.abs(wi[:, 2])
    return wo, wi / np.linalg.norm(wi, axis=1, keepdims=True)


@pytest.mark.parametrize(
    ("fault", "radius", "exponent", "fitted"),
    [
        ("squared radius", (0.36, 0.04), 6.0, True),
        ("swapped radii", (0.2, 0.6), 6.0, True),
        ("wrong exponent", (0.6, 0.2), 7.0, True),
        ("lump leaves the disk", (0.6, 0.2), 6.0, False),
    ],
)
def test_formula_written_out_notices(fault, radius, exponent, fitted):
    wo, wi = near_mirror(300)

    f = HalfwayVectorDisk(radius=(0.6, 0.2), exponent=6.0).f(vectors(wo), vectors(wi))[0]

    right, wrong = f_by_hand(wo, wi, (0.6, 0.2), 6.0), f_by_hand(wo, wi, radius, exponent, fitted=fitted)
    inside = right > 1e-3 * right.max()
    with pytest.raises(AssertionError):
        check_values(f[torch.tensor(inside)], wrong[inside], 1e-3)


def test_value_along_the_normal_is_the_peak_of_the_lump_over_four():
    up = vectors([[0.0, 0.0, 1.0]])

    f = HalfwayVectorDisk(radius=(0.5, 0.2), exponent=9.0, ks=0.5, kd=0.1).f(up, up)[0]

    assert f.item() == pytest.approx(0.1 / pi + 0.5 * 10 / (pi * 0.1) / 4, rel=1e-6)


@pytest.mark.parametrize("view", VIEWS)
def test_visible_half_vectors_fill_the_unit_disk_about_the_viewer(view):
    """Inside the disk light comes from above, outside from below: the geometry of the model."""
    wo = direction(*view)
    rng = np.random.default_rng(3)
    offset = rng.uniform(-1.5, 1.5, (4000, 2))
    h = np.concatenate([offset + wo[:2], np.full((4000, 1), wo[2])], axis=1)
    h = h / np.linalg.norm(h, axis=1, keepdims=True)

    above = 2 * (h @ wo) * h[:, 2] > wo[2]

    assert (above == (np.hypot(*offset.T) < 1)).all()


# Energy.


def integral(f, wo):
    """Integral of f(wo, wi) over the hemisphere: midpoint in angles over a rectangle that holds all that is not 0.

    The slope of a half vector is at most (1 - sin_o) / cos_o, and light turns by twice the angle of its half vector:
    that bounds the first rectangle at a grazing view.
    """

    def grid(thetas, phis):
        t, p = thetas[:, None], phis[None]
        return np.stack(np.broadcast_arrays(np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)), axis=-1)

    def middles(a, b, n):
        return a + (b - a) * (np.arange(n) + 0.5) / n

    low, high = np.array([0.0, -pi]), np.array([pi / 2, pi])
    theta, reach = np.arccos(wo[2]), 2.1 * np.arctan((1 - np.hypot(*wo[:2])) / wo[2])
    if reach < theta / 2:
        wide = reach / sin(theta - reach)
        low, high = np.array([theta - reach, -wide]), np.array([min(pi / 2, theta + reach), wide])
    azimuth = np.arctan2(-wo[1], -wo[0])
    for n in (300, 300, 600):  # the first two find the rectangle
        thetas, phis = (middles(a, b, n) for a, b in zip(low, high, strict=True))
        value = f(wo, grid(thetas, phis + azimuth)) * np.sin(thetas)[:, None]
        total = value.sum() * np.prod((high - low) / n)
        lit = [np.flatnonzero(value.any(axis=1 - k)) for k in range(2)]
        ends = [(v[rows[0]], v[rows[-1]]) for v, rows in zip((thetas, phis), lit, strict=True)]
        step = (high - low) / n
        low = np.maximum([e[0] for e in ends] - 2 * step, low)
        high = np.minimum([e[1] for e in ends] + 2 * step, high)
    return total


@pytest.mark.parametrize(("radius", "exponent"), SHAPES)
@pytest.mark.parametrize("view", VIEWS)
def test_formula_integrates_to_one_at_every_view(radius, exponent, view):
    wo = direction(*view)

    total = integral(lambda o, i: lump_by_hand(o, i, radius, exponent), wo)

    # Measured: 4e-5.
    assert total == pytest.approx(1, abs=1e-4)


@pytest.mark.parametrize(("radius", "exponent"), SHAPES)
@pytest.mark.parametrize("view", VIEWS)
def test_density_integrates_to_one_at_every_view(radius, exponent, view):
    pdf = pdf_in_numpy(lobe_of(radius, exponent))

    total = integral(pdf, direction(*view))

    # Measured: 4e-5.
    assert total == pytest.approx(1, abs=1e-4)


@pytest.mark.parametrize(("radius", "exponent"), SHAPES)
def test_albedo_is_ks_at_every_view(radius, exponent):
    views = [direction(radians(t), phi) for t in (0, 30, 60, 75, 85, 89, 89.9) for phi in (0.0, 0.8, 1.5)]

    albedo = HalfwayVectorDisk(radius=radius, exponent=exponent, ks=(0.9, 0.5, 0.1)).albedo(vectors(views))

    # Every weight is ks.
    torch.testing.assert_close(albedo, torch.tensor([0.9, 0.5, 0.1]).double().expand(21, 3), rtol=1e-6, atol=0)


def test_energy_check_notices_a_lump_that_leaves_the_disk():
    cut = integral(lambda o, i: lump_by_hand(o, i, (0.3, 0.3), 8.0, fitted=False), direction(1.1, 4.0))

    # Measured: 0.910, what the horizon leaves of it.
    assert cut < 0.99


def test_energy_check_notices_a_dropped_cosine():
    pdf = pdf_in_numpy(lobe_of((0.3, 0.3), 8.0))

    total = integral(lambda o, i: pdf(o, i) * i[..., 2], direction(0.6, 0.8))

    assert total < 0.99


@pytest.mark.parametrize(("radius", "exponent"), SHAPES)
@pytest.mark.parametrize("view", VIEWS[:4])
def test_reciprocal_albedo_is_the_integral_and_at_most_one(radius, exponent, view):
    wo = direction(*view)

    albedo = HalfwayVectorDisk(radius=radius, exponent=exponent, reciprocal=True).albedo(vectors([wo]), 1 << 14)[0]

    expected = integral(lambda o, i: f_by_hand(o, i, radius, exponent, reciprocal=True) * i[..., 2], wo)
    # Measured: 5e-5; the albedo itself lies between 0.998 and 0.41.
    assert albedo.tolist() == pytest.approx([expected] * 3, rel=1e-4)
    assert albedo.max() <= 1


def test_reciprocal_variant_is_reciprocal_and_the_conserving_one_is_not():
    check_reciprocity(HalfwayVectorDisk(radius=1.0, exponent=2.0, reciprocal=True, kd=0.1))
    with pytest.raises(AssertionError):
        check_reciprocity(HalfwayVectorDisk(radius=1.0, exponent=2.0))


# The sampler.

CHI_CASES = [(*shape, view, seed) for shape in SHAPES[:3] for view in (VIEWS[0], VIEWS[2], VIEWS[4]) for seed in SEEDS]


@pytest.mark.parametrize(("radius", "exponent", "view", "seed"), CHI_CASES)
def test_samples_fall_as_the_density_says(radius, exponent, view, seed):
    lobe = lobe_of(radius, exponent)

    p = chi_square_p(lobe, direction(*view), lobe.pdf, seed, bounded=True)

    assert p > p_limit(len(CHI_CASES))


FAULTS = {
    "missing quadrants": lambda lobe: (OneQuadrant(lobe), lobe.pdf),
    "wrong exponent": lambda lobe: (lobe, lobe_of((0.6, 0.2), 7.0).pdf),
    "swapped radii": lambda lobe: (lobe, lobe_of((0.2, 0.6), 6.0).pdf),
    "dropped cosine": lambda lobe: (lobe, lambda o, i: lobe.pdf(o, i) * half_of(o, i)[0][2]),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_chi_square_notices_a_planted_fault(fault):
    sampler, pdf = FAULTS[fault](lobe_of((0.6, 0.2), 6.0))

    p = chi_square_p(sampler, direction(0.6, 0.8), pdf, SEEDS[0], bounded=True)

    assert p < p_limit(len(CHI_CASES))


@pytest.mark.parametrize("reciprocal", [False, True])
def test_weight_of_a_sample_is_f_cos_over_pdf(reciprocal):
    check_weight(lobe_of((0.6, 0.2), 6.0, ks=(0.9, 0.5, 0.1), reciprocal=reciprocal))


@pytest.mark.parametrize("view", VIEWS)
def test_no_sample_falls_below_the_surface(view):
    lobe, wo = lobe_of((1.0, 0.4), 0.0), vectors([direction(*view)])

    sample = lobe.sample(wo, lobe.sample_points(points_2d(20_000, "random", 3)))

    assert (sample.weight[0] == 1).all()


def test_half_vectors_of_samples_stay_in_the_fitted_ellipse():
    wo = direction(0.9, 0.4)
    lobe = lobe_of((0.6, 0.3), 0.0)

    wi = lobe.sample(vectors([wo]), lobe.sample_points(points_2d(20_000, "random", 3))).wi

    total = np.stack([o + c.double().numpy()[0] for o, c in zip(wo, wi, strict=True)])
    s = wo[2] * total[:2] / total[2]
    largest = 1 - sin(0.9)
    reach = np.hypot(s[0] / largest, s[1] / (largest / 2))
    # Uniform in the ellipse: of 20 000 points the outermost lies above 0.999; float32 may carry one beyond by 1e-5.
    assert 0.999 < reach.max() < 1 + 1e-4
    assert hypot(*s.mean(1)) < 4 * largest / sqrt(20_000)


# Hard directions, fusion, methods, the reference.


@pytest.mark.parametrize("radius", [(1e-3, 1e-3), (0.3, 0.3), (1.0, 1e-3), (1.0, 1.0)])
@pytest.mark.parametrize("exponent", [0.0, 8.0, 1e4])
@pytest.mark.parametrize("reciprocal", [False, True])
def test_values_are_finite_at_grazing_angles(radius, exponent, reciprocal):
    check_finite(HalfwayVectorDisk(radius=radius, exponent=exponent, reciprocal=reciprocal))


@pytest.mark.parametrize(
    ("material", "bounds", "facing"),
    [
        # Measured: 0.037, 0.0021, 0.0014, 0.21; facing 0.0067, 0.0022, 0.0015, 0.0075.
        (HalfwayVectorDisk(), limits(0.06, 0.003, 0.003, 0.35), limits(0.01, 0.003, 0.003, 0.01)),
        # 0.076, 0.0019, 0.0013, 0.26; facing 0.0023, 0.0021, 0.0013, 0.0073.
        (
            HalfwayVectorDisk(radius=(0.6, 0.25), exponent=6.0, kd=0.2),
            limits(0.1, 0.003, 0.003, 0.4),
            limits(0.004, 0.003, 0.003, 0.009),
        ),
        # 0.042, 0.0027, 0.0022, 0.21; facing 0.0028, 0.0028, 0.0022, 0.0065.
        (
            HalfwayVectorDisk(radius=0.4, reciprocal=True),
            limits(0.07, 0.005, 0.004, 0.35),
            limits(0.005, 0.005, 0.004, 0.01),
        ),
    ],
    ids=["isotropic", "anisotropic", "reciprocal"],
)
def test_every_method_comes_near_the_reference(material, bounds, facing):
    """Near where cos_o > 0.6. Beyond, the lobe is a mirror: too sharp for 4096 lights, too far from a fixed pattern."""
    everywhere, there = method_errors(material), method_errors(material, cos_o=0.6)

    check_methods(everywhere, bounds)
    check_methods(there, facing)


@dataclass(frozen=True)
class ByHand:
    """What is summed over texels."""

    radius: tuple[float, float]
    exponent: float
    kd: float = 0.0
    reciprocal: bool = False
    radius_factor: float = 1.0
    bound: float = 2e-4

    def material(self):
        return HalfwayVectorDisk(
            radius=self.radius, exponent=self.exponent, ks=(0.9, 0.6, 0.2), kd=self.kd, reciprocal=self.reciprocal
        )

    def f(self, wo, wi):
        radius = tuple(r * self.radius_factor for r in self.radius)
        value = f_by_hand(np.broadcast_to(wo, wi.shape), wi, radius, self.exponent, self.reciprocal)
        return self.kd / pi + np.array([0.9, 0.6, 0.2]) * value[:, None]


BY_HAND = {
    "isotropic": ByHand((0.5, 0.5), 4.0, kd=0.3),
    "anisotropic": ByHand((0.8, 0.4), 4.0, bound=2.5e-3),
    "reciprocal": ByHand((0.5, 0.5), 4.0, reciprocal=True, bound=4e-3),
}


@pytest.mark.parametrize("name", BY_HAND)
def test_reference_is_the_exact_sum_over_texels(name):
    truth = extrapolated(BY_HAND[name], lights()["rough"])

    # The error of the sum by hand, k = 8 against 16: 1.3e-4, 1.6e-3 at grazing views, 2.7e-3 for the kink of the last.
    check_sum(truth, BY_HAND[name].material(), BY_HAND[name].bound)


def test_exact_sum_notices_a_radius_that_is_off_by_1_percent():
    wrong = extrapolated(replace(BY_HAND["isotropic"], radius_factor=1.01), lights()["rough"])

    with pytest.raises(AssertionError):
        check_sum(wrong, BY_HAND["isotropic"].material(), BY_HAND["isotropic"].bound)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"radius": 1.5}, r"halfway_vector_disk\.radius\[0\] must be less than or equal to 1, got 1\.5"),
        ({"exponent": -1.0}, r"halfway_vector_disk\.exponent must be greater than or equal to 0, got -1\.0"),
        ({"radii": 0.1}, r"halfway_vector_disk: unknown option 'radii'; did you mean 'radius'"),
    ],
)
def test_senseless_options_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        HalfwayVectorDisk.create(options)
