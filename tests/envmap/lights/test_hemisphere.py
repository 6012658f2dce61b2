"""The hemisphere: bright above the horizon, black below, with a known mean."""

import torch

import glossbench as gb


def test_half_of_all_directions_are_bright():
    faces = gb.light("hemisphere", radiance=2, resolution=8).faces
    assert set(faces.unique().tolist()) == {0.0, 2.0}
    torch.testing.assert_close(faces.mean(), torch.tensor(1.0))
