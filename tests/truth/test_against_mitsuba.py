"""The reference of a sphere against Mitsuba 3: two programs that share the light's texels and nothing else."""

from functools import cache

import numpy as np
import pytest

import glossbench as gb
from glossbench.brdf.ggx import TrowbridgeReitz
from glossbench.envmap.cubemap import CubeMap
from glossbench.truth import sampling as ground_truth
from glossbench.truth.reference import compute_reference
from oracles.mitsuba_agreement import LIGHTS, check_agreement, light_of, their_light
from oracles.mitsuba_side import conductor, cook_torrance, diffuse, emitter, ggx, interpolant, kurt, mi, phong, render

VIEW = gb.view("sphere", resolution=10)  # 80 pixels, n . wo from 0.14 to 0.99

COPPER = (0.9, 0.6, 0.2)
# Ours by name and options, theirs.
MATERIALS = {
    "diffuse": (("kurt", {"ks": 0.0, "kd": (0.8, 0.5, 0.2)}), lambda: diffuse((0.8, 0.5, 0.2))),
    "ggx": (("ggx", {"alpha": 0.5}), lambda: ggx((0.5, 0.5))),
    "ggx_anisotropic": (("ggx", {"alpha": (0.4, 0.12), "f0": COPPER}), lambda: ggx((0.4, 0.12), COPPER)),
    "kurt": (("kurt", {"m": 0.2, "shadowing": 0.3}), lambda: kurt((0.2, 0.2), shadowing=0.3)),
    "kurt_anisotropic": (
        ("kurt", {"m": (0.4, 0.15), "f0": COPPER, "kd": (0.1, 0.2, 0.4)}),
        lambda: kurt((0.4, 0.15), COPPER, kd=(0.1, 0.2, 0.4)),
    ),
    "cook_torrance": (("cook_torrance", {"m": 0.25, "f0": COPPER}), lambda: cook_torrance((0.25, 0.25), COPPER)),
    "cook_torrance_anisotropic": (("cook_torrance", {"m": (0.5, 0.15)}), lambda: cook_torrance((0.5, 0.15))),
    "phong": (
        ("phong", {"s": 30.0, "ks": (0.6, 0.5, 0.4), "kd": (0.1, 0.2, 0.4)}),
        lambda: phong(30, (0.6, 0.5, 0.4), (0.1, 0.2, 0.4)),
    ),
}
# Each material, each light, and what the faults below are planted in.
CASES = [
    ("diffuse", "gradient"),
    ("diffuse", "orientation"),
    ("diffuse", "grace"),
    ("ggx", "gradient"),
    ("ggx", "spots"),
    ("ggx_anisotropic", "orientation"),
    ("kurt", "orientation"),
    ("kurt_anisotropic", "grace"),
    ("cook_torrance", "spots"),
    ("cook_torrance_anisotropic", "orientation"),
    ("phong", "spots"),
]


@cache
def theirs(material, light):
    """Radiance (S, P, 3) of Mitsuba's renders."""
    return render(their_light(light), MATERIALS[material][1](), VIEW.resolution)


def ours(material, light):
    """Radiance and standard error (P, 3)."""
    name, options = material
    truth = compute_reference(light, gb.material(name, **options), VIEW, 1e-2, method="sampling")
    return truth.radiance[truth.mask].numpy(), truth.standard_error[truth.mask].numpy()


@pytest.fixture
def files(shared_data, monkeypatch):
    monkeypatch.setenv("GLOSSBENCH_DATA", str(shared_data))


def having_files(light, request):
    if light == "grace":
        request.getfixturevalue("files")


@pytest.mark.parametrize(("material", "light"), CASES)
def test_reference_of_a_sphere_is_the_image_of_mitsuba(material, light, request):
    having_files(light, request)

    radiance, standard_error = ours(MATERIALS[material][0], light_of(light))

    # Median error of a pixel: Mitsuba's 1.8 % to 7.1 %, ours 0.3 % to 0.9 %. Largest |z| 3.9, z^2 0.86 to 1.14.
    check_agreement(radiance, standard_error, theirs(material, light), len(CASES))


# Faults planted on our side.


def squared_alpha(monkeypatch):
    return ("ggx", {"alpha": 0.5**2}), light_of("gradient")


def swapped_axes(monkeypatch):
    return ("ggx", {"alpha": (0.12, 0.4), "f0": COPPER}), light_of("orientation")


