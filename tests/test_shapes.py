"""The checks of shapes in signatures see wrong ones."""

import pytest
import torch
from jaxtyping import TypeCheckError

import glossbench as gb
from glossbench.brdf.ggx import TrowbridgeReitz
from glossbench.directions import Vec3
from glossbench.metrics.pixelwise import RMS
from glossbench.shading.kernels import over_points

ALPHA = torch.tensor(0.3)
ONE = torch.ones(())
VIEW = gb.view("sphere", resolution=4)


def up(*shape):
    """Directions along the normal."""
    zero = torch.zeros(shape)
    return Vec3(zero, zero, zero + 1)


def lobe_of(kind):
    return kind((ALPHA, ALPHA), (ONE,), (ONE,))


def test_points_and_samples_that_broadcast_pass():
    pdf = lobe_of(TrowbridgeReitz).pdf(up(4, 1), up(1, 5))

    assert pdf.shape == (4, 5)


def test_directions_that_do_not_broadcast_are_seen():
    with pytest.raises(TypeCheckError, match="'wi'"):
        lobe_of(TrowbridgeReitz).pdf(up(4, 1), up(3, 5))


def test_a_lobe_whose_parameter_is_not_a_scalar_is_noticed():
    with pytest.raises(TypeCheckError, match="'widths'"):
        TrowbridgeReitz((torch.ones(2), ALPHA), (ONE,), (ONE,))


def test_a_density_of_points_that_meet_each_other_is_seen(monkeypatch):
    monkeypatch.setattr(TrowbridgeReitz, "q", lambda self, slope2: slope2.T)  # (1, 4), which meets (4, 1) in silence

    with pytest.raises(TypeCheckError, match="return value"):
        lobe_of(TrowbridgeReitz).D(up(4, 1))


def test_a_kernel_that_returns_a_vector_is_seen():
    points = VIEW.points()

    with pytest.raises(TypeCheckError, match="return value"):
        over_points(lambda chunk: chunk.n.x[:, 0], points, 1)


def test_points_of_the_unit_square_in_rows_of_three_are_seen():
    with pytest.raises(TypeCheckError, match="'u'"):
        lobe_of(TrowbridgeReitz).sample_points(torch.rand(8, 3))


def test_an_image_of_another_size_than_its_mask_is_seen():
    with pytest.raises(TypeCheckError, match="'mask'"):
        gb.Image(torch.zeros(2, 3, 3), torch.ones(3, 2, dtype=torch.bool))


def test_an_image_in_grey_is_seen():
    with pytest.raises(TypeCheckError, match="'radiance'"):
        gb.Image(torch.zeros(2, 3, 1), torch.ones(2, 3, dtype=torch.bool))


def test_errors_of_a_metric_in_single_precision_are_seen():
    x = torch.zeros(2, 3, 3).numpy()

    with pytest.raises(TypeCheckError, match="'x'"):
        RMS().errors(x, x, x[..., 0] == 0)


def test_radiance_of_a_method_in_grey_is_seen(monkeypatch):
    monkeypatch.setattr("glossbench.methods.environment_sampling.over_points", lambda *arguments: torch.ones(4, 1))

    with pytest.raises(TypeCheckError, match="return value"):
        gb.shade(gb.method("environment_sampling"), gb.light("constant", resolution=2), gb.material("ggx"), VIEW)
