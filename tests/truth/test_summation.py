"""The reference as a sum, against Gauss quadrature by hand, sampling, closed forms and finer sums."""

from dataclasses import replace
from functools import cache
from math import pi, sqrt

import numpy as np
import pytest
import torch
from scipy.special import erfcx

import glossbench as gb
from glossbench.brdf.kurt import Kurt
from glossbench.brdf.material import MATERIALS as MODELS
from glossbench.brdf.phong import Phong
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.lights.synthetic import Constant, SingleTexel
from glossbench.errors import InputError
from glossbench.scene.points import Occluder
from glossbench.scene.sphere import Sphere
from glossbench.truth import block_sums, blocks, checkpoint, pilot, reference, summation
from glossbench.truth.blocks import build_light_blocks
from glossbench.truth.jackknife import jackknife
from glossbench.truth.reference import compute_reference
from oracles.grazing import AT_GRAZING, Grazing, integrate, light_at_grazing
from oracles.texel_sums import MATERIALS, VIEW, gauss_sum, lights
from oracles.z_scores import reference as sampled
from oracles.z_scores import z_limit

TARGET = 3e-4
COVERED = 0.95  # share of pixels and channels whose true error is below the stated one


def summed(light, material, view=VIEW, relative_error=TARGET, **options):
    """Radiance and stated error (P, 3)."""
    truth = compute_reference(light, material, view, relative_error, method="summation", **options)
    return truth.radiance[truth.mask].numpy(), truth.standard_error[truth.mask].numpy()


def check_error(radiance, error, exact, largest=4.0):
    """The stated error holds the true one, which is at most a few times larger at single pixels."""
    off = np.abs(radiance - exact)
    assert (off <= error).mean() >= COVERED
    assert (off <= largest * error + 1e-12).all()


# Against quadrature that shares no code.


@cache
def by_hand(light, material):
    return gauss_sum(MATERIALS[material], lights()[light], order=4)


@pytest.mark.parametrize(
    ("light", "material"),
    [*((light, name) for name in MATERIALS for light in ["rough"]), ("spot", "ggx_anisotropic"), ("spot", "kurt")],
)
def test_sum_is_the_quadrature_by_hand(light, material):
    radiance, error = summed(lights()[light], MATERIALS[material].material())

    check_error(radiance, error, by_hand(light, material))
    assert np.sqrt((error**2).mean()) <= TARGET * radiance.mean()


@pytest.mark.parametrize("resolution", [32, 64])
def test_finer_cubes_are_summed_as_exactly(resolution):
    faces = torch.rand(6, resolution, resolution, 3, generator=torch.Generator().manual_seed(5)) ** 6
    glossy = MATERIALS["kurt"]

    radiance, error = summed(CubeMap(faces), glossy.material())

    check_error(radiance, error, gauss_sum(glossy, CubeMap(faces), order=3))


GRAZING_CASES = [
    ("constant", "kurt"),
    ("constant", "ggx"),
    ("rough", "ggx_anisotropic"),
    ("rough", "phong"),
    ("disc in the lobe", "ggx"),
    ("disc on the horizon", "kurt"),
    ("disc on the horizon", "cook_torrance"),
]


@pytest.mark.parametrize(("light", "material"), GRAZING_CASES)
def test_sum_at_grazing_views_is_the_quadrature_by_hand(light, material):
    exact = integrate(AT_GRAZING[material].f, light_at_grazing(light))

    radiance, error = summed(light_at_grazing(light), AT_GRAZING[material].material(), Grazing())

    # Five pixels of three channels that nearly agree: one pixel outside is 20 % of them.
    off = np.abs(radiance - exact)
    assert (off <= error).mean() >= 0.8
    assert (off <= 4 * error).all()


def _replicated(faces, width=1):
    flat = faces.permute(0, 3, 1, 2)
    return torch.nn.functional.pad(flat, (width,) * 4, mode="replicate").permute(0, 2, 3, 1)


def _linear(*arguments, right=block_sums._expand):
    g = right(*arguments).clone()
    g[:, 4:] = 0
    return g


