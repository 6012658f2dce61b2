"""The reference against exact summation over texels, and its standard error against the spread of seeds."""

from dataclasses import replace
from functools import cache
from itertools import pairwise
from math import pi, sqrt

import numpy as np
import pytest
import torch
from scipy.special import erfcx
from scipy.stats import f as f_distribution
from scipy.stats import t as student

from glossbench.brdf.kurt import Kurt
from glossbench.brdf.microfacet import Beckmann
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.lights.synthetic import Constant, SingleTexel
from glossbench.errors import InputError
from glossbench.scene.sphere import Sphere
from glossbench.truth import sampling as ground_truth
from glossbench.truth.reference import compute_reference
from glossbench.truth.sampling import N_REPLICATES
from oracles.grazing import AT_GRAZING, Grazing, integrate, light_at_grazing
from oracles.texel_sums import MATERIALS, VIEW, extrapolated, gauss_sum, lights, sum_texels
from oracles.z_scores import check_z, reference, z_limit

N_SEEDS = 20

# Each light and each material; the other pairs are tested below, more sharply or over 20 seeds.
CASES = [("rough", "kurt_anisotropic"), ("rough", "ggx_anisotropic"), ("spot", "kurt"), ("spot", "ggx_diffuse")]


@cache
def exact(light, material):
    return extrapolated(MATERIALS[material], lights()[light])


@cache
def find_seeds(light, material):
    """Radiance and standard error (S, P, 3) of 20 seeds."""
    runs = [reference(lights()[light], MATERIALS[material].material(), 4e-2, seed) for seed in range(N_SEEDS)]
    return np.stack([r[0] for r in runs]), np.stack([r[1] for r in runs])


@pytest.mark.parametrize(("light", "material"), CASES)
def test_reference_is_the_exact_sum_over_texels(light, material):
    truth = exact(light, material)

    radiance, standard_error = reference(lights()[light], MATERIALS[material].material())

    # The sum's own error, k = 8 against Gauss quadrature of order 12: 0.02 of a standard error at most.
    check_z(radiance, standard_error, truth)


@cache
def sharp():
    return reference(lights()["rough"], MATERIALS["ggx_diffuse"].material(), relative_error=1e-3)


@pytest.mark.parametrize("fault", ["alpha squared by 2 percent", "no cosine", "light upside down"])
def test_z_test_notices_a_fault_in_what_is_integrated(fault):
    faces, right = lights()["rough"].faces.double().numpy(), MATERIALS["ggx_diffuse"]

    wrong = {
        "alpha squared by 2 percent": lambda: sum_texels(replace(right, width_factor=sqrt(1.02)), faces),
        "no cosine": lambda: sum_texels(right, faces, cosine=False),
        "light upside down": lambda: sum_texels(right, faces[:, ::-1]),
    }[fault]()

    check_z(*sharp(), exact("rough", "ggx_diffuse"), n_tests=1)
    with pytest.raises(AssertionError):
        check_z(*sharp(), wrong, n_tests=1)


def test_z_test_notices_a_light_density_that_is_off_by_2_percent(monkeypatch):
    right = ground_truth.luminance_distribution
    scaled = lambda light, even: replace(right(light, even), density=1.02 * right(light, even).density)  # noqa: E731
    monkeypatch.setattr(ground_truth, "luminance_distribution", scaled)

    radiance, standard_error = reference(lights()["rough"], MATERIALS["ggx_diffuse"].material(), 2e-3)

    with pytest.raises(AssertionError):
        check_z(radiance, standard_error, exact("rough", "ggx_diffuse"), n_tests=1)


def test_z_test_notices_a_lobe_that_is_drawn_with_swapped_widths(monkeypatch):
    right = Beckmann.sample_points
    swapped = lambda self, u: right(replace(self, widths=self.widths[::-1]), u)  # noqa: E731
    monkeypatch.setattr(Beckmann, "sample_points", swapped)

    radiance, standard_error = reference(lights()["rough"], MATERIALS["kurt_anisotropic"].material(), 1e-2)

    with pytest.raises(AssertionError):
        check_z(radiance, standard_error, exact("rough", "kurt_anisotropic"), n_tests=1)


# Honesty of the standard error. All pixels share their sequences: seeds are the independent draws, not pixels.

SEED_CASES = [("rough", "kurt"), ("spot", "ggx_anisotropic")]


