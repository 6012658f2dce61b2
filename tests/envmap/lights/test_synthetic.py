"""Embedded lights: known by formula, seeded, and as wide and bright as the paper says."""

from math import log, pi

import numpy as np
import pytest
import torch

import glossbench as gb
from glossbench.directions import stack
from glossbench.envmap.cubemap import texel_directions, texel_solid_angles
from glossbench.envmap.lights.light import LIGHTS
from glossbench.errors import InputError

SEEDS = range(40)


def test_the_same_seed_gives_the_same_bytes():
    one, again, other = (gb.light("spots", seed=seed, resolution=64) for seed in (7, 7, 8))

    assert one.faces.numpy().tobytes() == again.faces.numpy().tobytes()
    assert one.key == again.key
    assert one.faces.numpy().tobytes() != other.faces.numpy().tobytes()
    assert one.key != other.key


def test_a_spot_does_not_move_with_the_resolution():
    def centre(resolution):
        faces = gb.light("spots", seed=3, n_spots=1, resolution=resolution).faces.sum(-1)
        return stack(texel_directions(resolution)).reshape(-1, 3)[faces.argmax()]

    cos = (centre(64) @ centre(256)).item()

    assert np.degrees(np.arccos(min(cos, 1))) < 10  # within one disc: the brightest texel is any of its inside


def diameters_and_peaks(resolution=128):
    """Of one spot alone on its sky, by its solid angle: a cap of radius r has 2 pi (1 - cos r)."""
    solid_angle = texel_solid_angles(resolution).numpy()
    sky = 1 + 0.5 * stack(texel_directions(resolution))[..., 1].double().numpy()
    diameters, peaks = [], []
    for seed in SEEDS:
        faces = gb.light("spots", seed=seed, n_spots=1, resolution=resolution).faces.double().numpy()
        peak = faces.max((0, 1, 2))
        bright = faces[..., 0] > sky + 0.5 * (peak[0] - sky)
        area = (bright * solid_angle).sum()
        diameters.append(2 * np.degrees(np.arccos(1 - area / (2 * pi))))
        peaks.append(peak)
    return np.array(diameters), np.array(peaks)


@pytest.fixture(scope="module")
def spots():
    return diameters_and_peaks()


def check_diameters(diameters):
    # Half a texel is 0.22 degrees, measured 0.20. The mean of 40 has standard error 8 / sqrt(480) = 0.37.
    assert diameters.min() > 2 - 0.3
    assert diameters.max() < 10 + 0.3
    assert diameters.mean() == pytest.approx(6, abs=4 * 0.37)


def test_diameters_are_uniform_from_2_to_10_degrees(spots):
    diameters, _ = spots

    check_diameters(diameters)


@pytest.mark.parametrize("factor", [0.5, 2])
def test_the_check_of_diameters_notices_a_radius_taken_for_one(spots, factor):
    diameters, _ = spots

    with pytest.raises(AssertionError):
        check_diameters(factor * diameters)


def test_intensities_reach_3000_times_the_mean_of_the_sky(spots):
    _, peaks = spots
    mean_sky = gb.light("spots", n_spots=0, resolution=32).mean()

    intensity = np.median(peaks, axis=1)

    # Log-uniform over two decades of 3000, each channel tinted by 0.7 to 1.3.
    torch.testing.assert_close(mean_sky, torch.ones(3).double(), rtol=0, atol=1e-8)
    assert 30 * 0.7 < peaks.min() < 30 * 3
    assert 3000 / 3 < peaks.max() < 3000 * 1.3
    of_log = np.log(intensity / 3000) / log(100)
    # Uniform in [-1, 0]: the standard error of 40 is 0.046, and the tint's of the log 0.006.
    assert of_log.mean() == pytest.approx(-0.5, abs=4 * 0.05)


def test_spots_are_spread_over_the_sphere():
    light = gb.light("spots", n_spots=400, seed=1, resolution=64)
    lit = (light.faces.amax(-1) > 5).double() * texel_solid_angles(64)

    centroid = (stack(texel_directions(64)).double() * lit[..., None]).sum((0, 1, 2)) / lit.sum()

    # A mean of 400 uniform directions: each component has a standard error of 1 / sqrt(3 400) = 0.029.
    assert centroid.abs().max().item() < 4 * 0.029


def test_the_sky_is_darker_below():
    light = gb.light("spots", n_spots=0, resolution=64)

    # The centre of the face +y and of -y, 0.01 of a half edge away from it.
    assert light.faces[2, 32, 32].tolist() == pytest.approx([1.5] * 3, abs=1e-3)
    assert light.faces[3, 32, 32].tolist() == pytest.approx([0.5] * 3, abs=1e-3)


def test_a_single_texel_holds_all_the_light():
    light = gb.light("texel", face=1, row=2, column=3, radiance=[1.0, 2.0, 3.0], resolution=8)

    assert light.faces[1, 2, 3].tolist() == [1, 2, 3]
    assert light.faces.sum((0, 1, 2)).tolist() == [1, 2, 3]


def test_a_texel_outside_the_face_is_refused():
    with pytest.raises(InputError, match=r"^texel.row and texel.column must be below 8, got 8 and 4$"):
        gb.light("texel", row=8, resolution=8)


def test_the_gradient_grows_along_its_axes():
    light = gb.light("gradient", radiance=2.0, resolution=64)

    centres = light.faces[:, 32, 32]

    expected = [[2, 1, 1], [0, 1, 1], [1, 2, 1], [1, 0, 1], [1, 1, 2], [1, 1, 0]]
    # Half a texel from the centre: 1/64.
    torch.testing.assert_close(centres, torch.tensor(expected).float(), rtol=0, atol=0.017)


@pytest.mark.parametrize("name", ["constant", "gradient", "orientation", "spots", "texel"])
def test_every_light_has_a_key_that_its_options_change(name):
    light, other = (LIGHTS.create(name, {"resolution": resolution}) for resolution in (16, 32))

    assert light.key() == LIGHTS.create(name, {"resolution": 16}).key()
    assert light.key() != other.key()
    assert light.cubemap().faces.shape == (6, 16, 16, 3)
    assert light.cubemap().key == light.key()
