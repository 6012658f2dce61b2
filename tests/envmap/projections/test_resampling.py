"""Resampling: halving, bilinear places and means by solid angle, against loops in plain numbers."""

import numpy as np
import pytest
import torch

from glossbench.envmap.cubemap import texel_solid_angles
from glossbench.envmap.projections.layouts import LAYOUTS
from glossbench.envmap.projections.resampling import (
    bilinear,
    halve_images,
    make_cube_source,
    make_edge_source,
    make_layout_source,
    resize,
    to_faces,
    to_layout,
)
from oracles.cube_by_hand import centres, face_points, fine_light
from oracles.hemisphere import vectors

RNG = np.random.default_rng(5)


def random_image(*shape):
    return torch.tensor(RNG.uniform(0.1, 2, (*shape, 3)), dtype=torch.float32)


# Halving.


def shares(size, n_bins):
    """How much of each of `size` pixels lies in each of equal bins (n_bins, size)."""
    edges = np.arange(n_bins + 1) * size / n_bins
    pixel = np.arange(size)
    return np.clip(np.minimum(edges[1:, None], pixel + 1) - np.maximum(edges[:-1, None], pixel), 0, None)


def halved_by_hand(image, weight, rows, columns):
    """Weighted means over the bins, of arrays in float64."""
    total, over = np.zeros((rows, columns, 3)), np.zeros((rows, columns, 1))
    down, along = shares(image.shape[0], rows), shares(image.shape[1], columns)
    for y, x in np.ndindex(*image.shape[:2]):
        share = np.outer(down[:, y], along[:, x])[..., None] * weight[y, x]
        total, over = total + share * image[y, x], over + share
    return total / over


@pytest.mark.parametrize(
    ("height", "width", "rows", "columns"),
    [(2, 2, 1, 1), (6, 4, 3, 2), (5, 5, 2, 2), (3, 6, 1, 2), (7, 4, 3, 2), (3, 5, 1, 2)],
)
def test_a_halved_image_is_the_weighted_mean_of_the_pixels_of_each_bin(height, width, rows, columns):
    images, weight = random_image(2, height, width), torch.tensor(RNG.uniform(0.5, 2, (height, width)))

    small = halve_images(images, weight)

    assert small.shape == (2, rows, columns, 3)
    for image, found in zip(images.double().numpy(), small, strict=True):
        expected = halved_by_hand(image, weight.numpy(), rows, columns)
        # Float32, measured: 2e-7.
        np.testing.assert_allclose(found.numpy(), expected, rtol=2e-6)


def test_that_check_notices_weights_that_are_left_out():
    images, weight = random_image(1, 5, 5), torch.tensor(RNG.uniform(0.5, 2, (5, 5)))

    small = halve_images(images, torch.ones(5, 5))

    with pytest.raises(AssertionError):
        np.testing.assert_allclose(small[0], halved_by_hand(images[0].numpy(), weight.numpy(), 2, 2), rtol=2e-6)


def test_pixels_without_weight_give_black_and_no_nan():
    assert (halve_images(random_image(1, 4, 4), torch.zeros(4, 4)) == 0).all()


# Places.


def at(image, column, row):
    place = torch.tensor([[[column]]]), torch.tensor([[[row]]])
    return bilinear(image[None], *place)[0, 0, 0]


def test_the_centre_of_a_pixel_has_its_value_and_the_middle_between_two_their_mean():
    image = random_image(3, 4)

    torch.testing.assert_close(at(image, 2.5, 1.5), image[1, 2])
    torch.testing.assert_close(at(image, 3.0, 1.5), (image[1, 2] + image[1, 3]) / 2)
    torch.testing.assert_close(at(image, 2.5, 1.25), 0.75 * image[1, 2] + 0.25 * image[0, 2])


def test_beyond_the_outer_centres_the_edge_continues():
    image = random_image(3, 4)

    torch.testing.assert_close(at(image, 0.1, 1.5), image[1, 0])
    torch.testing.assert_close(at(image, 9.0, 9.0), image[2, 3])


def values_at(source, locate, points):
    """Of directions (6, n, n, 3) of each face."""
    column, row = locate(vectors(points.reshape(-1, 3)))
    return bilinear(source[None], column[None, None], row[None, None])[0, 0].reshape(points.shape)


