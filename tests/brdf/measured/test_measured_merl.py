"""MERL files: written here after the published format, read back by a separate evaluation."""

from math import pi

import numpy as np
import pytest
import torch

from glossbench.brdf.measured.merl import SIZE, HalfDifferenceTable, read_merl
from glossbench.errors import InputError
from oracles.hemisphere import random_hemisphere, vectors

SCALE = np.array([1.0, 1.15, 1.66]) / 1500


def stored_values():
    """(3, 90, 90, 180): a highlight over a diffuse part, with a little of phi_d; -1 where theta_d is 80 or more."""
    i, j, k = np.meshgrid(np.arange(90), np.arange(90), np.arange(180), indexing="ij")
    theta_h, theta_d, phi_d = (i / 90) ** 2 * pi / 2, np.radians(j), np.radians(k)
    value = 200 * np.exp(-((theta_h / 0.2) ** 2)) * (1 + np.sin(theta_d) ** 2 * np.cos(phi_d) ** 2) + 50 + i
    value[:, 80:] = -1
    return np.where(value < 0, -1.0, np.array([1, 0.7, 0.3]).reshape(3, 1, 1, 1) * value)


def write(path, stored, dimensions=(90, 90, 180)):
    path.write_bytes(np.array(dimensions, "<i4").tobytes() + np.asarray(stored, "<f8").tobytes())
    return path


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return write(tmp_path_factory.mktemp("merl") / "paint.binary", stored_values())


def turned(v, axis, angle):
    """v (N, 3) about a coordinate axis by angles (N,), by the matrix."""
    c, s = np.cos(angle), np.sin(angle)
    a, b = {"z": (0, 1), "y": (2, 0)}[axis]
    out = v.copy()
    out[:, a], out[:, b] = c * v[:, a] - s * v[:, b], s * v[:, a] + c * v[:, b]
    return out


def by_the_published_reader(stored, wo, wi, scale=SCALE, swapped=False, clamped=True):
    """The value of the cell, found as the database's reader finds it: h turned to the normal takes wi along."""
    h = wo + wi
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    theta_h, phi_h = np.arccos(h[:, 2]), np.arctan2(h[:, 1], h[:, 0])
    d = turned(turned(wi, "z", -phi_h), "y", -theta_h)
    theta_d, phi_d = np.arccos(np.clip(d[:, 2], -1, 1)), np.arctan2(d[:, 1], d[:, 0])
    phi_d = np.where(phi_d < 0, phi_d + pi, phi_d)
    if swapped:
        theta_h, theta_d = theta_d, theta_h
    i = np.clip(np.sqrt(theta_h / (pi / 2) * 90 * 90).astype(int), 0, 89)
    j = np.clip((theta_d / (pi / 2) * 90).astype(int), 0, 89)
    k = np.clip((phi_d / pi * 180).astype(int), 0, 179)
    values = stored[:, i, j, k] * scale[:, None]
    return (np.maximum(values, 0) if clamped else values).T


