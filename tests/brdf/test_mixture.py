"""Sums of materials: their parts weighted and added, and how a study states them."""

from functools import cache
from math import pi

import pytest
import torch

from glossbench.brdf.ggx import GGX
from glossbench.brdf.kurt import Kurt
from glossbench.brdf.lafortune import Lafortune
from glossbench.brdf.material import MATERIALS
from glossbench.brdf.mixture import Sum
from glossbench.brdf.phong import Phong
from glossbench.catalog.entries import list_entries
from glossbench.directions import Vec3, points_2d
from glossbench.envmap.lights.synthetic import Gradient
from glossbench.errors import InputError
from glossbench.methods.environment_sampling import EnvironmentSampling
from glossbench.methods.filtered_importance_sampling import FilteredImportanceSampling
from glossbench.methods.importance_sampling import ImportanceSampling
from glossbench.methods.regular_sampling import RegularSampling
from glossbench.scene.sphere import Sphere
from glossbench.shading.image import shade
from glossbench.shading.stage_cache import StageCache
from glossbench.study.schema import schema
from glossbench.study.study import load_study
from glossbench.truth.reference import compute_reference
from oracles.hemisphere import random_hemisphere, vectors
from oracles.texel_sums import Glossy, check_sum, extrapolated, lights

PARTS = (
    Kurt(m=(0.2, 0.4), f0=(0.9, 0.6, 0.2), kd=0.1),
    Phong(s=20, ks=0.3),
    GGX(alpha=0.3, kd=(0.1, 0.2, 0.3)),
    Lafortune(lobes=({"C": (-1.0, -1.0, 0.9), "s": 9.0}, {"s": 30.0, "ks": (0.1, 0.2, 0.3)})),
)
WEIGHTS = (0.7, 0.3, 0.2, 1.5)


def built_in():
    """Every material whose options have defaults and that needs no file."""
    made = []
    for name in sorted(set(MATERIALS.names()) - {entry.name for entry in list_entries("brdf")}):
        try:
            made.append(MATERIALS.create(name, {}))
        except InputError:
            continue
    return made


def rgb(channels):
    return torch.stack(torch.broadcast_tensors(*channels)).expand(3, -1)


# What it means


def check_is_weighted_sum(total, parts, weights):
    wo, wi = vectors(random_hemisphere(500, 1)), vectors(random_hemisphere(500, 2))

    f, albedo = rgb(total.f(wo, wi)), total.albedo(wo, n_samples=256)

    expected = sum(w * rgb(part.f(wo, wi)) for part, w in zip(parts, weights, strict=True))
    albedos = sum(w * part.albedo(wo, n_samples=256) for part, w in zip(parts, weights, strict=True))
    # Measured: 2.4e-7 and 1.2e-8, float32 products in another order.
    torch.testing.assert_close(f, expected, rtol=2e-6, atol=0)
    torch.testing.assert_close(albedo, albedos, rtol=1e-7, atol=0)


def test_value_and_albedo_are_the_weighted_sums_of_the_parts():
    check_is_weighted_sum(Sum(of=PARTS, weights=WEIGHTS), PARTS, WEIGHTS)


@pytest.mark.parametrize("wrong", [WEIGHTS[::-1], (0.7, 0.3, 0.2, 1.5001), (1.0, 1.0, 1.0, 1.0)])
def test_weighted_sum_notices_other_weights(wrong):
    with pytest.raises(AssertionError):
        check_is_weighted_sum(Sum(of=PARTS, weights=wrong), PARTS, WEIGHTS)


def test_weights_that_are_not_stated_are_one_each():
    check_is_weighted_sum(Sum(of=PARTS), PARTS, (1.0,) * 4)


@pytest.mark.parametrize("material", built_in(), ids=lambda m: m.name)
def test_weight_scales_what_every_model_gives(material):
    """Value, density and samples of each lobe: its ks is a factor of the whole."""
    wo, wi = (Vec3(*(c[:, None] for c in vectors(random_hemisphere(200, seed)))) for seed in (3, 4))
    lobes = material.reflectance().lobes

    scaled = Sum(of=(material,), weights=(0.25,)).reflectance().lobes

    for lobe, quarter in zip(lobes, scaled, strict=True):
        points = lobe.sample_points(points_2d(64))
        for whole, part in zip(lobe.f(wo, wi), quarter.f(wo, wi), strict=True):
            torch.testing.assert_close(part, whole / 4, rtol=1e-6, atol=1e-30)
        for whole, part in zip(lobe.sample(wo, points).weight, quarter.sample(wo, points).weight, strict=True):
            torch.testing.assert_close(part, whole / 4, rtol=1e-6, atol=1e-30)
        assert (lobe.pdf(wo, wi) == quarter.pdf(wo, wi)).all()


def test_a_sum_of_sums_is_flat():
    inner = Sum(of=(PARTS[0], PARTS[1]), weights=(0.5, 2.0))

    check_is_weighted_sum(Sum(of=(inner, PARTS[2]), weights=(0.4, 0.2)), PARTS[:3], (0.2, 0.8, 0.2))


