"""Files of the RGL database: the authors' own renderer says what they mean."""

import struct
from math import pi

import mitsuba as mi
import numpy as np
import pytest
import torch

from glossbench.brdf.measured.lobe import build_measured_lobe
from glossbench.brdf.measured.rgl import read_rgl
from glossbench.brdf.measured.tensor_file import read_tensors
from glossbench.errors import InputError
from oracles.hemisphere import direction, random_hemisphere, vectors

mi.set_variant("scalar_rgb")
TYPES = {"u1": 1, "u2": 3, "u4": 5, "f4": 10, "f8": 11}


@pytest.fixture(scope="module")
def file(shared_data):
    return shared_data / "brdfs" / "satin_rosaline_rgb.bsdf"


@pytest.fixture(scope="module")
def table(file):
    return read_rgl(file, "cpu")[0]


def f_of(table, wo, wi):
    return torch.stack(table.value(vectors(wo), vectors(wi)), 1).double().numpy()


def of_mitsuba(path, wo, wi):
    """f cos_i of the plug-in `measured`, (N, 3)."""
    bsdf = mi.load_dict({"type": "measured", "filename": str(path)})
    si, found = mi.SurfaceInteraction3f(), []
    for o, i in zip(wo.tolist(), wi.tolist(), strict=True):
        si.wi = mi.Vector3f(o)
        found.append(list(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(i))))
    return np.array(found)


def worst(table, file, turn=0.0, cosine=True, exchanged=False):
    """Largest difference from Mitsuba over the larger of its value and a hundredth."""
    wo, wi = random_hemisphere(1500, 1), random_hemisphere(1500, 2)
    expected = of_mitsuba(file, *((wi, wo) if exchanged else (wo, wi)))
    c, s = np.cos(turn), np.sin(turn)
    wi = wi @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    f = f_of(table, wo, wi) * (wi[:, 2:] if cosine else 1)
    return float((np.abs(f - expected) / np.maximum(expected, 1e-2)).max())


def test_values_times_the_cosine_are_those_of_the_authors_renderer(table, file):
    # Measured: 4e-5, at the steepest places.
    assert worst(table, file) < 2e-4


FAULTS = {
    "a light turned by a degree": {"turn": np.radians(1)},
    "a cosine too few": {"cosine": False},
    "light and viewer exchanged": {"exchanged": True},
}


@pytest.mark.parametrize("fault", FAULTS)
def test_comparison_notices(table, file, fault):
    assert worst(table, file, **FAULTS[fault]) > 1e-2


def test_it_returns_no_more_light_than_it_receives_up_to_74_degrees(table):
    views = [direction(theta, 0.3) for theta in (0.0, 0.4, 0.8, 1.2, 1.3)]
    z, phi = np.meshgrid((np.arange(200) + 0.5) / 200, (np.arange(400) + 0.5) * pi / 200, indexing="ij")
    r = np.sqrt(1 - z * z)
    wi = np.stack([r * np.cos(phi), r * np.sin(phi), z], -1).reshape(-1, 3)

    albedo = [2 * pi * (f_of(table, np.array([wo]), wi) * wi[:, 2:]).mean(0) for wo in views]

    # Measured: 0.66 to 0.99. Beyond, the file itself returns too much: 1.09 at its last angle, 78.7 degrees.
    assert np.all(np.array(albedo) > 0.5)
    assert np.all(np.array(albedo) < 1)


def test_beyond_the_widest_measured_angle_nothing_is_known(table):
    wo, wi = ([direction(theta, 0.0) for theta in (0.5, 1.36, 1.39)], [direction(0.4, 2.0)] * 3)

    known = table.known(vectors(wo), vectors(wi))

    assert known.tolist() == [True, True, False]


def test_nodes_without_luminance_are_not_known(file):
    """`valid` is stored as bits: nothing else says how they read, so the file itself must."""
    arrays = read_tensors(file)

    marked = np.unpackbits(arrays["valid"]).reshape(arrays["luminance"].shape).astype(bool)

    # But for the last slice, a copy of the one before.
    np.testing.assert_array_equal(arrays["rgb"][0, -1], arrays["rgb"][0, -2])
    assert marked[:, :-1][arrays["luminance"][:, :-1] == 0].all()
    assert 0.02 < marked.mean() < 0.3


def test_albedo_by_the_tabulated_density_is_that_of_the_values(table):
    lobe = build_measured_lobe(table, False, "cpu")
    wo = vectors([direction(0.5, 0.0)])

    albedo = lobe.albedo(wo, 1 << 14)[0].numpy()

    u = (np.arange(400) + 0.5) / 400
    z, phi = np.meshgrid(u, 2 * pi * u, indexing="ij")
    wi = np.stack([np.sqrt(1 - z * z) * np.cos(phi), np.sqrt(1 - z * z) * np.sin(phi), z], -1).reshape(-1, 3)
    f = f_of(table, np.array([direction(0.5, 0.0)]), wi)
    # Measured: 1.0e-3.
    np.testing.assert_allclose(albedo, 2 * pi * (f * wi[:, 2:]).mean(0), rtol=3e-3)


# Invalid files.


