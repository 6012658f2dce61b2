"""Prefiltered cosine lobes: sums over texels in float64, the powers of the programs' levels, what is refused."""

import numpy as np
import pytest
import torch

from glossbench.brdf.ggx import GGX
from glossbench.brdf.lafortune import Lafortune
from glossbench.brdf.phong import Phong
from glossbench.contract.cases import GivenPoints
from glossbench.directions import Vec3, cross
from glossbench.envmap.cubemap import texel_directions, texel_solid_angles
from glossbench.envmap.lights.synthetic import Spots
from glossbench.methods.prefiltered_cosine_lobes import PrefilteredCosineLobes
from glossbench.scene.points import ShadingPoints
from glossbench.scene.virtual_cube import tangent
from glossbench.shading.image import shade
from glossbench.shading.stage_cache import StageCache

LIGHT = Spots(seed=7, resolution=32).cubemap()
CACHE = StageCache()
# Specular powers 256, 32, 4 of levels of 32, 16, 8 texels; seen along the normal at every tenth texel of level 1.
LEVELS = {"gloss_scale": 6.0, "gloss_bias": 2.0, "levels": 3}
NORMALS = Vec3(*(c.flatten()[::10] for c in texel_directions(16)))


def image_of(material, **options):
    t = tangent(NORMALS)
    view = GivenPoints(ShadingPoints(t, cross(NORMALS, t), NORMALS, NORMALS))
    method = PrefilteredCosineLobes(**LEVELS, **options)
    return shade(method, LIGHT, material, view, cache=CACHE, time_it=False).radiance[0].double()


def mean_under(p):
    """Sum over all texels of w (n . l)^p L / sum of w (n . l)^p, in float64 and numpy."""
    w = np.broadcast_to(texel_solid_angles(32).numpy(), (6, 32, 32)).reshape(-1)
    d = np.stack([c.double().numpy().reshape(-1) for c in texel_directions(32)])
    n = np.stack([c.double().numpy() for c in NORMALS], axis=1)
    k = np.clip(n @ d, 0, None) ** p * w
    return torch.tensor(k @ LIGHT.faces.double().numpy().reshape(-1, 3) / k.sum(1, keepdims=True))


def relative_rms(a, b):
    return float((a - b).square().mean().sqrt() / b.mean())


@pytest.mark.parametrize(
    ("material", "model", "p"),
    [
        (Phong(s=32, foreshortening=False), "phong", 32),
        (Phong(s=32), "phongbrdf", 33),
        (Phong(s=8, foreshortening=False), "blinn", 8),  # reads the level of 4 s = 32
        (Phong(s=8), "blinnbrdf", 9),
    ],
)
def test_along_the_normal_it_is_the_sum_over_texels(material, model, p):
    found = image_of(material, model=model)

    assert (
        relative_rms(found, mean_under(p)) < 4e-3
    )  # measured 2e-5 for 32, where all texels are summed, and 1.6e-3 for 8
    assert relative_rms(found, mean_under(1.1 * p)) > 8e-3


def test_a_lobe_of_half_vectors_has_a_quarter_of_their_exponent():
    alpha = (2 / (4 * 8 + 2)) ** 0.5  # 2 / alpha^2 - 2 = 32

    found = image_of(GGX(alpha=(alpha, alpha)), model="blinn")

    albedo = GGX(alpha=(alpha, alpha)).albedo(Vec3(*(torch.tensor([c]) for c in (0.0, 0.0, 1.0))))
    assert relative_rms(found, mean_under(8) * albedo) < 4e-3  # measured 1.6e-3


def test_lobes_about_other_axes_are_refused():
    assert "mirror" in PrefilteredCosineLobes().supports(Lafortune(C=(-1.0, -1.0, 0.7)), None)
    assert PrefilteredCosineLobes().supports(Phong(), None) is None
    assert PrefilteredCosineLobes().supports(GGX(alpha=(0.3, 0.1)), None) is None
