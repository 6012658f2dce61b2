"""The sphere: normals, frames and mask of its pixels."""

from math import pi

import numpy as np
import pytest
import torch

import glossbench as gb
from glossbench.directions import stack
from glossbench.scene.points import image_of


@pytest.fixture(scope="module", params=[1, 2, 5, 64])
def view(request):
    return gb.view("sphere", resolution=request.param)


def test_the_mask_is_a_disc(view):
    mask = view.mask().numpy()

    n = view.resolution
    at = (np.arange(n) + 0.5) / n * 2 - 1
    np.testing.assert_array_equal(mask, np.hypot(at[None], at[:, None]) < 1)
    assert len(view.points()) == mask.sum()


def test_the_mask_covers_pi_over_4_of_the_image():
    mask = gb.view("sphere", resolution=512).mask()

    # Measured 1.7e-5: the lattice points of a circle.
    assert mask.double().mean().item() == pytest.approx(pi / 4, abs=8e-5)


def test_a_pixel_shows_the_normal_of_its_place(view):
    points = view.points()

    normals = image_of(view.mask(), stack(points.n)).numpy()

    n = view.resolution
    for row in range(n):
        for column in range(n):
            x, y = (column + 0.5) / n * 2 - 1, 1 - (row + 0.5) / n * 2
            inside = x * x + y * y < 1
            expected = (x, y, np.sqrt(1 - x * x - y * y)) if inside else (0, 0, 0)
            # Measured 3e-8: float32.
            assert normals[row, column] == pytest.approx(expected, abs=1.5e-7)


def check_frames(points):
    t, b, n, wo = (stack(v).double() for v in (points.t, points.b, points.n, points.wo))
    frame = torch.stack([t, b, n], dim=1)
    # Measured 8e-8: float32. Determinant +1 is right-handed.
    torch.testing.assert_close(frame @ frame.mT, torch.eye(3).double().expand(len(n), 3, 3), rtol=0, atol=4e-7)
    torch.testing.assert_close(torch.linalg.det(frame), torch.ones(len(n)).double(), rtol=0, atol=4e-7)
    # Along circles of latitude, counter-clockwise seen from above: no height, and it turns about +y.
    assert t[:, 1].abs().max() == 0
    assert (torch.linalg.cross(n, t)[:, 1] >= 0).all()
    torch.testing.assert_close(wo, torch.tensor([0.0, 0.0, 1.0]).double().expand(len(n), 3), rtol=0, atol=0)
    assert ((n * wo).sum(1) > 0).all()


def test_frames_are_right_handed_and_face_the_viewer(view):
    check_frames(view.points())


@pytest.mark.parametrize("fault", ["left-handed", "away from the viewer", "not normal"])
def test_the_frame_check_notices(fault):
    points = gb.view("sphere", resolution=16).points()
    swap = {
        "left-handed": {"t": points.b, "b": points.t},
        "away from the viewer": {"n": type(points.n)(*(-c for c in points.n))},
        "not normal": {"b": points.n},
    }[fault]

    with pytest.raises(AssertionError):
        check_frames(type(points)(**{**vars(points), **swap}))


def test_the_viewer_in_the_local_frame_is_at_the_cosine_above_the_surface(view):
    points = view.points()

    local = points.wo_local()

    # Measured 0 and 6e-8.
    torch.testing.assert_close(local.z, points.n.z, rtol=0, atol=1e-7)
    assert stack(local).norm(dim=1).sub(1).abs().max() < 3e-7


def test_all_resolutions_show_the_same_scene():
    assert gb.view("sphere", resolution=8).scene() == gb.view("sphere", resolution=64).scene()


@pytest.mark.parametrize("coverage", [0.25, 0.5, 1.0])
def test_a_wide_image_shows_the_sphere_in_the_stated_share_of_its_pixels(coverage):
    view = gb.view("sphere", resolution=270, width=480, coverage=coverage)

    mask = view.mask()

    assert mask.shape == (270, 480)
    # Measured 6.2e-5 or less: pixels come in rings of equal distance from the middle.
    assert mask.double().mean().item() == pytest.approx(coverage, abs=3e-4)
    assert len(view.points()) == mask.sum()
    torch.testing.assert_close(mask, mask.flip(0, 1))


def test_a_wide_image_without_coverage_shows_the_whole_disc():
    wide, square = gb.view("sphere", resolution=64, width=100), gb.view("sphere", resolution=64)

    torch.testing.assert_close(wide.mask()[:, 18:82], square.mask())
    assert wide.mask().sum() == square.mask().sum()
    torch.testing.assert_close(stack(wide.points().n), stack(square.points().n))


def test_a_covered_image_shows_no_surface_edge_on():
    points = gb.view("sphere", resolution=108, width=192, coverage=1.0).points()

    # Radius^2 - last pixel's distance^2 = 1 pixel^2, over the radius of 110 pixels; measured 0.5 % off.
    assert points.n.z.min().item() == pytest.approx(1 / 110, rel=0.01)