def _all_but_one(n_points, device, right=summation._pair_all_blocks):
    pairs = right(n_points, device)
    return pairs.where(pairs.block(1) != 17)


FAULTS = {
    "a power of the Jacobian": (block_sums, "_compute_jacobian", lambda inverse: inverse**2),
    "a block left out": (summation, "_pair_all_blocks", _all_but_one),
    "an order too low": (block_sums, "_expand", _linear),
    "a seam between faces": (blocks, "add_border", _replicated),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_that_check_notices(fault, monkeypatch):
    monkeypatch.setattr(*FAULTS[fault])

    radiance, error = summed(lights()["rough"], MATERIALS["ggx_anisotropic"].material())

    with pytest.raises(AssertionError):
        check_error(radiance, error, by_hand("rough", "ggx_anisotropic"))


# Against sampling: every model, suns of 1 : 160000, a lobe as narrow as a texel.


def sun():
    faces = torch.ones(6, 16, 16, 3)
    faces[4, 5, 6], faces[2, 15, 0] = 160000.0, torch.tensor([0.0, 5e4, 1e5])
    return CubeMap(faces, "sun")


OPTIONS = {
    "sum": {"of": [{"kurt": {"m": 0.1}}, {"phong": {"s": 20}}], "weights": [0.5, 0.3]},
    "lafortune": {"C": [-0.8, -0.9, 1.0], "s": 12.0, "kd": 0.2},
    "ward": {"m": [0.3, 0.1]},
    "ggx": {"alpha": 0.01, "f0": [0.9, 0.5, 0.1]},
    "cook_torrance": {"m": 0.3, "kd": 0.3},
}
FROM_FILES = {"measured", "mystique", "satin_rosaline_rgb", "cayman", "ngan"}
Z_CASES = [("rough", name) for name in MODELS.names() if name not in FROM_FILES] + [("sun", "kurt"), ("sun", "ggx")]


def check_against_sampling(light, material, n_tests, relative_error=TARGET):
    radiance, error = summed(light, material, relative_error=relative_error)
    mean, standard_error = sampled(light, material, 1e-2)
    # At a pixel whose light no sample met, the standard error of sampling is 0.
    both = np.sqrt(standard_error**2 + error**2)
    assert (np.abs(mean - radiance) / both).max() < z_limit(mean.size * n_tests)


@pytest.mark.parametrize(("light", "name"), Z_CASES)
def test_sum_and_samples_agree(light, name):
    light = sun() if light == "sun" else lights()["rough"]

    check_against_sampling(light, MODELS.create(name, OPTIONS.get(name, {})), len(Z_CASES))


def test_sum_and_samples_of_a_measured_material_agree(shared_data, monkeypatch):
    monkeypatch.setenv("GLOSSBENCH_DATA", str(shared_data))

    check_against_sampling(lights()["rough"], gb.material("mystique"), 1, relative_error=1e-2)


# Known lights.


def test_constant_light_returns_the_closed_form_albedo():
    """The one pixel of a 1 x 1 image looks along the normal: see the albedo of a Kurt lobe, F = 1."""
    m = 0.3
    tail = np.exp(-1 / m**2)
    lobe = (2 - m * m / 2) * sqrt(pi) / m * (erfcx(1 / m) - tail * erfcx(sqrt(2) / m)) + sqrt(2) * tail - 1
    material = Kurt(m=m, ks=0.5, kd=(0.4, 0.2, 0.1))

    radiance, error = summed(Constant(radiance=2.5).cubemap(), material, Sphere(resolution=1), 2e-5)

    check_error(radiance, error, 2.5 * (0.5 * lobe + np.array([0.4, 0.2, 0.1])))


@pytest.mark.parametrize("m", [0.3, 0.01, 1e-3])
def test_a_lobe_of_any_width_returns_its_albedo(m):
    """Where the lobe is wide, f and its sampler agree to 3e-5 in the middle of the image."""
    material, view = Kurt(m=m), Sphere(resolution=4, coverage=0.3)
    points = view.points()

    radiance, _ = summed(Constant(resolution=32).cubemap(), material, view, 1e-4)

    expected = material.albedo(points.wo_local(), 1 << 16).numpy()
    assert np.abs(radiance - expected).max() < 2e-4


def test_without_the_samples_of_the_lobe_a_narrow_one_would_be_missed(monkeypatch):
    none = lambda self, level: torch.zeros(0, dtype=torch.long)  # noqa: E731
    monkeypatch.setattr(summation.Seeds, "blocks", none)

    radiance, _ = summed(Constant(resolution=32).cubemap(), Kurt(m=1e-3), Sphere(resolution=4), 1e-4)

    assert radiance.min() < 0.5


def test_black_light_gives_exactly_zero():
    radiance, error = summed(CubeMap(torch.zeros(6, 8, 8, 3)), Kurt(kd=0.5))

    assert (radiance == 0).all()
    assert (error == 0).all()


def test_one_lit_texel_in_a_corner_of_the_cube_is_summed():
    light = SingleTexel(face=2, row=0, column=0, resolution=16).cubemap()
    glossy = MATERIALS["ggx_diffuse"]

    radiance, error = summed(light, glossy.material())

    check_error(radiance, error, gauss_sum(glossy, light))


# The stated error.


@pytest.mark.parametrize("name", ["kurt", "ggx", "cook_torrance"])
def test_the_stated_error_holds_the_difference_to_a_much_finer_sum(name):
    """At the accuracy of a study, under a light of few bright texels."""
    light, view = gb.light("spots", seed=7, resolution=32), Sphere(resolution=8)
    material = MODELS.create(name, {})

    finer, _ = summed(light, material, view, 1e-4)

    check_error(*summed(light, material, view, 2.5e-3), finer)


def test_an_error_without_its_factor_would_be_noticed(monkeypatch):
    """Twin of the checks above: a tenth of the stated error, under the light that has kinks at every texel."""
    monkeypatch.setattr(summation, "SAFETY", 0.1 * summation.SAFETY)
    monkeypatch.setattr(summation, "ROUNDING", 0.0)
    material = MATERIALS["ggx_diffuse"]

    radiance, error = summed(lights()["rough"], material.material())

    with pytest.raises(AssertionError):
        check_error(radiance, error, by_hand("rough", "ggx_diffuse"))


def test_groups_of_a_sum_give_the_stated_error_to_the_jackknife():
    """For a linear number: here the mean, whose change under the error, with its signs, is known."""
    truth = compute_reference(lights()["rough"], MATERIALS["kurt"].material(), VIEW, 1e-2, method="summation")

    values = [float(one.radiance[one.mask].mean()) for one in truth.left_out()]

    bias, variance = jackknife(truth.mean, values)
    moved = (truth.deviates[0].sign() * truth.standard_error)[truth.mask].mean()
    assert bias == pytest.approx(0, abs=1e-9 * truth.mean)
    assert sqrt(variance) == pytest.approx(abs(float(moved)), rel=1e-3)


# What the caller asks for.


def test_auto_takes_the_sum_where_nothing_hides_the_light():
    truth = compute_reference(lights()["rough"], Kurt(), VIEW, 1e-2)

    assert truth.method == "summation"
    assert truth.noise <= 1e-2 * truth.mean


class Chosen(Exception):
    """Stands for a reference that begins."""


def method_under_one_texel(monkeypatch):
    """What auto takes where a narrow lobe shows one lit texel of 98304 at few of 51468 points."""

    def choose(name):
        def begin(*given):
            raise Chosen(name)

        return begin

    for name in ("sum", "sample"):
        monkeypatch.setattr(reference, f"{name}_points", choose(name))
    with pytest.raises(Chosen) as chosen:
        compute_reference(
            SingleTexel(resolution=128).cubemap(), Phong(s=512.0, foreshortening=False), Sphere(resolution=256), 2e-2
        )
    return str(chosen.value)


def test_auto_takes_the_sum_where_few_points_see_the_light(monkeypatch):
    """Measured: 23 s for the sum, beside other work; samples had 12 % of noise after 8192, for a target of 2 %."""
    assert method_under_one_texel(monkeypatch) == "sum"


def test_points_that_are_chosen_evenly_would_take_samples(monkeypatch):
    monkeypatch.setattr(pilot, "estimate_radiance", lambda points, *rest: torch.ones(len(points)))

    assert method_under_one_texel(monkeypatch) == "sample"


def check_mean(choose):
    """The mean of n_z^400 over the disc is 1 / 201, and the texel is seen where n_z is nearly 1."""
    light, points = build_light_blocks(SingleTexel(resolution=128).cubemap()), Sphere(resolution=256).points()
    chosen = choose(points, Phong(s=256.0).reflectance(), light)
    n_z = chosen.points.n.z.double()[:, None]
    assert float(chosen.mean(n_z**400)) == pytest.approx(
        1 / 201, rel=0.2
    )  # about 43 of 8578 candidates see it; measured 8 %
    assert float(chosen.mean(torch.ones_like(n_z))) == pytest.approx(1, rel=0.03)
    return chosen


def test_points_that_are_drawn_by_what_they_see_have_the_mean_of_all():
    assert check_mean(pilot.choose_pilot).share is not None


def test_the_check_of_their_mean_notices_that_all_count_alike():
    with pytest.raises(AssertionError):
        check_mean(lambda *given: replace(pilot.choose_pilot(*given), share=None))


def test_where_even_points_see_the_light_they_are_the_pilot():
    points = Sphere(resolution=64).points()

    chosen = pilot.choose_pilot(points, Kurt(m=0.3).reflectance(), build_light_blocks(lights()["rough"]))

    assert chosen.share is None
    assert (chosen.points.n.x == points.n.x[:: len(points) // pilot.POINTS]).all()


def test_a_sum_stops_at_the_largest_number_of_samples():
    truth = compute_reference(lights()["rough"], MATERIALS["ggx_diffuse"].material(), VIEW, 1e-7, 1024,
                              method="summation")  # fmt: skip

    assert truth.noise > 1e-7 * truth.mean
    assert truth.n_samples < 4 * 3 * 1024  # a level is finished: up to four times the blocks


def test_an_unknown_method_is_refused():
    with pytest.raises(InputError, match=r"reference\.method must be one of auto, summation, sampling, got 'exact'"):
        compute_reference(lights()["rough"], Kurt(), VIEW, method="exact")


class Hiding(Grazing):
    """A view whose points hide light from each other."""

    name = "hiding"

    def scene(self):
        return Occluder()


def test_a_view_that_hides_light_cannot_be_summed():
    with pytest.raises(InputError, match="summation needs a view that hides no light from its points, not hiding"):
        compute_reference(lights()["rough"], Kurt(), Hiding(), method="summation")


class Killed(Exception):
    """Stands for the end of the process."""


def test_a_killed_sum_goes_on_to_the_same_bytes(tmp_path, monkeypatch):
    monkeypatch.setattr(summation, "CHUNK", 10)
    right, saved = checkpoint.Checkpoint.save, []

    def save(self, sums, done):
        right(self, sums, done)
        saved.append(list(done))
        if len(saved) == 2:
            raise Killed

    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, "INTERVAL", 0.0)
        patch.setattr(checkpoint.Checkpoint, "save", save)
        with pytest.raises(Killed):
            summed(lights()["rough"], Kurt(), checkpoint=tmp_path)
    calls = []

    resumed = summed(lights()["rough"], Kurt(), checkpoint=tmp_path, progress=lambda noise, n: calls.append(n))

    assert len(calls) == 2  # of 4 chunks
    assert [a.tobytes() for a in resumed] == [a.tobytes() for a in summed(lights()["rough"], Kurt())]
    assert not list(tmp_path.iterdir())


def test_blocks_of_a_light_have_its_mean():
    light = lights()["rough"]

    tables = build_light_blocks(light).tables

    edge = tables[0][:, 0]  # mean over a face, unweighted by solid angle
    finest = tables[-1][:, 0].view(6, -1, 3).mean(1)
    assert torch.allclose(edge, finest, rtol=1e-5)
