"""Tables of fits: what their columns mean, seen from the other models' fits of the same materials."""

import re
from math import pi

import numpy as np
import pytest
import torch

from glossbench.brdf.cook_torrance import CookTorrance
from glossbench.brdf.material import MATERIALS
from glossbench.brdf.ngan import read_fits
from glossbench.errors import InputError
from oracles.hemisphere import direction, vectors

MODELS = ("cook_torrance", "ward", "lafortune")


@pytest.fixture(scope="module")
def tables(shared_data):
    files = {model: shared_data / "brdfs" / f"ngan_{model.replace('_', '')}.fit" for model in MODELS}
    return {model: read_fits(file, model) for model, file in files.items()}


def test_all_three_tables_have_the_same_86_materials(tables):
    assert [len(table) for table in tables.values()] == [86, 86, 86]
    assert set(tables["ward"]) == set(tables["lafortune"]) == set(tables["cook_torrance"])


def test_numbers_of_a_line_are_the_options(tables):
    fit = tables["cook_torrance"]["brass"]

    # Of the file: Lambertian 0.0475, 0.0313, 0.0149; 0.124, 0.0498, 0.0167; eta 0.596; roughness 0.00668.
    assert (fit.kd, fit.ks) == ((0.0475, 0.0313, 0.0149), (0.124, 0.0498, 0.0167))
    assert (fit.f0, fit.m, fit.factor) == ((0.596,) * 3, (0.00668, 0.00668), "1/pi")
    assert tables["ward"]["brass"].m == (0.00729, 0.00729)
    assert tables["lafortune"]["brass"].C == (-0.577, -0.577, 0.577)


def value_by_hand(line, wo, wi):
    """f of the lines' own words: D Beckmann's over pi m^2, divided by pi again; Ward 1992; Lafortune normalised."""
    numbers = [float(n) for n in re.findall(r"(?<![\w-])-?\d[\d.]*(?:e-?\d+)?", line.split("=", 1)[1])]
    kd, ks, rest = numbers[0], numbers[3], numbers[6:]
    h = (wo + wi) / np.linalg.norm(wo + wi)
    tan2 = (h[0] ** 2 + h[1] ** 2) / h[2] ** 2
    if "CookTorrance" in line:
        f0, m = rest
        D = np.exp(-tan2 / m**2) / (pi * m**2 * h[2] ** 4)
        G = min(1, 2 * h[2] * wo[2] / (wo @ h), 2 * h[2] * wi[2] / (wo @ h))
        return kd / pi + ks * (f0 + (1 - f0) * (1 - wo @ h) ** 5) * D * G / (pi * wo[2] * wi[2])
    if "Ward" in line:
        return kd / pi + ks * np.exp(-tan2 / rest[0] ** 2) / (4 * pi * rest[0] ** 2 * np.sqrt(wo[2] * wi[2]))
    c_xy, c_z, s = rest
    cosine = c_xy * (wo[0] * wi[0] + wo[1] * wi[1]) + c_z * wo[2] * wi[2]
    return kd / pi + ks * (s + 2) / (2 * pi) * (max(cosine, 0) / max(abs(c_xy), abs(c_z))) ** s


@pytest.mark.parametrize("model", MODELS)
def test_values_are_those_of_the_tables_own_formulas(tables, shared_data, model):
    lines = (shared_data / "brdfs" / f"ngan_{model.replace('_', '')}.fit").read_text().splitlines()[2:]
    wo, wi = direction(0.6, 0.1), direction(0.62, 0.1 + pi)

    for line in lines:
        f = tables[model][line.split(" = ")[0]].f(vectors([wo]), vectors([wi]))

        # Float32 of an exponent of up to 1e4: measured 3e-3.
        assert float(f[0]) == pytest.approx(value_by_hand(line, wo, wi), rel=1e-2)