def check_squares(radiance, standard_error, truth):
    """Mean of z^2 over seeds: 15 / 13 for Student's t, within what the seeds' spread allows at 99.9 %."""
    squares = (((radiance - truth) / standard_error) ** 2).mean((1, 2))
    bound = student.isf(0.0005, N_SEEDS - 1) * squares.std(ddof=1) / sqrt(N_SEEDS)
    assert abs(squares.mean() - (N_REPLICATES - 1) / (N_REPLICATES - 3)) < bound


def check_spread(radiance, standard_error):
    """Variance over seeds by the mean square of the stated errors, each pixel: F of 19 and 20 x 15 degrees."""
    ratio = radiance.var(0, ddof=1) / (standard_error**2).mean(0)
    p = (1 - 0.99 ** (1 / (ratio.size * len(SEED_CASES)))) / 2
    degrees = N_SEEDS - 1, N_SEEDS * (N_REPLICATES - 1)
    assert f_distribution.ppf(p, *degrees) < ratio.min()
    assert ratio.max() < f_distribution.isf(p, *degrees)


@pytest.mark.parametrize(("light", "material"), SEED_CASES)
def test_standard_error_is_honest_over_20_seeds(light, material):
    radiance, standard_error = find_seeds(light, material)
    truth = exact(light, material)

    assert np.abs((radiance - truth) / standard_error).max() < z_limit(radiance.size * len(SEED_CASES))
    check_squares(radiance, standard_error, truth)
    check_spread(radiance, standard_error)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_honesty_checks_notice_a_standard_error_that_is_off_by_two(factor):
    radiance, standard_error = find_seeds("rough", "kurt")
    truth = exact("rough", "kurt")

    with pytest.raises(AssertionError):
        check_squares(radiance, factor * standard_error, truth)
    with pytest.raises(AssertionError):
        check_spread(radiance, factor * standard_error)


def test_same_seed_gives_the_same_bytes_and_another_seed_agrees_within_the_error():
    radiance, standard_error = find_seeds("rough", "kurt")

    again = reference(lights()["rough"], MATERIALS["kurt"].material(), 4e-2, seed=0)

    assert (again[0] == radiance[0]).all()
    assert (again[1] == standard_error[0]).all()
    assert (radiance[1] != radiance[0]).any()
    both = np.sqrt(standard_error[0] ** 2 + standard_error[1] ** 2)
    check_z(radiance[0], both, radiance[1], n_tests=1)


# Known lights.


def test_constant_light_returns_the_closed_form_albedo():
    """The one pixel of a 1 x 1 image looks along the normal: see the albedo of a Kurt lobe, F = 1."""
    m = 0.3
    tail = np.exp(-1 / m**2)
    lobe = (2 - m * m / 2) * sqrt(pi) / m * (erfcx(1 / m) - tail * erfcx(sqrt(2) / m)) + sqrt(2) * tail - 1
    material = Kurt(m=m, ks=0.5, kd=(0.4, 0.2, 0.1))

    truth = compute_reference(Constant(radiance=2.5).cubemap(), material, Sphere(resolution=1), 1e-4, method="sampling")

    expected = 2.5 * (0.5 * lobe + np.array([0.4, 0.2, 0.1]))
    check_z(truth.radiance[0, 0].numpy(), truth.standard_error[0, 0].numpy(), expected, n_tests=1)


@pytest.mark.parametrize("material", MATERIALS)
def test_constant_light_returns_the_exact_albedo_everywhere(material):
    light = Constant(radiance=(1.0, 2.0, 0.5), resolution=8).cubemap()
    truth = gauss_sum(MATERIALS[material], light, order=8)  # within 4e-4 of order 24: 0.04 of a standard error

    radiance, standard_error = reference(light, MATERIALS[material].material(), relative_error=1e-2)

    check_z(radiance, standard_error, truth, n_tests=len(MATERIALS))


def test_black_light_gives_exactly_zero():
    light = CubeMap(torch.zeros(6, 8, 8, 3))

    truth = compute_reference(light, Kurt(kd=0.5), VIEW, relative_error=1e-3, method="sampling")

    assert (truth.radiance == 0).all()
    assert (truth.standard_error == 0).all()
    assert (truth.noise, truth.mean) == (0, 0)