def test_budget_is_shared_by_weight_times_strength():
    material = Sum(of=("kurt", {"phong": {"ks": 0.5}}), weights=(0.6, 0.8))

    assert material.reflectance().share(50) == [30, 20]


def test_a_sum_without_diffuse_parts_has_none():
    assert Sum(of=("kurt", "phong")).reflectance().diffuse == ()


def test_diffuse_parts_of_a_sum_add_up_in_colour():
    material = Sum(of=({"kurt": {"kd": 0.4}}, {"phong": {"kd": [0.1, 0.2, 0.3]}}), weights=(0.5, 2.0))

    f = [channel.item() for channel in material.reflectance().diffuse_f()]

    assert f == pytest.approx([0.4 / pi, 0.6 / pi, 0.8 / pi], rel=1e-6)


# With everything that shades

VIEW, CACHE = Sphere(resolution=32), StageCache()
SMOOTH = Gradient(resolution=32).cubemap()
MIXED = Sum(
    of=({"kurt": {"m": (0.1, 0.3)}}, {"phong": {"s": 40, "ks": 0.5, "kd": 0.2}}, {"lafortune": {"C": (0.9, 0.9, 1)}}),
    weights=(0.5, 0.6, 0.2),
)
# RMS error over the mean, measured: regular sampling's pattern is cut off, the filter blurs, the rest is noise.
METHODS = {
    "regular_sampling": (RegularSampling(samples=120, xi=0.01, normalisation="exact"), 0.025),
    "filtered_importance_sampling": (FilteredImportanceSampling(samples=256), 0.0059),
    "importance_sampling": (ImportanceSampling(samples=1024), 0.0007),
    "environment_sampling": (EnvironmentSampling(samples=4096), 0.0048),
}


@cache
def truth():
    return compute_reference(SMOOTH, MIXED, VIEW, relative_error=1e-3)


def error_of(method, material):
    right = truth()
    image = shade(method, SMOOTH, material, VIEW, cache=CACHE, time_it=False)
    return float((image.radiance - right.radiance)[right.mask].square().mean().sqrt()) / right.mean


@pytest.mark.parametrize("name", METHODS)
def test_every_method_shades_a_sum_under_a_smooth_light(name):
    method, measured = METHODS[name]

    error = error_of(method, MIXED)

    assert error < 1.5 * measured + truth().noise / truth().mean


@pytest.mark.parametrize("name", METHODS)
def test_smooth_light_notices_a_weight_that_is_off_by_a_tenth(name):
    method, measured = METHODS[name]

    error = error_of(method, Sum(of=MIXED.of, weights=(0.6, 0.6, 0.2)))

    assert error > 1.5 * measured + truth().noise / truth().mean


def test_reference_of_a_sum_is_the_sum_of_exact_sums_over_texels():
    kurt, ggx = Glossy("kurt", (0.4, 0.15), kd=(0.2, 0.2, 0.2)), Glossy("ggx", (0.2, 0.2), (0.04, 0.04, 0.04))
    light = lights()["rough"]
    exact = 0.6 * extrapolated(kurt, light) + 1.5 * extrapolated(ggx, light)

    def check(weights):
        material = Sum(of=(kurt.material(), ggx.material()), weights=weights)
        check_sum(exact, material)

    check((0.6, 1.5))
    with pytest.raises(AssertionError):
        check((0.62, 1.5))


# Options

KURT = {"kurt": {"m": 0.1}}
REFUSED = [
    ({}, "sum: option 'of' is required"),
    ({"of": []}, "sum.of needs at least one material"),
    ({"of": [3]}, "sum.of[0] must be a material's name, or one name with its options, got 3"),
    ({"of": [{**KURT, "phong": {}}]}, "sum.of[0] must be a material's name, or one name with its options, got "),
    ({"of": [{"kurt": 3}]}, "sum.of[0] must be a material's name, or one name with its options, got {'kurt': 3}"),
    ({"of": ["ggx", "kurrt"]}, "sum.of[1]: unknown material 'kurrt'; did you mean 'kurt'?"),
    ({"of": [{"kurt": {"n": 1}}]}, "sum.of[0]: kurt: unknown option 'n'; "),
    ({"of": ["ggx", {"kurt": {"m": 1.4}}]}, "sum.of[1]: kurt.m[0] must be less than or equal to 1, got 1.4"),
    ({"of": ["kurt"] * 17}, "sum.of must have at most 16 lobes in total, got 17"),
    ({"of": ["kurt"], "weights": [1, 2]}, "sum.weights must have one weight per material, 1, got 2"),
    ({"of": ["kurt"], "weights": [-1]}, "sum.weights[0] must be greater than or equal to 0, got -1"),
    ({"of": ["kurt"], "wieghts": [1]}, "sum: unknown option 'wieghts'; did you mean 'weights'?"),
]


