from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.sparse import csr_array

from glossbench.directions import Vec3, normalize
from glossbench.envmap.cubemap import CubeMap, texel_directions
from glossbench.envmap.pyramid import finest, lookup
from glossbench.errors import InputError
from glossbench.factorization import FactorMap, average_start, factorize, grid_laplacian, grid_rows, weight_rows
from glossbench.methods.lighting_factorization.cube_rows import cube_laplacian, cube_rows

SOLVERS = ["qmr", "lsmr", "cg"]


def random_maps(n_samples=3000, edge=7, n_maps=2, seed=0):
    """Images read at random places."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0, edge, (n_maps, 2, n_samples))
    return [FactorMap(grid_rows(*place, (edge, edge)), grid_laplacian((edge, edge))) for place in places]


def product_of(maps, logs):
    return sum(one.read(log) for one, log in zip(maps, logs, strict=True))


def random_directions(n, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return normalize(Vec3(*torch.randn(3, n, generator=generator, dtype=torch.float64)))


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("n_maps", [1, 2, 3])
def test_a_product_of_maps_is_recovered_to_the_solvers_precision(solver, n_maps):
    maps = random_maps(n_maps=n_maps)
    rng = np.random.default_rng(1)
    log_f = product_of(maps, [rng.normal(size=(49, 3)) for _ in maps])

    found = factorize(log_f, maps, 0.0, solver, 1e-13)

    # Measured 6e-13 to 2e-12.
    assert np.abs(product_of(maps, found.logs) - log_f).max() < 1e-11


def test_recovery_notices_transposed_places():
    maps = random_maps()
    rng = np.random.default_rng(1)
    log_f = product_of(maps, [rng.normal(size=(49, 3)) for _ in maps])
    swapped = np.arange(49).reshape(7, 7).T.ravel()

    # Only one of the two weights of each tap goes to the other axis.
    wrong = [replace(maps[0], rows=csr_array((maps[0].rows + maps[0].rows[:, swapped]) / 2)), maps[1]]
    found = factorize(log_f, wrong, 0.0, "cg", 1e-13)

    assert np.abs(product_of(wrong, found.logs) - log_f).max() > 0.1


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("smoothness", [0.3, 3.0])
def test_solution_is_that_of_dense_least_squares(solver, smoothness):
    maps = random_maps(n_samples=300, edge=5)
    log_f = np.random.default_rng(2).normal(size=(300, 2))
    left = np.block(
        [
            [maps[0].rows.toarray(), maps[1].rows.toarray()],
            [smoothness * maps[0].laplacian.toarray(), np.zeros((25, 25))],
            [np.zeros((25, 25)), smoothness * maps[1].laplacian.toarray()],
        ]
    )
    expected = np.linalg.lstsq(left, np.concatenate([log_f, np.zeros((50, 2))]), rcond=None)[0]

    found = factorize(log_f, maps, smoothness, solver, 1e-12)

    # What both maps share is left open: compared is what samples read. Measured 1e-11.
    read = left[:300] @ expected
    assert np.abs(product_of(maps, found.logs) - read).max() < 1e-9


def test_a_start_that_is_the_solution_takes_no_iteration():
    maps = random_maps()
    logs = [np.random.default_rng(3).normal(size=(49, 3)) for _ in maps]

    found = factorize(product_of(maps, logs), maps, 0.0, start=logs)

    assert found.iterations == 0
    assert all(np.array_equal(a, b) for a, b in zip(found.logs, logs, strict=True))


def test_weighted_average_is_nearer_than_zero():
    maps = random_maps()
    log_f = product_of(maps, [np.random.default_rng(4).normal(size=(49, 3)) + 2 for _ in maps])

    start = average_start(log_f, maps)

    assert np.abs(product_of(maps, start).mean(0) - log_f.mean(0)).max() < 0.05
    assert np.square(product_of(maps, start) - log_f).mean() < 0.2 * np.square(log_f).mean()


def test_average_of_one_map_is_the_weighted_mean_of_the_samples_of_each_texel():
    (one,) = random_maps(n_samples=50, edge=3, n_maps=1)
    log_f = np.random.default_rng(5).normal(size=(50, 1))

    (start,) = average_start(log_f, [one])

    dense = one.rows.toarray()
    for texel in range(9):
        expected = sum(dense[s, texel] * log_f[s, 0] for s in range(50)) / dense[:, texel].sum()
        assert start[texel, 0] == pytest.approx(expected)


def test_texels_without_samples_take_their_neighbours_value():
    rows = grid_rows(np.full(4, 0.5), np.full(4, 0.5), (4, 4))  # all look at the first texel
    one = FactorMap(rows, grid_laplacian((4, 4)))

    (start,) = average_start(np.full((4, 1), 2.5), [one])

    assert np.array_equal(start, np.full((16, 1), 2.5))


def test_the_laplacian_fills_what_no_sample_sees():
    rows = grid_rows(np.array([0.5, 3.5]), np.array([0.5, 0.5]), (4, 1))
    one = FactorMap(rows, grid_laplacian((4, 1)))

    found = factorize(np.array([[0.0], [3.0]]), [one], 1e-3, "cg", 1e-12)

    # Free ends bend least: of a Laplacian whose end rows are single differences, the least is not a straight line.
    inside = found.logs[0][1:3, 0]
    assert 0 < inside[0] < inside[1] < 3


def test_samples_that_share_a_row_are_as_samples_with_rows_of_their_own():
    shared_rows = grid_rows(np.array([0.7, 2.1]), np.array([1.2, 1.9]), (3, 3))
    of_sample = np.array([1, 0, 0, 1, 1])
    shared = FactorMap(shared_rows, grid_laplacian((3, 3)), of_sample)
    own = FactorMap(csr_array(shared_rows[of_sample]), grid_laplacian((3, 3)))
    values, samples = np.random.default_rng(6).normal(size=(9, 2)), np.random.default_rng(7).normal(size=(5, 2))

    np.testing.assert_allclose(shared.read(values), own.read(values), rtol=1e-13)
    np.testing.assert_allclose(shared.gather(samples), own.gather(samples), rtol=1e-13)
    np.testing.assert_allclose(shared.sum_squares(), own.sum_squares(), rtol=1e-13)


def test_bilinear_rows_reproduce_a_linear_image():
    row, column = np.random.default_rng(8).uniform(0.5, 4.5, (2, 100))
    v, u = np.meshgrid(np.arange(5) + 0.5, np.arange(5) + 0.5, indexing="ij")

    read = grid_rows(row, column, (5, 5)) @ (2 * v - 3 * u + 1).ravel()

    np.testing.assert_allclose(read, 2 * row - 3 * column + 1, atol=1e-12)


@pytest.mark.parametrize("edge", [2, 3, 8])
def test_rows_of_a_cube_are_the_seamless_lookup(edge):
    d = random_directions(2000)
    faces = torch.rand(6, edge, edge, 3, generator=torch.Generator().manual_seed(1))

    read = cube_rows(d, edge) @ faces.reshape(-1, 3).numpy()

    if edge & (edge - 1) == 0:
        expected = lookup(finest(CubeMap(faces, "cube")), Vec3(*(c.float() for c in d)))
        # Float32 places: measured 4e-6.
        np.testing.assert_allclose(read, expected, atol=2e-5)
    np.testing.assert_allclose(cube_rows(d, edge).sum(1), 1, atol=1e-12)


def test_rows_at_texel_centres_read_those_texels():
    d = Vec3(*(c.double().reshape(-1) for c in texel_directions(6)))

    rows = cube_rows(d, 6).toarray()

    np.testing.assert_allclose(rows, np.eye(216), atol=1e-6)


@pytest.mark.parametrize("edge", [2, 3, 8])
def test_each_texel_of_a_cube_has_four_neighbours_at_like_distance(edge):
    laplacian = cube_laplacian(edge).toarray()
    d = torch.stack([c.reshape(-1) for c in texel_directions(edge)], 1).double().numpy()

    off = laplacian - np.diag(np.diag(laplacian))

    assert np.array_equal(np.diag(laplacian), np.full(6 * edge**2, 4.0))
    assert np.array_equal(off, off.T)
    assert set(np.unique(off)) == {-1.0, 0.0}
    assert np.array_equal(laplacian.sum(1), np.zeros(6 * edge**2))
    angles = np.arccos(np.clip((d @ d.T)[off < 0], -1, 1))
    # The nearest texels: a quarter turn over the edge's texels, more in a face's middle and less at its rim.
    assert angles.max() < 1.3 * np.pi / 2 / edge


def test_a_laplacian_without_edges_leaves_seams():
    """The planted fault: six images side by side, each smooth by itself, do not join."""
    edge, d = 8, random_directions(400, seed=3)
    x, y, z = (c.abs().numpy() for c in d)
    keep = y < 0.85 * np.maximum(x, z)  # no sample reads a texel of the faces +y and -y
    one = FactorMap(csr_array(cube_rows(d, edge)[keep]), cube_laplacian(edge))
    block = grid_laplacian((edge, edge)).toarray()
    apart = replace(one, laplacian=csr_array(np.kron(np.eye(6), block)))
    log_f = d.y.numpy()[keep, None]

    def top(factor_map):
        (log,) = factorize(log_f, [factor_map], 0.1, "cg", 1e-10, start=[np.zeros((6 * edge**2, 1))]).logs
        return log.reshape(6, edge, edge)[2].mean()

    # d_y is 0.58 to 0.71 on the rim of the face +y.
    assert top(one) > 0.5
    assert top(apart) == 0.0


@pytest.mark.parametrize("bad", [np.nan, -np.inf])
def test_a_sample_that_is_not_finite_is_refused(bad):
    maps = random_maps(n_samples=10)
    log_f = np.zeros((10, 1))
    log_f[3] = bad

    with pytest.raises(InputError, match="not finite"):
        factorize(log_f, maps, 1.0)


def test_other_numbers_of_samples_are_refused():
    with pytest.raises(InputError, match="map 0 is read by 10 samples, but there are 9"):
        factorize(np.zeros((9, 1)), random_maps(n_samples=10), 1.0)


def test_texels_beyond_the_map_are_refused():
    with pytest.raises(InputError, match=r"texels must be in \[0, 9\), got 3 to 9"):
        weight_rows([[3, 9]], [[0.5, 0.5]], 9)
