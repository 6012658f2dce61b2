"""The checkerboard: its squares, and the exact mean of every texel."""

from itertools import pairwise

import numpy as np
import pytest
import torch
from scipy.integrate import dblquad

from glossbench.directions import stack
from glossbench.envmap.cubemap import texel_directions
from glossbench.envmap.lights.light import LIGHTS


def checker(**options):
    return LIGHTS.create("checker", options).cubemap()


def test_squares_of_whole_texels_are_copied():
    faces = checker(cells=4, resolution=8, bright=[3.0, 2.0, 1.0], dark=[0.5, 0.5, 0.0]).faces

    row, column = np.indices((8, 8)) // 2
    expected = np.where(((row + column) % 2 == 0)[..., None], [3.0, 2.0, 1.0], [0.5, 0.5, 0.0])
    # The shares are differences of angles: measured 0.
    np.testing.assert_allclose(faces.numpy(), np.broadcast_to(expected, (6, 8, 8, 3)), rtol=0, atol=1e-6)


def mean_by_quadrature(row, column, resolution, cells):
    """Of one texel: the solid angle of its bright parts over that of all of it, piece by piece."""

    def solid_angle(s0, s1, t0, t1):
        return dblquad(lambda t, s: (1 + s * s + t * t) ** -1.5, s0, s1, t0, t1, epsabs=1e-13)[0]

    def pieces(i):
        lo, hi = 2 * i / resolution - 1, 2 * (i + 1) / resolution - 1
        cuts = [lo, *[c for c in 2 * np.arange(cells + 1) / cells - 1 if lo < c < hi], hi]
        return [(a, b, int(np.floor(((a + b) / 2 + 1) * cells / 2))) for a, b in pairwise(cuts)]

    bright = whole = 0.0
    for t0, t1, j in pieces(row):
        for s0, s1, i in pieces(column):
            part = solid_angle(s0, s1, t0, t1)
            whole += part
            bright += part * ((i + j) % 2 == 0)
    return bright / whole


TEXELS = [(0, 0), (2, 2), (2, 5), (5, 1), (7, 4), (3, 3)]


def check_texels(faces, cells):
    for row, column in TEXELS:
        # Measured 6e-8, the rounding to float32.
        expected = mean_by_quadrature(row, column, 8, cells)
        assert faces[:, row, column].flatten().tolist() == pytest.approx([expected] * 18, abs=1e-6)


@pytest.mark.parametrize("cells", [3, 5, 6, 13])
def test_a_texel_on_an_edge_holds_its_mean(cells):
    check_texels(checker(cells=cells, resolution=8).faces, cells)


@pytest.mark.parametrize("wrong", ["centre", "plane"])
def test_the_check_of_texels_notices(wrong):
    n = 8 if wrong == "centre" else 4096
    cell = np.floor((np.arange(n) + 0.5) / n * 5).astype(int)
    board = ((cell[:, None] + cell[None, :]) % 2 == 0).astype(float)
    mean = torch.tensor(board.reshape(8, n // 8, 8, n // 8).mean((1, 3)))

    with pytest.raises(AssertionError):
        check_texels(mean[None, :, :, None].expand(6, 8, 8, 3), 5)


@pytest.mark.parametrize("resolution", [2, 16, 128])
@pytest.mark.parametrize("cells", [2, 6, 100])
def test_with_an_even_number_of_cells_the_mean_is_halfway(cells, resolution):
    mean = checker(cells=cells, resolution=resolution, bright=[4.0, 2.0, 1.0], dark=[1.0, 1.0, 0.0]).mean()

    # Measured 3e-8.
    assert mean.tolist() == pytest.approx([2.5, 1.5, 0.5], rel=1e-6)


@pytest.mark.parametrize("cells", [1, 3, 7])
def test_the_mean_does_not_depend_on_the_resolution(cells):
    coarse, fine = (checker(cells=cells, resolution=r).mean()[0].item() for r in (4, 64))

    edges = 2 * np.arange(cells + 1) / cells - 1
    corner = np.arctan2(np.outer(edges, edges), np.sqrt(1 + edges[:, None] ** 2 + edges[None, :] ** 2))
    squares = np.diff(np.diff(corner, axis=0), axis=1)
    row, column = np.indices(squares.shape)
    expected = 6 * squares[(row + column) % 2 == 0].sum() / (4 * np.pi)
    # Measured 2e-8.
    assert [coarse, fine] == pytest.approx([expected] * 2, rel=1e-6)


def test_more_cells_than_texels_are_nearly_grey():
    faces = checker(cells=1024, resolution=4).faces

    torch.testing.assert_close(faces, torch.full_like(faces, 0.5), rtol=0, atol=1e-3)


def test_in_one_face_neighbours_differ_across_every_inner_edge():
    n = 6
    faces = checker(cells=n, resolution=64).faces[..., 0]
    centres = ((np.arange(n) + 0.5) / n * 64).astype(int)

    board = faces[:, centres][:, :, centres]

    assert (board[:, 1:] + board[:, :-1] == 1).all()
    assert (board[:, :, 1:] + board[:, :, :-1] == 1).all()


def test_four_side_faces_make_one_board():
    n = 6
    faces = checker(cells=n, resolution=64).faces[..., 0]
    centres = ((torch.arange(n) + 0.5) / n * 64).long()

    # From left to right as a camera that turns right sees them: -z, +x, +z, -x.
    ring = torch.cat([faces[f][centres][:, centres] for f in (5, 0, 4, 1)], dim=1)

    assert (ring + ring.roll(1, dims=1) == 1).all()


def test_the_top_left_square_is_bright():
    faces = checker(cells=2, resolution=16, bright=2.0, dark=0.25).faces

    assert (faces[:, :8, :8] == 2).all()
    assert (faces[:, :8, 8:] == 0.25).all()
    # Up and forward of +x lies its left upper square: forward is to the left as one looks along +x.
    d = stack(texel_directions(16))
    upper_left = (d[0, ..., 1] > 0) & (d[0, ..., 2] < 0)
    assert (faces[0][upper_left] == 2).all()


def test_options_change_the_key():
    one, other = checker(cells=4, resolution=8), checker(cells=5, resolution=8)

    assert one.key != other.key
    assert one.key == checker(cells=4, resolution=8).key