@pytest.mark.parametrize(("options", "message"), REFUSED)
def test_bad_options_are_refused_and_the_inner_option_is_named(options, message):
    with pytest.raises(InputError) as raised:
        Sum.create(options)

    assert str(raised.value).startswith(message)
    assert "\n" not in str(raised.value)


def test_a_sum_from_names_is_the_sum_from_objects_and_its_dict_makes_it_again():
    named = MATERIALS.create("sum", {"of": ["ggx", KURT], "weights": [0.7, 1]})

    assert named == Sum(of=(GGX(), Kurt(m=(0.1, 0.1))), weights=(0.7, 1.0))
    assert hash(named) == hash(Sum(of=(GGX(), Kurt(m=(0.1, 0.1))), weights=(0.7, 1.0)))
    assert MATERIALS.create("sum", named.as_dict()) == named


def test_key_changes_with_every_inner_option_and_weight():
    sums = [Sum(of=(KURT,)), Sum(of=({"kurt": {"m": 0.2}},)), Sum(of=(KURT,), weights=(0.5,)), Sum(of=(KURT, "phong")),
            Sum(of=("phong", KURT))]  # fmt: skip

    assert len({material.key() for material in sums}) == len(sums)
    assert Sum(of=(KURT,)).key() == Sum(of=(Kurt(m=0.1),)).key()


def test_key_holds_the_keys_of_its_materials(monkeypatch):
    """Of a material that is a file, its bytes and not its name."""
    monkeypatch.setattr(Kurt, "key", lambda self: "hash of the bytes")

    assert "hash of the bytes" in Sum(of=("kurt",)).key()


# In a study


@pytest.fixture
def study_of(tmp_path):
    def load(material):
        path = tmp_path / "my.yaml"
        path.write_text(
            f"title: T\nlight: gradient\nmaterial: {material}\nview: sphere\nmethods: importance_sampling\n"
        )
        return load_study(path)

    return load


def test_a_list_of_materials_is_one_sum_and_a_list_of_lists_sweeps(study_of):
    one = study_of("{sum: {of: [{kurt: {m: 0.1}}, phong], weights: [0.7, 0.3]}}")
    four = study_of("{sum: {of: [[{kurt: {m: 0.1}}, phong], [ggx, phong]], weights: [[0.7, 0.3], [0.5, 0.5]]}}")

    assert [item.as_dict()["weights"] for item in one.materials] == [[0.7, 0.3]]
    assert [[next(iter(part)) for part in item.as_dict()["of"]] for item in four.materials] == [
        ["kurt", "phong"], ["kurt", "phong"], ["ggx", "phong"], ["ggx", "phong"]
    ]  # fmt: skip
    assert [item.as_dict()["weights"] for item in four.materials] == [[0.7, 0.3], [0.5, 0.5]] * 2


def test_a_resolved_study_spells_every_inner_option_out_and_loads_again(study_of):
    study = study_of("{sum: {of: [{kurt: {m: 0.1}}]}}")

    [item] = study.resolved()["material"]

    assert item["sum"]["of"][0]["kurt"]["m"] == [0.1, 0.1]
    assert study_of(str(item)).materials == study.materials


@pytest.mark.parametrize(
    ("material", "message"),
    [
        ("{sum: {of: [ggx, {kurt: {m: 1.4}}]}}", "material.sum.of[1]: kurt.m[0] must be less than or equal to 1, got"),
        ("{sum: {of: [ggx, kurrt]}}", "material.sum.of[1]: unknown material 'kurrt'; did you mean 'kurt'?"),
        ("{sum: {of: [[ggx], [kurrt]]}}", "material.sum.of[1][0]: unknown material 'kurrt'; did you mean 'kurt'?"),
        ("{sum: {of: []}}", "material.sum.of needs at least one material"),
        ("{kurt: {lobes: [{m: 0.1}, {m: 1.4}]}}", "material.kurt.lobes: kurt.lobes.m[0] must be less than or equal"),
        ("{lafortune: {lobes: [{s: 1}, {s: -1}]}}", "material.lafortune.lobes[1]: lobe.s must be greater than or"),
    ],
)  # fmt: skip
def test_an_inner_fault_of_a_study_is_reported_with_its_place(study_of, material, message):
    with pytest.raises(InputError) as raised:
        study_of(material)

    assert f": {message}" in str(raised.value)
    assert "my.yaml:3:" in str(raised.value)


def test_the_schema_offers_every_material_as_a_part():
    stated = schema()

    def at(one: dict, *path: str | int) -> dict:
        """What lies on a path, references followed."""
        for step in path:
            while "$ref" in one:
                one = stated["$defs"][one["$ref"].removeprefix("#/$defs/")]
            one = one[step]
        return one

    of = at(
        stated, "properties", "material", "anyOf", 0, "anyOf", 1, "properties", "sum", "anyOf", 0, "properties", "of"
    )
    part = at(of, "anyOf", 0, "items", "anyOf")

    assert at(part[0], "enum") == MATERIALS.names()
    assert set(at(part[1], "properties")) == set(MATERIALS.names())
