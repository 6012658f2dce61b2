"""Measured materials: by file and by name, what the reference takes and what samplers take."""

import json
from math import pi

import numpy as np
import pytest
import torch
import yaml

import glossbench as gb
from glossbench.brdf.kurt import Kurt
from glossbench.brdf.lobe import Lobe
from glossbench.brdf.material import MATERIALS
from glossbench.brdf.measured.fitting import fit_lobes
from glossbench.brdf.measured.lobe import MeasuredLobe, build_measured_lobe
from glossbench.brdf.mixture import Sum
from glossbench.directions import Vec3
from glossbench.errors import InputError
from glossbench.run.runner import run_study
from glossbench.study.study import load_study
from oracles.hemisphere import random_hemisphere, vectors


@pytest.fixture(autouse=True)
def data(shared_data, monkeypatch):
    monkeypatch.setenv("GLOSSBENCH_DATA", str(shared_data))
    return shared_data / "brdfs"


# By file and by name.


@pytest.mark.parametrize("name", ["cayman.brdf", "satin_rosaline_rgb.bsdf"])
def test_a_catalogue_name_is_the_material_of_its_file(data, name):
    by_name, by_file = gb.material(name.split(".")[0]), gb.material("measured", file=str(data / name))
    wo, wi = vectors(random_hemisphere(100, 1)), vectors(random_hemisphere(100, 2))

    assert by_name.key() == by_file.key()
    for a, b in zip(by_name.f(wo, wi), by_file.f(wo, wi), strict=True):
        torch.testing.assert_close(a, b, rtol=0, atol=0)


def test_key_is_of_the_bytes_and_not_of_the_name(data, tmp_path):
    content = (data / "cayman.brdf").read_bytes()
    same, other = tmp_path / "renamed.brdf", tmp_path / "other.brdf"
    same.write_bytes(content)
    other.write_bytes(content.replace(b"0.872665", b"0.872666", 1))

    keys = [gb.material("measured", file=str(file)).key() for file in (data / "cayman.brdf", same, other)]

    assert keys[0] == keys[1] != keys[2]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "measured: option 'file' is required"),
        (
            {"file": "paint.exr"},
            r"measured\.format must be stated: 'paint.exr' ends in none of \.brdf, \.binary, \.bsdf",
        ),
        ({"file": "a.brdf", "unknown": "grey"}, "measured.unknown must be 'black' or 'extrapolated', got 'grey'"),
        ({"file": "a.brdf", "lobes": 5}, "measured.lobes must be less than or equal to 4, got 5"),
        ({"file": "a.brdf", "form": "merl"}, "unknown option 'form'; did you mean 'format'"),
    ],
)
def test_senseless_options_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        MATERIALS.create("measured", options)


def test_a_file_that_is_missing_or_of_another_format_is_refused(data):
    with pytest.raises(InputError, match=r"no BRDF file 'gone.brdf'"):
        gb.material("measured", file="gone.brdf").key()
    with pytest.raises(InputError, match="not a tensor file: it begins with"):
        gb.material("measured", file=str(data / "cayman.brdf"), format="rgl").reflectance()


# What is known.


def test_facts_state_what_was_measured(data):
    facts = gb.material("cayman").facts()

    # 1439 samples of three channels: red is outside the gamut in most.
    assert (facts.format, facts.n_negative) == ("cornell", 1419)
    assert facts.known_share == pytest.approx(0.957, abs=0.002)


def test_unknown_values_are_black_unless_extrapolation_is_stated():
    wo, wi = (vectors([[s * np.sin(1.54), 0.0, np.cos(1.54)]]) for s in (1, -1))
    black, filled = gb.material("cayman"), gb.material("cayman", unknown="extrapolated")

    assert not black.known(wo, wi)
    assert float(sum(black.f(wo, wi))) == 0 < float(sum(filled.f(wo, wi)))


def test_the_note_states_share_counts_and_error():
    note = gb.material("cayman", samplers="ward", lobes=1).notes()[0]

    assert "95.7 % of all pairs of directions measured, black elsewhere" in note
    assert "1419 negative values taken as 0" in note
    assert "samplers take 1 ward lobe, errors 0." in note


# The fit.


