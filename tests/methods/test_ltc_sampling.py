"""Linearly transformed cosines: the density integrates to one, samples follow it, and a lobe of that kind is found."""

from math import acos, pi

import pytest
import torch

from glossbench.brdf.ggx import GGX
from glossbench.directions import Vec3, cosine_hemisphere, points_2d
from glossbench.methods.ltc_sampling import VIEWS, Transforms, fit_transforms, transform

LOBE = GGX(alpha=0.3).reflectance().lobes[0]
WO = Vec3(*(torch.tensor([[v]]) for v in (-0.6, 0.0, 0.8)))


def fitted():
    return fit_transforms(LOBE)


def mean_under(transforms, wo, n=1 << 14):
    """Means of wi and of 1 / pdf over samples: the second is the solid angle of all directions that are reached."""
    o = Vec3(*(c[None] for c in cosine_hemisphere(points_2d(n))))
    wi, pdf = transform(wo, o, transforms)
    return torch.stack([c.mean() for c in wi]), (1 / pdf).mean()


def unit(x, z, y=1.0):
    """The same M for all views: diag(x, y, z)."""
    zero, one = torch.zeros(VIEWS), torch.ones(VIEWS)
    return Transforms(x * one, zero, y * one, zero, z * one)


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_the_density_of_any_transform_covers_its_hemisphere(scale):
    # E[1 / pdf] is the solid angle of the hemisphere into which M maps: 2 pi.
    _, area = mean_under(unit(scale, 1.0, scale), WO)

    # Measured: 0.2 %.
    assert abs(area / (2 * pi) - 1) < 0.01


def test_a_determinant_that_is_left_out_is_noticed():
    _, area = mean_under(unit(2.0, 1.0, 2.0), WO)

    assert abs(area / 4 / (2 * pi) - 1) > 0.01


def mean_of_the_lobe(wo):
    sample = LOBE.sample(wo, LOBE.sample_points(points_2d(1 << 14)))
    weight = sample.weight[0] / sample.weight[0].sum()
    return torch.stack([(c * weight).sum() for c in sample.wi])


def difference_of_means(transforms):
    return float((mean_under(transforms, WO)[0] - mean_of_the_lobe(WO)).norm())


def test_samples_have_the_mean_of_the_lobe():
    # Measured: 0.053: some samples are below the horizon.
    assert difference_of_means(fitted()) < 0.1


def test_samples_towards_the_viewer_are_noticed():
    M = fitted()

    assert difference_of_means(replace_signs(M)) > 0.1


def replace_signs(M):
    return M._replace(xz=-M.xz, zx=-M.zx)


def cross_entropy(transforms, n=1 << 12):
    """- mean of log p over samples of the lobe, minus that of the lobe's own density: the divergence, in nats."""
    sample = LOBE.sample(WO, LOBE.sample_points(points_2d(n)))
    k = round(acos(0.8) * VIEWS / (pi / 2))
    xx, xz, yy, zx, zz = (m[k].double() for m in transforms)
    M = torch.tensor([[xx, 0, xz], [0, yy, 0], [zx, 0, zz]])
    wi = torch.stack([c[0].double() for c in sample.wi])
    o = torch.linalg.inv(M) @ wi
    p = o[2].clamp(min=1e-6) / pi / torch.linalg.det(M) / o.norm(dim=0) ** 4
    weight = sample.weight[0][0].double() / sample.weight[0].sum()
    f = sample.pdf[0].double()
    return float((weight * (f.log() - p.log())).sum())


def test_the_fit_is_near_the_lobe_in_divergence():
    # Measured: 0.076; of another width 0.41.
    assert cross_entropy(fitted()) < 0.15


def test_the_fit_of_another_width_is_noticed():
    other = fit_transforms(GGX(alpha=0.15).reflectance().lobes[0])

    assert cross_entropy(other) > 0.15


def test_at_the_normal_the_transform_is_round():
    M = fitted()

    # Measured: 4e-4 and 0.003.
    assert abs(M.xx[0] / M.yy[0] - 1) < 0.005
    assert abs(M.xz[0]) < 0.02