def pairs(n=20_000):
    wo, wi = random_hemisphere(n, 1), random_hemisphere(n, 2)
    wi[: n // 2] = wo[: n // 2] * [-1, -1, 1] + 0.05 * random_hemisphere(n // 2, 3)  # highlights
    return wo, wi / np.linalg.norm(wi, axis=1, keepdims=True)


def wrong(file, **fault):
    """Share of pairs whose value is not that of the published reader."""
    wo, wi = pairs()
    table, _ = read_merl(file, "cpu")
    f = torch.stack(table.value(vectors(wo, torch.float64), vectors(wi, torch.float64)), 1).numpy()
    expected = by_the_published_reader(stored_values(), wo, wi, **fault)
    return float((np.abs(f - expected) > 1e-5 * np.abs(expected) + 1e-9).any(1).mean())


def test_values_are_those_of_the_published_reader(file):
    # Measured: 0; two roundings may part at the border of a cell.
    assert wrong(file) <= 1e-4


FAULTS = {
    "theta_h and theta_d swapped": {"swapped": True},
    "green not scaled by 1.15": {"scale": np.array([1.0, 1.0, 1.66]) / 1500},
    "blue not scaled by 1.66": {"scale": np.array([1.0, 1.15, 1.0]) / 1500},
    "negative values not clamped": {"clamped": False},
}


@pytest.mark.parametrize("fault", FAULTS)
def test_comparison_notices(file, fault):
    # The least is the clamp: of the pairs 1 in 100 is beyond theta_d = 80 degrees.
    assert wrong(file, **FAULTS[fault]) > 2e-3


def test_value_of_one_cell_is_that_of_its_three_numbers(tmp_path):
    stored = np.zeros((3, 90, 90, 180))
    stored[:, 0, 45, :] = [[1500.0], [3000.0], [4500.0]]
    table, _ = read_merl(write(tmp_path / "a.binary", stored), "cpu")

    f = table.value(*(vectors([[s * np.sin(0.79), 0.0, np.cos(0.79)]]) for s in (1, -1)))

    assert [float(c) for c in f] == pytest.approx([1.0, 2 * 1.15, 3 * 1.66])


def test_light_and_viewer_may_be_exchanged(file):
    table, _ = read_merl(file, "cpu")
    wo, wi = (vectors(v, torch.float64) for v in pairs())

    there, back = (torch.stack(table.value(*ends)) for ends in ((wo, wi), (wi, wo)))

    # The border of a cell again.
    assert float((there != back).any(0).double().mean()) <= 1e-3


def test_negative_cells_are_counted_black_and_not_known(file):
    table, n_negative = read_merl(file, "cpu")
    wide = [vectors([[s * np.sin(1.45), 0.0, np.cos(1.45)]]) for s in (1, -1)]
    narrow = [vectors([[s * np.sin(1.3), 0.0, np.cos(1.3)]]) for s in (1, -1)]

    assert n_negative == 3 * 90 * 10 * 180
    assert [float(c) for c in table.value(*wide)] == [0, 0, 0]
    assert not table.known(*wide)
    assert table.known(*narrow)
    assert isinstance(table, HalfDifferenceTable)


def header(*dimensions):
    return np.array(dimensions, "<i4").tobytes()


HOSTILE = {
    "nothing": (b"", "not a MERL file: 0 bytes"),
    "a header alone": (header(90, 90, 180), f"MERL file truncated: 12 bytes, must be {SIZE}"),
    "other dimensions": (header(90, 90, 360) + bytes(64), r"dimensions \(90, 90, 360\), must be \(90, 90, 180\)"),
    "a picture": (b"\x89PNG\r\n\x1a\n" + bytes(64), "not a MERL file of an isotropic BRDF: dimensions"),
    "negative dimensions": (header(-1, 90, 180), "dimensions"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_are_refused_in_one_line(tmp_path, name):
    content, message = HOSTILE[name]
    path = tmp_path / "x.binary"
    path.write_bytes(content)

    with pytest.raises(InputError, match=message) as refused:
        read_merl(path, "cpu")

    assert "\n" not in str(refused.value)


def test_a_file_cut_off_or_too_long_is_refused(file, tmp_path):
    for size, word in ((SIZE - 8, "truncated"), (SIZE + 8, "too long")):
        path = tmp_path / "cut.binary"
        path.write_bytes((file.read_bytes() + bytes(8))[:size])

        with pytest.raises(InputError, match=f"MERL file {word}: {size} bytes"):
            read_merl(path, "cpu")


def test_values_that_are_not_finite_are_refused_with_their_number(tmp_path):
    stored = stored_values()
    stored[0, 3, 4, 5:8] = np.nan, np.inf, 1e300

    with pytest.raises(InputError, match="MERL file with 3 values that are not finite, or above"):
        read_merl(write(tmp_path / "nan.binary", stored), "cpu")