def error_by_random_pairs(material, fitted, n=400_000):
    """Relative L2, cosine-weighted, over pairs of which half lie in highlights, by the balance heuristic."""
    rng = np.random.default_rng(5)

    def cosine(k):
        r, phi = np.sqrt(rng.uniform(size=k)), rng.uniform(0, 2 * pi, k)
        return np.stack([r * np.cos(phi), r * np.sin(phi), np.sqrt(1 - r * r)], 1)

    wo, wi = cosine(n), cosine(n)
    # The second half: half vectors whose 1 - cos is u^4, as the density u^-3 / (8 pi) of them has it.
    away = rng.uniform(size=n // 2) ** 4
    phi = rng.uniform(0, 2 * pi, n // 2)
    r = np.sqrt(away * (2 - away))
    h = np.stack([r * np.cos(phi), r * np.sin(phi), 1 - away], 1)
    wi[n // 2 :] = 2 * (wo[n // 2 :] * h).sum(1, keepdims=True) * h - wo[n // 2 :]
    h = (wo + wi) / np.linalg.norm(wo + wi, axis=1, keepdims=True)
    around = np.maximum(1 - h[:, 2], 1e-12) ** -0.75 / (8 * pi) / (4 * np.abs((wo * h).sum(1)))
    above = wi[:, 2] > 1e-3
    weight = np.where(above, wi[:, 2] ** 2 * wo[:, 2] / (wi[:, 2].clip(0) / pi + around), 0)
    f, g = (torch.stack(m.f(vectors(wo), vectors(wi))).double().numpy() for m in (material, fitted))
    known = material.known(vectors(wo), vectors(wi)).numpy()
    return np.sqrt((weight * known * (f - g) ** 2).sum() / (weight * known * f**2).sum())


@pytest.mark.parametrize("samplers", ["kurt", "cosine_lobes"])
def test_error_of_the_fit_is_the_relative_l2_norm(samplers):
    material = gb.material("satin_rosaline_rgb", samplers=samplers, lobes=1)
    fit = material.fit()

    # Nodes and random pairs: measured to agree within 2 %.
    assert fit.error == pytest.approx(error_by_random_pairs(material, fit.material), rel=0.05)


class Known:
    """A material as a table."""

    def __init__(self, material):
        self.material = material

    def value(self, wo, wi):
        return self.material.f(wo, wi)

    def known(self, wo, wi):
        return (wo.z > 0) & (wi.z > 0)


def test_a_kurt_material_is_found_again():
    material = Kurt(m=0.15, shadowing=0.3, f0=(0.5, 0.4, 0.3), ks=(0.8, 0.7, 0.6), kd=(0.1, 0.2, 0.3))

    fit = fit_lobes(build_measured_lobe(Known(material), False, "cpu"), "kurt", 1)

    (lobe,) = fit.material.lobes
    assert fit.error < 1e-3  # measured 2e-5
    assert lobe.m[0] == pytest.approx(0.15, rel=1e-2)
    assert lobe.shadowing == pytest.approx(0.3, abs=1e-2)
    assert lobe.f0 == pytest.approx((0.5, 0.4, 0.3), rel=2e-2)
    assert fit.material.kd == pytest.approx((0.1, 0.2, 0.3), rel=2e-2)


def test_fit_of_a_paint_keeps_what_is_not_a_highlight():
    material = gb.material("cayman")
    wo, wi = vectors(random_hemisphere(4000, 1)), vectors(random_hemisphere(4000, 2))
    f, g = (torch.stack(m.f(wo, wi)) * wo.z * wi.z for m in (material, material.fit().material))

    off = (f - g).abs().sum() / f.sum()

    # Measured over 16384 pairs: 0.24; 0.99 where the fit minimises the L2 norm itself.
    assert off < 0.5


# Who takes what.


def test_samplers_take_the_fit_and_the_reference_the_table():
    material = gb.material("cayman", lobes=1)

    assert isinstance(material.reflectance().lobes[0], MeasuredLobe)
    assert not any(isinstance(lobe, MeasuredLobe) for lobe in material.as_lobes().lobes)
    assert isinstance(gb.material("cayman", samplers="table").as_lobes().lobes[0], MeasuredLobe)
    assert all(isinstance(lobe, Lobe) for lobe in Sum(of=(material, "phong")).as_lobes().lobes)
    assert isinstance(Sum(of=(material, "phong")).reflectance().lobes[0], MeasuredLobe)


def test_other_materials_are_their_own_lobes():
    material = Kurt(kd=0.2)

    assert material.as_lobes() == material.reflectance()
    assert material.notes() == ()


METHODS = ("importance_sampling", "filtered_importance_sampling", "regular_sampling", "environment_sampling")


def image_errors(samplers):
    light, view = gb.light("gradient", resolution=16), gb.view("sphere", resolution=12)
    material = gb.material("satin_rosaline_rgb", samplers=samplers, unknown="extrapolated", lobes=1)
    truth = gb.reference(light, material, view, relative_error=1e-2)
    images = {name: gb.shade(gb.method(name, samples=256), light, material, view, time_it=False) for name in METHODS}
    return {
        name: float((image.radiance - truth.radiance)[truth.mask].square().mean().sqrt() / truth.mean)
        for name, image in images.items()
    }


def test_error_of_the_fit_shows_in_the_samplers_alone():
    fitted, tabulated = image_errors("kurt"), image_errors("table")

    # Measured: 0.094; environment sampling asks for f and has no fit.
    assert fitted["environment_sampling"] == tabulated["environment_sampling"] < 0.12
    assert tabulated["importance_sampling"] < 0.03
    assert fitted["importance_sampling"] > tabulated["importance_sampling"]
    assert all(np.isfinite(list(fitted.values())))


def test_results_state_the_note(tmp_path, data):
    study = {
        "title": "measured", "light": "constant", "view": {"sphere": {"resolution": 4}},
        "material": [{"measured": {"file": "paint.brdf", "lobes": 1}}, "phong"],
        "methods": [{"importance_sampling": {"samples": 16}}], "reference": {"relative_error": 0.1},
    }  # fmt: skip
    (tmp_path / "paint.brdf").write_text((data / "cayman.brdf").read_text())
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(study))

    results = run_study(load_study(tmp_path / "s.yaml"), tmp_path / "results")

    cells = results.cells.set_index("material")
    assert "samplers take 1 " in cells.loc["measured", "notes"]
    assert cells.loc["phong", "notes"] == "[]"
    assert json.loads(cells.loc["measured", "material_options"])["file"] == str(tmp_path / "paint.brdf")


def test_directions_below_the_surface_are_black_and_not_known():
    material = gb.material("satin_rosaline_rgb", unknown="extrapolated")
    up, down = vectors([[0.6, 0.0, 0.8]]), Vec3(*(torch.tensor([v]) for v in (0.6, 0.0, -0.8)))

    assert float(sum(material.f(up, down))) == 0
    assert not material.known(up, down)
