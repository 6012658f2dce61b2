"""The mirror: under the constant light it shows the light, and under any light what the formula says."""

import torch

import glossbench as gb


def test_it_shows_a_constant_light_as_it_is():
    view = gb.view("sphere", resolution=8)
    image = gb.shade(gb.method("mirror"), gb.light("constant", radiance=3), gb.material("ggx"), view)
    torch.testing.assert_close(image.radiance[image.mask], torch.full((int(image.mask.sum()), 3), 3.0))


def test_the_middle_of_a_ball_shows_what_is_behind_the_viewer():
    view, light = gb.view("sphere", resolution=64), gb.light("gradient", resolution=64)
    image = gb.shade(gb.method("mirror"), light, gb.material("ggx"), view)
    torch.testing.assert_close(
        image.radiance[31:33, 31:33].mean((0, 1)), torch.tensor([0.5, 0.5, 1.0]), atol=0.02, rtol=0
    )
