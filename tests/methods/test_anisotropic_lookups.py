"""Lookups for anisotropic lobes: the ends of the arc by search, the horizon, the limits of a round lobe."""

from math import pi

import pytest
import torch

from glossbench.brdf.ggx import GGX
from glossbench.directions import Vec3, dot, reflect, spherical, stack
from glossbench.envmap.lights.synthetic import Spots
from glossbench.envmap.pyramid import lookup
from glossbench.methods import major_axis
from glossbench.methods.bent_normal import BentNormal, bend
from glossbench.methods.major_axis import Ellipse, MajorAxis, find_arc, find_extremes
from glossbench.prefilter.ggx_chain import ggx_levels, level_of_alpha
from glossbench.scene.sphere import Sphere
from glossbench.shading.image import shade

VIEW = Sphere(resolution=12)
THETAS = [0.2, 0.7, 1.2]


def views(theta, n=7):
    azimuth = torch.linspace(0.1, 3, n, dtype=torch.float64)
    return spherical(torch.full_like(azimuth, theta), azimuth)


def ellipse(x, y):
    return Ellipse(*(torch.tensor(v, dtype=torch.float64) for v in (x, y)))


def search(wo, radii, n=20_000):
    """The parameters of the slopes whose reflections are nearest to and farthest from the mirror direction."""
    t = torch.arange(n, dtype=torch.float64)[:, None] * (pi / n)
    h = torch.stack(torch.broadcast_tensors(radii.x * t.cos(), radii.y * t.sin(), torch.ones_like(t)))
    away = torch.stack(list(reflect(wo, Vec3(*(h / h.norm(dim=0)))))) - torch.stack([-wo.x, -wo.y, wo.z])[:, None]
    chord = away.norm(dim=0)
    return t[chord.argmin(0), 0], t[chord.argmax(0), 0]


def differences(theta, radii):
    """Angles between the found and the searched parameters."""
    wo = views(theta)
    pairs = zip(find_extremes(wo, radii), search(wo, radii), strict=True)
    return [((a - b + pi / 2) % pi - pi / 2).abs().max() for a, b in pairs]


@pytest.mark.parametrize("theta", THETAS)
@pytest.mark.parametrize("radii", [(0.4, 0.1), (0.1, 0.4), (0.2, 0.19)])
def test_extremes_are_those_of_a_search(theta, radii):
    # Measured: 7.9e-5, half a step of the search.
    assert max(differences(theta, ellipse(*radii))) < 1.6e-4


def test_a_search_notices_a_wrong_sign(monkeypatch):
    right = find_extremes
    monkeypatch.setitem(globals(), "find_extremes", lambda wo, radii: right(Vec3(-wo.x, wo.y, wo.z), radii))

    assert max(differences(0.7, ellipse(0.4, 0.1))) > 0.01


def test_no_lookup_is_below_the_horizon():
    for theta in (0.2, 1.2, 1.5):
        wo = views(theta)
        first, last, width = find_arc(wo, ellipse(0.6, 0.05), 8)

        assert all((reflect(wo, m).z > -1e-6).all() for m in (first, last))
        assert (width > 0).all()


def test_the_arc_of_a_round_lobe_that_is_seen_along_the_normal_is_one_point():
    wo = spherical(torch.zeros(1).double(), torch.zeros(1).double())
    alpha = 0.2

    first, last, width = find_arc(wo, ellipse(alpha / 2**0.5, alpha / 2**0.5), 8)

    assert dot(first, last) > 1 - 1e-12
    # Half the chord between reflections that are 4 atan(alpha / sqrt(2)) apart: 1.39 alpha.
    slope = torch.tensor(alpha / 2**0.5).atan()
    torch.testing.assert_close(width, torch.sin(2 * slope).double()[None], rtol=1e-6, atol=0)


def one_lookup(direction, alpha, light, points, albedo):
    levels = ggx_levels.function(None, light)
    lod = level_of_alpha(levels, alpha).expand(len(points))
    return albedo * lookup(levels, direction, lod)


@pytest.mark.parametrize("formula", ["filament", "khronos"])
def test_a_round_lobe_is_not_bent(formula):
    light, points = Spots(seed=7, resolution=16).cubemap(), VIEW.points()
    material = GGX(alpha=0.09)
    wo = points.wo_local()

    d, alpha = bend(material.reflectance().lobes[0], wo, formula)

    mirror = Vec3(-wo.x, -wo.y, wo.z)
    towards = {"filament": 0.09**2, "khronos": 0.09}[formula]
    mixed = stack(mirror) * (1 - towards) + torch.tensor([0, 0, towards])
    torch.testing.assert_close(stack(d), mixed / mixed.norm(dim=1, keepdim=True), rtol=0, atol=1e-6)
    image = shade(BentNormal(formula=formula), light, material, VIEW, time_it=False)
    world = points.map(lambda c: c)
    direction = Vec3(*(dot(d, Vec3(*c)) for c in zip(world.t, world.b, world.n, strict=True)))
    expected = one_lookup(direction, alpha, light, points, material.albedo(wo).float())
    # Measured: 2e-3, of the table of the albedo at the rim.
    torch.testing.assert_close(image.radiance[image.mask], expected, rtol=5e-3, atol=1e-4)


@pytest.mark.parametrize("formula", ["filament", "hdrp", "khronos"])
def test_turning_the_widths_turns_the_lookup(formula):
    wo = Vec3(*(c.float() for c in views(0.9)))
    turned = Vec3(-wo.y, wo.x, wo.z)
    lobes = [GGX(alpha=alpha).reflectance().lobes[0] for alpha in ((0.4, 0.1), (0.1, 0.4))]

    (d, alpha), (e, beta) = bend(lobes[0], wo, formula), bend(lobes[1], turned, formula)

    torch.testing.assert_close(stack(Vec3(-d.y, d.x, d.z)), stack(e), rtol=0, atol=1e-6)
    assert alpha == beta
    assert (stack(bend(lobes[0], turned, formula)[0]) - stack(e)).abs().max() > 0.1


def anisotropic_error(monkeypatch=None):
    """RMS against 1024 samples, over that of one lookup."""
    from glossbench.methods.importance_sampling import ImportanceSampling

    light, material = Spots(seed=7, resolution=32, contrast=30.0).cubemap(), GGX(alpha=(0.4, 0.05))
    truth, streak, blob = (
        shade(method, light, material, VIEW, time_it=False).radiance
        for method in (ImportanceSampling(samples=4096), MajorAxis(samples=16), BentNormal())
    )
    return float((streak - truth).norm() / (blob - truth).norm())


def test_a_streak_is_nearer_to_the_truth_than_one_bent_lookup():
    # Measured: 0.50.
    assert anisotropic_error() < 0.7


def test_a_streak_along_the_narrow_axis_is_noticed(monkeypatch):
    monkeypatch.setattr(major_axis, "find_ellipse", lambda lobe: Ellipse(*(w / 2**0.5 for w in lobe.widths[::-1])))

    assert anisotropic_error() > 0.9