@pytest.mark.parametrize(("face", "row", "column"), [(4, 8, 7), (2, 0, 0), (1, 5, 15)])
def test_one_lit_texel_is_summed_exactly(face, row, column):
    """In the middle of a face, in a corner of the cube, at an edge."""
    light = SingleTexel(face=face, row=row, column=column, resolution=16).cubemap()
    glossy = MATERIALS["ggx_diffuse"]
    truth = gauss_sum(glossy, light)

    radiance, standard_error = reference(light, glossy.material(), relative_error=5e-3)

    # Below the horizon of the texel both are zero; 1e-12 replaces an error of zero.
    check_z(radiance, np.maximum(standard_error, 1e-12), truth, n_tests=3)


# What the caller asks for.


@pytest.mark.parametrize("relative_error", [3e-2, 1e-2, 3e-3])
def test_noise_target_is_met_or_the_samples_are_spent(relative_error):
    steps = []

    truth = compute_reference(
        lights()["rough"],
        MATERIALS["kurt"].material(),
        VIEW,
        relative_error,
        progress=lambda noise, n: steps.append((noise, n)),
        method="sampling",
    )

    # Each half of the replicates ends by the noise of the other one, so that the noise of both may be a little higher.
    assert truth.noise <= 1.3 * relative_error * truth.mean
    assert all(noise > relative_error / 1.3 for noise, _ in steps[:-1])
    assert steps[-1][1] == truth.n_samples
    assert all(before <= after <= 2 * before for (_, before), (_, after) in pairwise(steps))


def rounds():
    """Stands for `_round`: the first half of the replicates has no noise, and each round has its own mean."""
    made = []

    def one(points, tables, u):
        r, k = len(made) % N_REPLICATES, len(made) // N_REPLICATES
        made.append(r)
        noise = 0.0 if r < N_REPLICATES // 2 else 0.5 * (-1) ** r
        return torch.full((len(points), 3), len(u[0]) * (1 + k + noise), dtype=torch.float64)

    return one


def test_each_half_of_the_replicates_ends_by_the_noise_of_the_other(monkeypatch):
    monkeypatch.setattr(ground_truth, "_round", rounds())
    tables = ground_truth.build_tables(lights()["rough"], Kurt().reflectance(), None)
    kept = ground_truth.Checkpoint(None)

    means, n_samples = ground_truth.sample_points(
        Sphere(resolution=1).points(), tables, 1e-3, 4096, 0, lambda *progress: None, kept
    )

    half = N_REPLICATES // 2
    assert n_samples == (256 + 64) // 2 * N_REPLICATES * 2  # the second half ended after its first round
    assert means[half:].mean() == pytest.approx(1.0)
    assert means[:half].mean() == pytest.approx((64 * 1 + 64 * 2 + 128 * 3) / 256)


def two_lamps():
    """A sun at the left, and at the right a lamp of 1e-5 of its power."""
    faces = torch.zeros(6, 16, 16, 3)
    faces[1, 7, 7], faces[0, 8, 5] = 1e5, 1.0
    return CubeMap(faces, "two lamps")


def share_missed():
    """Of the pixels that the lamp alone lights: how many are black with an error of zero."""
    view = Sphere(resolution=16)
    truth = compute_reference(two_lamps(), Kurt(ks=0.0, kd=0.5), view, 0.5, method="sampling")
    x = torch.arange(16)
    of_lamp = truth.mask & (x >= 9)  # normals turned to the right, away from the sun
    missed = (truth.radiance == 0) & (truth.standard_error == 0)
    return float(missed[of_lamp].all(1).double().mean())


def test_a_lamp_opposite_a_sun_is_found():
    assert share_missed() <= 0.02


def test_without_the_even_share_it_is_missed(monkeypatch):
    """Twin of the above."""
    monkeypatch.setattr(ground_truth, "EVEN", 0.0)

    assert share_missed() >= 0.05


def test_samples_are_bounded():
    options = {"max_samples": 4096, "method": "sampling"}

    truth = compute_reference(lights()["spot"], MATERIALS["kurt"].material(), VIEW, 1e-9, **options)

    assert truth.n_samples == 2 * 4096  # light and lobe


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"relative_error": 0.0}, "relative_error must be above 0, got 0.0"),
        ({"relative_error": float("nan")}, "relative_error must be above 0, got nan"),
        ({"max_samples": 1023}, "max_samples must be at least 1024, got 1023"),
    ],
)
def test_senseless_demand_is_refused(options, message):
    with pytest.raises(InputError, match=message):
        compute_reference(lights()["rough"], Kurt(), VIEW, **options)


# Grazing views, and peaks of 1 : 100000, against product Gauss quadrature over the faces of the cube.