def mirrored_light(monkeypatch):
    return MATERIALS["diffuse"][0], CubeMap(light_of("orientation").faces[[1, 0, 2, 3, 4, 5]].flip(2), "mirrored")


def dropped_cosine(monkeypatch):
    right = ground_truth._balanced

    def without_cosine(reflectance, wo, wi, light_pdf):
        return tuple(w / wi.z.clamp(min=1e-6) for w in right(reflectance, wo, wi, light_pdf))

    monkeypatch.setattr(ground_truth, "_balanced", without_cosine)
    return MATERIALS["diffuse"][0], light_of("gradient")


def separable_shadowing(monkeypatch):
    def V(self, wo, wi, h, c):
        return 1 / ((1 + self._lambda(wo)) * (1 + self._lambda(wi)) * 4 * wo.z * wi.z)

    monkeypatch.setattr(TrowbridgeReitz, "V", V)
    return MATERIALS["ggx"][0], light_of("gradient")


def light_two_percent_too_bright(monkeypatch):
    return MATERIALS["diffuse"][0], CubeMap(light_of("orientation").faces * 1.02, "bright")


FAULTS = [
    (squared_alpha, "ggx", "gradient"),
    (swapped_axes, "ggx_anisotropic", "orientation"),
    (mirrored_light, "diffuse", "orientation"),
    (dropped_cosine, "diffuse", "gradient"),
    (separable_shadowing, "ggx", "gradient"),
    (light_two_percent_too_bright, "diffuse", "orientation"),
]


@pytest.mark.parametrize(("fault", "material", "light"), FAULTS)
def test_agreement_notices_a_fault(fault, material, light, monkeypatch):
    radiance, standard_error = ours(*fault(monkeypatch))

    with pytest.raises(AssertionError):
        check_agreement(radiance, standard_error, theirs(material, light), len(CASES))


# That both are given the same.


def residual(environment, light):
    """Largest part of Mitsuba's light that ours lacks, of lobes cos and cos^30 about 156 axes, from its own draws.

    Of a lobe's brightest channel, as another may have no light there.
    """
    exact = interpolant(light_of(light).faces.double().numpy())
    draws = [environment.sample_direction(mi.Interaction3f(), u)[0] for u in np.random.default_rng(0).random((5000, 2))]
    d, density = np.array([s.d for s in draws], dtype=float), np.array([[s.pdf] for s in draws])
    light_there = np.array([environment.eval_direction(mi.Interaction3f(), s) for s in draws], dtype=float)
    axes = np.random.default_rng(1).standard_normal((156, 3))
    cosines = (axes / np.linalg.norm(axes, axis=1, keepdims=True) @ d.T).clip(min=0)
    lobes = np.concatenate([cosines, cosines**30])
    lacking, total = lobes @ ((light_there - exact(d)) / density), lobes @ (light_there / density)
    return (np.abs(lacking).max(1) / total.max(1)).max()


@pytest.mark.parametrize("light", LIGHTS)
def test_mitsubas_light_is_our_interpolant_far_below_the_noise(light, request):
    having_files(light, request)

    share = residual(their_light(light), light)

    # Measured 8e-6, 9e-4, 9e-5, 1.9e-3 in the order of the lights; standard errors of a pixel are 1.5e-2 and more.
    assert share < 3e-3


def test_residual_notices_a_light_too_coarse_for_its_spots():
    coarse = emitter(interpolant(light_of("spots").faces.double().numpy()), height=257)

    assert residual(coarse, "spots") > 3e-3


def test_formula_with_separable_shadowing_is_mitsubas_own_conductor():
    alpha = (0.4, 0.12)
    own, formula = mi.load_dict(conductor("ggx", alpha)), ggx(alpha, separable=True)
    context, seen = mi.BSDFContext(), mi.SurfaceInteraction3f()
    d = np.random.default_rng(2).standard_normal((500, 2, 3))
    d[..., 2] = np.abs(d[..., 2])

    pairs = []
    for o, i in d / np.linalg.norm(d, axis=2, keepdims=True):
        seen.wi = mi.Vector3f(o)
        pairs.append([bsdf.eval(context, seen, mi.Vector3f(i))[0] for bsdf in (formula, own)])

    # Measured 0.
    np.testing.assert_allclose(*np.transpose(pairs), rtol=1e-5)