def metals_against_ward(tables, factor="1/pi"):
    """Highlights of the Cook-Torrance fits along the normal over those of the Ward fits, where f0 is above 0.5."""
    normal = vectors([[0.0, 0.0, 1.0]])
    ratios = []
    for name, fit in tables["cook_torrance"].items():
        if fit.f0[0] > 0.5:
            peak = CookTorrance(m=fit.m, f0=fit.f0, ks=fit.ks, factor=factor).f(normal, normal)
            ward = tables["ward"][name]
            other = type(ward)(m=ward.m, ks=ward.ks).f(normal, normal)
            ratios.append(float(torch.stack(peak).mean() / torch.stack(other).mean()))
    return np.array(ratios)


def test_two_models_agree_on_the_highlights_of_metals(tables):
    ratios = metals_against_ward(tables)

    # Measured: median 0.87, from 0.73 to 1.04 between the 10th and the 90th percentile.
    assert len(ratios) == 25
    assert 0.8 < np.median(ratios) < 1.0


def test_with_the_factor_of_today_they_agree_less(tables):
    assert abs(np.log(np.median(metals_against_ward(tables, "1/4")))) > abs(
        np.log(np.median(metals_against_ward(tables)))
    )


def test_no_fit_returns_more_light_than_it_receives_up_to_60_degrees(tables):
    wo = vectors([direction(theta, 0.0) for theta in (0.0, 0.5, 1.0)])

    brightest = max(float(fit.albedo(wo, 64).max()) for table in tables.values() for fit in table.values())

    assert 0.3 < brightest < 0.6  # white paint; measured 0.45


def test_a_material_is_made_by_name_and_its_nearest_name_is_offered(shared_data, monkeypatch):
    monkeypatch.setenv("GLOSSBENCH_DATA", str(shared_data))

    chrome = MATERIALS.create("ngan", {"material": "chrome", "model": "ward"})

    assert chrome.build_fit().m == (0.0101, 0.0101)
    assert chrome.key() != MATERIALS.create("ngan", {"material": "brass", "model": "ward"}).key()
    with pytest.raises(InputError, match=r"the tables have no 'chrom'; did you mean 'chrome'\?"):
        MATERIALS.create("ngan", {"material": "chrom"})
    with pytest.raises(
        InputError, match=r"ngan\.model must be 'cook_torrance', 'ward', 'ward_duer' or 'lafortune', got 'phong'"
    ):
        MATERIALS.create("ngan", {"material": "chrome", "model": "phong"})


LINE = "chrome = Aggregate(Lambertian(albedo = [0.1, 0.1, 0.1]), NganWard(albedo = [0.1, 0.1, 0.1], roughness = 0.1))\n"
WRONG = {
    "nothing": ("", "not a table of fits: it is empty"),
    "comments alone": ("# fits\n", "not a table of fits: it is empty"),
    "a line cut off": (LINE + LINE[:70], "x.fit:2: not a fit of ward: 'chrome = Aggregate"),
    "code": ("chrome = __import__('os')\n", "x.fit:1: not a fit of ward"),
    "another model": (LINE.replace("NganWard", "NganPhong"), "x.fit:1: not a fit of ward"),
    "a width above 1": (LINE.replace("roughness = 0.1", "roughness = 1.5"), "ward.m"),
    "NaN": (LINE.replace("roughness = 0.1", "roughness = nan"), "not a fit of ward"),
}


@pytest.mark.parametrize("name", WRONG)
def test_invalid_files_are_refused(tmp_path, name):
    content, message = WRONG[name]
    path = tmp_path / "x.fit"
    path.write_text(content)

    with pytest.raises(InputError, match=message):
        read_fits(path, "ward")


def test_bytes_are_refused(tmp_path):
    path = tmp_path / "x.fit"
    path.write_bytes(bytes(range(256)))

    with pytest.raises(InputError, match="not a table of fits: it holds more than plain text"):
        read_fits(path, "ward")


# Files of one's own.

OWN = (
    "# Any of the models, each with its own numbers.\n\n"
    "brass  =  AggregateBsdf(Lambertian(albedo = [0.05, 0.03, 0.01]), "
    "NganWardDuer(albedo = [0.07, 0.03, 0.01], roughness = 0.25))\n"
    "tin = Aggregate(Lambertian(albedo = [0.0, 2.5e-05, 0.0]), "
    "NganCookTorrance(albedo = [0.1, 0.1, 0.1], roughness = 0.3, eta = 0.5))\n"
)