def write_tensors(path, arrays):
    head = b"tensor_file\0" + bytes([1, 0]) + struct.pack("<I", len(arrays))
    size = len(head) + sum(2 + len(name) + 11 + 8 * a.ndim for name, a in arrays.items())
    body = b""
    for name, a in arrays.items():
        kind = TYPES[a.dtype.str[1:]]
        head += struct.pack("<H", len(name)) + name.encode() + struct.pack("<HBQ", a.ndim, kind, size + len(body))
        head += struct.pack(f"<{a.ndim}Q", *a.shape)
        body += a.tobytes()
    path.write_bytes(head + body)
    return path


def a_file(**changes):
    """Arrays of a small white material, some changed; None takes one out."""
    one = np.ones
    arrays = {
        "theta_i": np.array([0.0, 0.8, 1.5], "f4"), "phi_i": np.zeros(1, "f4"),
        "sigma": one((2, 4), "f4"), "ndf": one((2, 4), "f4"), "vndf": one((1, 3, 8, 8), "f4"),
        "luminance": one((1, 3, 4, 4), "f4"), "rgb": one((1, 3, 3, 4, 4), "f4"), "jacobian": one(1, "u1"),
    }  # fmt: skip
    return {name: a for name, a in (arrays | changes).items() if a is not None}


def test_negative_values_are_counted_and_taken_as_zero(tmp_path):
    rgb = np.ones((1, 3, 3, 4, 4), "f4")
    rgb[0, :, 1] = -0.5
    table, n_negative = read_rgl(write_tensors(tmp_path / "a.bsdf", a_file(rgb=rgb)), "cpu")

    f = f_of(table, np.array([direction(0.3, 0.0)]), np.array([direction(0.5, 1.0)]))[0]

    assert n_negative == 3 * 16
    assert f[1] == 0 < f[0] == f[2]


def test_value_of_a_white_file_is_ndf_over_four_sigma_and_the_cosine(tmp_path):
    ndf = np.full((2, 4), 3.0, "f4")
    table, _ = read_rgl(write_tensors(tmp_path / "a.bsdf", a_file(ndf=ndf)), "cpu")

    f = f_of(table, np.array([direction(0.3, 0.0)]), np.array([direction(0.5, 1.0)]))[0]

    np.testing.assert_allclose(f, 3 / 4 / np.cos(0.5), rtol=1e-6)


WRONG = {
    "no colours": (a_file(rgb=None), "not a BSDF file: it has no 'rgb', only jacobian"),
    "a spectrum": (a_file(rgb=None, spectra=np.ones(3, "f4")), "a spectral .bsdf file; use the one"),
    "an anisotropic material": (a_file(phi_i=np.zeros(16, "f4")), "an anisotropic BSDF, of 16 azimuths"),
    "an axis too few": (a_file(vndf=np.ones((3, 8, 8), "f4")), "'vndf' has 3 axes, must have 4"),
    "other numbers of angles": (a_file(vndf=np.ones((1, 2, 8, 8), "f4")), r"'vndf' is \(1, 2, 8, 8\), must begin with"),
    "NaN": (a_file(sigma=np.full((2, 4), np.nan, "f4")), "'sigma' has values that are not finite"),
    "angles out of order": (a_file(theta_i=np.array([0, 1, 0.5], "f4")), "theta_i must be two angles or more"),
    "no density": (a_file(vndf=np.zeros((1, 3, 8, 8), "f4")), "vndf must be a density and sigma positive"),
    "one node": (a_file(sigma=np.ones((1, 1), "f4")), "a table of fewer than 2 x 2 nodes"),
}


@pytest.mark.parametrize("name", WRONG)
def test_files_that_do_not_fit_are_refused(tmp_path, name):
    arrays, message = WRONG[name]
    path = write_tensors(tmp_path / "x.bsdf", arrays)

    with pytest.raises(InputError, match=message) as refused:
        read_rgl(path, "cpu")

    assert "\n" not in str(refused.value)


def test_a_file_cut_anywhere_is_refused(tmp_path):
    whole = write_tensors(tmp_path / "x.bsdf", a_file()).read_bytes()
    path = tmp_path / "cut.bsdf"

    for size in [0, 5, 12, 13, 17, 19, *range(20, len(whole) - 1, 37), len(whole) - 1]:
        path.write_bytes(whole[:size])
        with pytest.raises(InputError, match="tensor file"):
            read_rgl(path, "cpu")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x89PNG\r\n\x1a\n" + bytes(64), "not a tensor file: it begins with"),
        (b"tensor_file\0\x02\x00" + bytes(64), "tensor file of version 2.0, must be 1.0"),
        (b"tensor_file\0\x01\x00" + struct.pack("<I", 2**32 - 1) + bytes(64), "tensor file"),
        (b"tensor_file\0\x01\x00" + struct.pack("<IH1sHBQ", 1, 1, b"a", 0, 77, 0), "'a' is of type 77"),
        (b"tensor_file\0\x01\x00" + struct.pack("<IH1sHBQQ", 1, 1, b"a", 1, 10, 0, 2**62), "'a' ends at"),
    ],
    ids=["a picture", "another version", "billions of arrays", "an unknown type", "an array beyond the file"],
)
def test_foreign_files_are_refused(tmp_path, content, message):
    path = tmp_path / "x.bsdf"
    path.write_bytes(content)

    with pytest.raises(InputError, match=message):
        read_tensors(path)
