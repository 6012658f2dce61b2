"""Goniometer files: colours against another table of the observer, the factors against the samples."""

from math import pi

import mitsuba as mi
import numpy as np
import pytest
import torch

from glossbench.brdf.measured.colorimetry import D65, WAVELENGTHS, X_BAR, Y_BAR, Z_BAR, rec709
from glossbench.brdf.measured.cornell import factor_samples, read_cornell, read_samples
from glossbench.directions import Vec3
from glossbench.errors import InputError
from oracles.hemisphere import vectors

mi.set_variant("scalar_rgb")


# Colour.


def test_tables_of_the_observer_and_of_d65_are_those_of_another_source():
    theirs = np.array([list(mi.cie1931_xyz(float(w))) for w in WAVELENGTHS]).T
    light = np.array([mi.cie_d65(float(w)) for w in WAVELENGTHS])

    # Measured 1.6e-7: theirs are float32. Of the light they state another unit.
    np.testing.assert_allclose([X_BAR, Y_BAR, Z_BAR], theirs, rtol=0, atol=5e-7)
    np.testing.assert_allclose(np.array(D65) / D65[16], light / light[16], rtol=1e-5)


def test_a_grey_reflectance_is_grey():
    np.testing.assert_allclose(rec709(np.full(31, 0.3)), 0.3, rtol=1e-12)


@pytest.mark.parametrize(("low", "high", "channel"), [(610, 700, 0), (520, 560, 1), (420, 480, 2)])
def test_a_band_of_the_spectrum_has_its_colour(low, high, channel):
    color = rec709(((low <= WAVELENGTHS) & (high >= WAVELENGTHS)).astype(float))

    assert np.argmax(color) == channel
    assert color[channel] > 0.3


# The samples and the factors.


@pytest.fixture(scope="module", params=["cayman", "mystique"])
def file(request, shared_data):
    return shared_data / "brdfs" / f"{request.param}.brdf"


def relative_l2(table, samples, wrong=lambda wo, wi: (wo, wi)):
    f = torch.stack(table.value(*wrong(samples.wo, samples.wi)), 1).numpy()
    right = np.maximum(samples.f, 0)
    return np.linalg.norm(f - right) / np.linalg.norm(right)


def test_factors_reproduce_the_samples(file):
    table, n_negative = read_cornell(file, "cpu")
    samples = read_samples(file)

    # Measured: 0.087 (cayman) and 0.082 (mystique), most of it in a few highlights.
    assert relative_l2(table, samples) < 0.1
    assert n_negative == (samples.f < 0).sum() > 0


def test_that_check_notices_an_azimuth_turned_round(file):
    table, _ = read_cornell(file, "cpu")

    assert relative_l2(table, read_samples(file), lambda wo, wi: (Vec3(-wo.x, -wo.y, wo.z), wi)) > 0.9


def test_light_and_viewer_may_be_exchanged(file):
    table, _ = read_cornell(file, "cpu")
    samples = read_samples(file)

    there, back = (torch.stack(table.value(*ends)) for ends in ((samples.wo, samples.wi), (samples.wi, samples.wo)))

    torch.testing.assert_close(there, back, rtol=1e-4, atol=0)


def test_the_brightest_sample_is_where_the_mirror_is(file):
    """The file's azimuths are of directions away from the surface: the mirror is half a turn from the light."""
    samples = read_samples(file)

    brightest = np.argsort(-samples.f.sum(1))[:4]

    away = samples.wo.x * samples.wi.x + samples.wo.y * samples.wi.y
    assert (away.numpy()[brightest] < 0).all()
    assert ((torch.acos(samples.wo.z) - torch.acos(samples.wi.z)).abs().numpy()[brightest] < np.radians(1.5)).all()


def test_known_is_what_lies_between_the_samples(file):
    table, _ = read_cornell(file, "cpu")
    samples = read_samples(file)

    grazing = [vectors([[s * np.sin(1.55), 0, np.cos(1.55)]], torch.float64) for s in (1, -1)]

    assert table.known(samples.wo, samples.wi).all()
    assert table.known(samples.wi, samples.wo).all()
    assert not table.known(*grazing)


def test_factors_of_a_product_are_found_from_scattered_samples(file):
    """A BRDF that is a product of functions of the angles, at the directions of the real file."""
    samples = read_samples(file)
    h = Vec3(*(a + b for a, b in zip(samples.wo, samples.wi, strict=True)))
    cos_h = (h.z / torch.sqrt(h.x**2 + h.y**2 + h.z**2)).clamp(max=1).numpy()
    value = 0.2 * np.exp(-3 * np.arccos(cos_h)) * (samples.wo.z * samples.wi.z).numpy() ** -0.3
    made = type(samples)(samples.wi, samples.wo, np.stack([value, 2 * value, 0.5 * value], 1))

    table = factor_samples(made, "cpu")

    # Measured: 0.006; the maps are linear between nodes, the functions are not.
    assert relative_l2(table, made) < 0.015


# Invalid files.


def a_file(wavelengths=WAVELENGTHS, rows=None):
    rows = np.tile([0.5, 0.0, 0.6, pi, *([0.1] * 31)], (3, 1)) if rows is None else rows
    numbers = [str(len(wavelengths)), *(f"{w:g}" for w in wavelengths), *(f"{v:g}" for v in np.ravel(rows))]
    return "# Cornell\n" + "\n".join(numbers) + "\n"


def one_row(**changed):
    row = np.array([0.5, 0.0, 0.6, pi, *([0.1] * 31)])
    for place, value in changed.items():
        row[int(place[1:])] = value
    return a_file(rows=row)


WRONG = {
    "nothing": ("", "not a goniometer file of 31 wavelengths"),
    "prose": ("this is\nno measurement\n", "holds more than numbers and comments"),
    "another script": ("\u00e4\u00f6\u00fc", "holds more than numbers and comments"),
    "other wavelengths": (
        a_file(wavelengths=WAVELENGTHS + 5),
        "not a goniometer file of 31 wavelengths from 400 to 700",
    ),
    "fewer wavelengths": (a_file(wavelengths=WAVELENGTHS[:10]), "not a goniometer file of 31 wavelengths"),
    "no samples": (a_file(rows=np.zeros(0)), "truncated: 0 numbers"),
    "a sample cut off": (
        a_file().rsplit("\n", 9)[0],
        "truncated: 97 numbers after its header, must be a multiple of 35",
    ),
    "NaN": (one_row(_9=np.nan), "with 1 numbers that are not finite"),
    "infinite as float32": (one_row(_9=1e39), r"with 1 numbers that are not finite, or above 1e\+30"),
    "an infinite angle": (one_row(_1=np.inf), "with 1 numbers that are not finite"),
    "a light below the surface": (one_row(_0=1.7), r"angles to the normal must be in \[0, pi/2\), got 1.7"),
    "a negative angle": (one_row(_2=-0.1), "got -0.1"),
}


@pytest.mark.parametrize("name", WRONG)
def test_invalid_files_are_refused(tmp_path, name):
    content, message = WRONG[name]
    path = tmp_path / "x.brdf"
    path.write_text(content, encoding="utf-8")

    with pytest.raises(InputError, match=message) as refused:
        read_cornell(path, "cpu")

    assert "\n" not in str(refused.value)


def test_bytes_are_refused(tmp_path):
    path = tmp_path / "x.brdf"
    path.write_bytes(bytes(range(256)))

    with pytest.raises(InputError, match="holds more than numbers and comments"):
        read_cornell(path, "cpu")