@pytest.fixture
def own(tmp_path):
    path = tmp_path / "own.fit"
    path.write_text(OWN)
    return path


def test_a_table_of_ward_duer_has_its_normalisation(own):
    """f along the normal and at 60 degrees of both sides, by hand: 1 / (4 pi m^2 cos_i cos_o)."""
    fit = MATERIALS.create("ngan", {"file": str(own), "material": "brass"})
    wo, wi = vectors([direction(pi / 3, 0.0)]), vectors([direction(pi / 3, pi)])

    assert fit.build_fit().normalisation == "duer"
    assert float(fit.f(wo, wi)[0]) == pytest.approx(0.05 / pi + 0.07 / (4 * pi * 0.25**2 * 0.25), rel=1e-5)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (" = ", "="),
        (", ", ","),
        ("(", "( "),
        ("0.25", "2.5E-1"),
        ("brass", "\ufeffbrass"),
        ("))", "))  # of Müller"),
        ("))", "));"),
    ],
)
def test_a_line_is_taken_as_its_writer_spaces_it(tmp_path, old, new):
    line = LINE.replace("chrome", "brass").replace("roughness = 0.1", "roughness = 0.25")
    (tmp_path / "x.fit").write_text(line.replace(old, new), encoding="utf-8")

    assert read_fits(tmp_path / "x.fit")["brass"].m == (0.25, 0.25)


def test_a_table_may_hold_several_models_with_numbers_in_any_order(own):
    tin = MATERIALS.create("ngan", {"file": str(own), "material": "tin"}).build_fit()

    assert isinstance(tin, CookTorrance)
    assert (tin.m, tin.f0, tin.kd) == ((0.3, 0.3), (0.5,) * 3, (0.0, 2.5e-05, 0.0))


def test_a_stated_model_is_that_of_every_line(own):
    with pytest.raises(InputError, match=r"own\.fit:4: not a fit of ward_duer: it is a fit of cook_torrance$"):
        read_fits(own, "ward_duer")


def test_the_key_is_of_the_fit_and_not_of_the_files_name(own, tmp_path):
    other = tmp_path / "other.fit"
    other.write_text(OWN.replace("0.25", "0.26"))
    keys = [
        MATERIALS.create("ngan", {"file": str(file), "material": name}).key()
        for file, name in ((own, "brass"), (other, "brass"), (own, "tin"), (other, "tin"))
    ]

    assert keys[0] != keys[1]
    assert keys[2] == keys[3]


@pytest.mark.parametrize("model", ["NganBlinnPhong", "NganHe", "NganAshikhminShirley", "LowCookTorrance"])
def test_models_that_are_not_here_are_refused_by_name(own, model):
    own.write_text(OWN.replace("NganWardDuer", model))

    with pytest.raises(InputError, match=rf"own\.fit:3: not a fit: unknown model {model}; known: Ngan"):
        read_fits(own)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("roughness = 0.25", "sharpness = 2", "NganWardDuer needs albedo, roughness, got albedo, sharpness"),
        ("roughness = 0.25", "roughness = [1, 1, 1]", "NganWardDuer needs albedo, roughness, got albedo, roughness"),
        ("tin", "brass", "own.fit:4: 'brass' is in the table twice"),
        ("roughness = 0.25", "roughness = 1.2.3", "own.fit:3: "),
    ],
)
def test_lines_that_are_not_a_fit_are_named(own, old, new, message):
    own.write_text(OWN.replace(old, new))

    with pytest.raises(InputError, match=re.escape(message)):
        read_fits(own)


def test_ward_duer_without_a_file_is_refused():
    with pytest.raises(InputError, match=r"ngan\.model 'ward_duer' needs a file"):
        MATERIALS.create("ngan", {"material": "brass", "model": "ward_duer"})
