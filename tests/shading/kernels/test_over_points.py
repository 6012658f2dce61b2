"""Chunks: the same image, whatever their size."""

import pytest
import torch

from glossbench.brdf.kurt import Kurt
from glossbench.directions import points_2d, spherical, to_local, to_world
from glossbench.envmap.lights.synthetic import Spots
from glossbench.envmap.pyramid import weighted_radiance
from glossbench.prefilter.pyramids import build_pyramid
from glossbench.scene.sphere import Sphere
from glossbench.shading.kernels import over_points

N = 32


def kernel(points, lobe, samples, pyramid, level):
    """A sum over samples of a lobe, each from a level of a pyramid that its density gives."""
    wi, pdf, weight = lobe.sample(points.wo_local(), samples)
    d = to_world(wi, points.t, points.b, points.n)
    lod = level + 0.5 * (pyramid.log2_texels_per_sr(d) - torch.log2(pdf))
    return weighted_radiance(pyramid, d, lod, weight)


def product(points, reflectance, directions, power):
    """A sum over lights (1, N) of so much power (N, 3), as a product of matrices for each channel of the material."""
    wi = to_local(directions, points.t, points.b, points.n)
    values = [f * wi.z.clamp(min=0) @ power for f in reflectance.f(points.wo_local(), wi)]
    return torch.stack([value[:, c] for c, value in enumerate(values)], dim=1)


@pytest.fixture(scope="module")
def arguments():
    lobe = Kurt(m=(0.2, 0.1), f0=0.5).reflectance().lobes[0]
    pyramid = build_pyramid(Spots(seed=7, resolution=32).cubemap(), "box")
    return lobe, lobe.sample_points(points_2d(N)), pyramid, torch.tensor(-1.5)


@pytest.mark.parametrize("pairs", [1, 100, 1000, 7 * N, 1 << 14, 1 << 30])
def test_chunks_of_any_size_give_the_same_image(monkeypatch, arguments, pairs):
    points = Sphere(resolution=40).points()
    whole = over_points(kernel, points, N, *arguments)
    monkeypatch.setattr("glossbench.shading.kernels.chunks.CHUNK", pairs)

    chunked = over_points(kernel, points, N, *arguments)

    assert (chunked == whole).all()


@pytest.mark.parametrize("pairs", [1, 1000, 1 << 14])
def test_chunks_of_a_kernel_that_multiplies_matrices_agree(monkeypatch, pairs):
    points = Sphere(resolution=40).points()
    reflectance = Kurt(m=(0.2, 0.1), kd=(0.1, 0.2, 0.3)).reflectance()
    u = points_2d(500)
    lights = spherical(torch.pi * u[None, :, 0], 2 * torch.pi * u[None, :, 1]), torch.rand(500, 3)
    whole = over_points(product, points, 500, reflectance, *lights)
    monkeypatch.setattr("glossbench.shading.kernels.chunks.CHUNK", pairs)

    chunked = over_points(product, points, 500, reflectance, *lights)

    # Measured: the same bytes; a matrix product of another shape may still sum in another order.
    torch.testing.assert_close(chunked, whole, rtol=2e-6, atol=0)


@pytest.mark.parametrize("n_points", [1, 2, 3, 5])
def test_few_points_give_the_rows_of_many(monkeypatch, arguments, n_points):
    points = Sphere(resolution=10).points()
    all_rows = over_points(kernel, points, N, *arguments)
    first = type(points)(*(type(v)(*(c[:n_points] for c in v)) for v in (points.t, points.b, points.n, points.wo)))

    rows = over_points(kernel, first, N, *arguments)

    assert rows.shape == (n_points, 3)
    assert (rows == all_rows[:n_points]).all()


def test_every_point_is_in_one_chunk(monkeypatch):
    sizes = []

    def counting(points):
        sizes.append(len(points))
        return points.n.x

    points = Sphere(resolution=20).points()
    monkeypatch.setattr("glossbench.shading.kernels.chunks.CHUNK", 50 * N)

    back = over_points(counting, points, N)

    assert (back[:, 0] == points.n.x).all()
    assert sum(sizes) == len(points)
    assert max(sizes) <= 50
    assert max(sizes) - min(sizes) <= len(sizes)