def reference_at_grazing(light, material, **options):
    shaded = light_at_grazing(light), AT_GRAZING[material].material(), Grazing()
    truth = compute_reference(*shaded, method="sampling", **options)
    return truth.radiance[0].numpy(), truth.standard_error[0].numpy()


# Each material under two lights, each light on three materials; other pairs with peaks are tested below, over 20 seeds.
GRAZING_CASES = [
    ("constant", "kurt"),
    ("constant", "cook_torrance"),
    ("constant", "phong"),
    ("rough", "kurt_anisotropic"),
    ("rough", "ggx"),
    ("rough", "phong"),
    ("disc in the lobe", "kurt"),
    ("disc in the lobe", "ggx_anisotropic"),
    ("disc in the lobe", "cook_torrance"),
    ("disc on the horizon", "kurt_anisotropic"),
    ("disc on the horizon", "ggx"),
    ("disc on the horizon", "ggx_anisotropic"),
]


@pytest.mark.parametrize(("light", "material"), GRAZING_CASES)
def test_reference_at_grazing_views_is_the_quadrature(light, material):
    truth = integrate(AT_GRAZING[material].f, light_at_grazing(light))

    radiance, standard_error = reference_at_grazing(light, material, relative_error=2e-3)

    # Orders 6 and 10 differ by 0.03 of a standard error, 0.10 for cook_torrance, whose masking has a kink.
    check_z(radiance, standard_error, truth, n_tests=len(GRAZING_CASES))


@pytest.mark.parametrize(
    "fault", ["alpha squared by 5 percent", "no cosine", "view a tenth lower", "light left is right"]
)
def test_z_test_notices_a_fault_at_grazing_views(fault):
    light, right = light_at_grazing("rough"), AT_GRAZING["ggx"]
    radiance, standard_error = reference_at_grazing("rough", "ggx", relative_error=2e-3)

    wrong = {
        "alpha squared by 5 percent": lambda: integrate(replace(right, width_factor=sqrt(1.05)).f, light),
        "no cosine": lambda: integrate(right.f, light, cosine=False),
        "view a tenth lower": lambda: integrate(lambda wo, wi: right.f(wo * [1, 1, 0.9], wi), light),
        "light left is right": lambda: integrate(right.f, CubeMap(light.faces.flip(2))),
    }[fault]()

    with pytest.raises(AssertionError):
        check_z(radiance, standard_error, wrong, n_tests=len(GRAZING_CASES))


PEAK_CASES = [("disc in the lobe", "ggx"), ("disc above", "kurt_anisotropic"), ("disc on the horizon", "phong")]


@cache
def peak_seeds(light, material):
    """Radiance and standard error (S, P, 3) of 20 seeds, of as many samples each.

    Where it is the noise that ends the sampling, the mean is a little low: seeds that missed the rare bright samples
    end sooner.
    """
    options = {"relative_error": 1e-9, "max_samples": 4096}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ground_truth, "FIRST_SAMPLES", 4096 // N_REPLICATES)  # at once, as no noise ends it sooner
        runs = [reference_at_grazing(light, material, seed=seed, **options) for seed in range(N_SEEDS)]
    return np.stack([r[0] for r in runs]), np.stack([r[1] for r in runs])


def check_mean(radiance, truth):
    """The mean over seeds: a Student's t of 19 degrees per pixel and channel."""
    t = (radiance.mean(0) - truth) / (radiance.std(0, ddof=1) / sqrt(N_SEEDS))
    assert np.abs(t).max() < student.isf((1 - 0.99 ** (1 / (t.size * len(PEAK_CASES)))) / 2, N_SEEDS - 1)


@pytest.mark.parametrize(("light", "material"), PEAK_CASES)
def test_under_a_peak_of_1e5_the_mean_is_right_and_the_standard_error_honest(light, material):
    radiance, standard_error = peak_seeds(light, material)
    truth = integrate(AT_GRAZING[material].f, light_at_grazing(light))

    check_mean(radiance, truth)
    check_squares(radiance, standard_error, truth)
    assert np.abs((radiance - truth) / standard_error).max() < z_limit(radiance.size * len(PEAK_CASES))


@pytest.mark.parametrize(("light", "material"), PEAK_CASES)
def test_mean_over_seeds_notices_a_peak_that_is_off_by_3_percent(light, material):
    radiance, _ = peak_seeds(light, material)
    truth = integrate(AT_GRAZING[material].f, light_at_grazing(light))

    with pytest.raises(AssertionError):
        check_mean(radiance, 1.03 * truth)