def test_a_cube_has_its_texels_at_their_centres():
    faces = random_image(6, 4, 4)
    points = face_points(centres(4), centres(4))
    points = points / np.linalg.norm(points, axis=-1, keepdims=True)

    found = values_at(*make_cube_source(faces), points)

    # Float32 places, measured: 1e-5.
    torch.testing.assert_close(found, faces, rtol=5e-5, atol=0)


def test_a_cube_whose_outer_samples_lie_on_its_edges_has_them_there():
    faces = random_image(6, 5, 5)
    inside = np.linspace(-1, 1, 5)[1:-1]  # on an edge itself a direction belongs to either face
    points = face_points(inside, inside)
    points = points / np.linalg.norm(points, axis=-1, keepdims=True)

    found = values_at(*make_edge_source(faces.reshape(30, 5, 3)), points)

    torch.testing.assert_close(found, faces[:, 1:-1, 1:-1], rtol=5e-5, atol=0)


# Means by solid angle.


def test_texels_of_a_resampled_cube_are_means_of_the_interpolant_by_solid_angle():
    faces = random_image(6, 6, 6)
    _, radiance, solid_angle = fine_light(faces.double().numpy(), 16)
    blocks = (6, 4, 24, 4, 24)
    total = (radiance * solid_angle[:, None]).reshape(*blocks, 3).sum((2, 4))
    expected = total / solid_angle.reshape(blocks).sum((2, 4))[..., None]

    found = to_faces(*make_cube_source(faces), 6, 4)

    # 9 directions along a texel against 24: measured 8e-4 of a mean of 1; 0.08 where means are not by solid angle.
    np.testing.assert_allclose(found.numpy(), expected, atol=2e-3)


def test_that_check_notices_means_that_are_not_by_solid_angle():
    faces = random_image(6, 6, 6)
    _, radiance, _ = fine_light(faces.double().numpy(), 16)

    plain = radiance.reshape(6, 4, 24, 4, 24, 3).mean((2, 4))

    assert np.abs(to_faces(*make_cube_source(faces), 6, 4).numpy() - plain).max() > 4e-2


@pytest.mark.parametrize("resolution", [8, 4, 2])
def test_a_cube_a_power_of_two_smaller_is_halved_by_solid_angle(resolution):
    faces = random_image(6, 8, 8)

    expected, size = faces, 8
    while size > resolution:
        expected, size = halve_images(expected, texel_solid_angles(size)), size // 2

    assert (resize(faces, resolution) == expected).all()


@pytest.mark.parametrize("resolution", [3, 5, 12])
def test_at_any_resolution_the_light_of_all_directions_together_is_kept(resolution):
    faces = random_image(6, 8, 8)

    small = resize(faces, resolution)

    before, after = ((f * texel_solid_angles(f.shape[1]).float()[..., None]).sum((0, 1, 2)) for f in (faces, small))
    assert small.shape == (6, resolution, resolution, 3)
    # The interpolant is not the texels: measured 1.4e-3, at 3.
    torch.testing.assert_close(after, before, rtol=5e-3, atol=0)


@pytest.mark.parametrize("name", LAYOUTS)
def test_an_image_of_a_constant_light_is_constant_where_it_shows_directions_and_black_elsewhere(name):
    layout = LAYOUTS[name]

    image = to_layout(*make_cube_source(torch.full((6, 4, 4, 3), 2.5)), 4, layout, 8)

    assert image.shape == (8 * layout.rows, 8 * layout.columns, 3)
    lit = image[..., 0] > 0
    # The share of an inscribed disc, where there are discs, and then some pixels at its edge.
    assert lit.float().mean() > np.pi / 4 - 0.02
    torch.testing.assert_close(image[lit], torch.full_like(image[lit], 2.5), rtol=5e-5, atol=0)
    assert (image[~lit] == 0).all()


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_light_comes_back_from_every_layout(name):
    smooth = torch.tensor(face_points(centres(8), centres(8)), dtype=torch.float32)
    faces = 2 + smooth / smooth.norm(dim=-1, keepdim=True)  # 2 + d: linear in the direction

    image = to_layout(*make_cube_source(faces), 8, LAYOUTS[name], 16)
    back = to_faces(*make_layout_source(image, LAYOUTS[name]), 16, 8)

    # Measured by layout: 0.015 to 0.021.
    torch.testing.assert_close(back, faces, rtol=0, atol=0.04)
