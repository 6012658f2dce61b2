"""The retroreflector: the lobe is largest towards the viewer, and its integral is known along the normal."""

import math

import torch

import glossbench as gb
from glossbench.directions import spherical


def test_the_lobe_is_largest_towards_the_viewer_and_has_its_closed_form():
    material = gb.material("retroreflector", s=10, ks=0.5)
    theta = torch.tensor([0.4])
    viewer = spherical(theta, torch.zeros(1))
    towards, apart = (material.f(viewer, spherical(theta + angle, torch.zeros(1)))[0] for angle in (0.0, 0.3))
    torch.testing.assert_close(towards.flatten(), torch.tensor([0.5 * 12 / (2 * math.pi)]))
    torch.testing.assert_close(apart.flatten(), towards.flatten() * math.cos(0.3) ** 10)


def test_the_albedo_along_the_normal_is_ks():
    up = spherical(torch.zeros(1), torch.zeros(1))
    albedo = gb.material("retroreflector", s=10, ks=0.5).albedo(up)
    torch.testing.assert_close(albedo, torch.full((1, 3), 0.5).double(), rtol=2e-3, atol=0)
