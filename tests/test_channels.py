"""Quantities in colour."""

import torch

from glossbench.channels import channels, channels_unless_black, merge_channels, scalar


def test_a_grey_colour_is_one_tensor_and_a_black_one_none():
    assert [c.item() for c in channels((0.5, 0.5, 0.5), "cpu")] == [0.5]
    assert [c.item() for c in channels_unless_black((0.25, 0.5, 1.0), "cpu")] == [0.25, 0.5, 1.0]
    assert channels_unless_black((0.0, 0.0, 0.0), "cpu") == ()


def test_a_scalar_is_of_single_precision():
    assert scalar(0.1, "cpu").dtype == torch.float32


def test_each_sum_by_channel_gives_its_own_column():
    red, green, blue = (torch.full((2, 3), v) + torch.arange(3) for v in (10.0, 20.0, 30.0))

    assert merge_channels([red, green, blue]).tolist() == [[10.0, 21.0, 32.0]] * 2
    assert merge_channels([red]) is red
