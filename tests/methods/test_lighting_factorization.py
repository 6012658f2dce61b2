from dataclasses import replace

import numpy as np
import pytest
import torch

import glossbench as gb
from glossbench.columns import CellRecord
from glossbench.directions import Vec3, dot, half_vector, reflect, spherical
from glossbench.envmap.cubemap import CubeMap, texel_directions
from glossbench.envmap.lights.loch import Loch
from glossbench.methods.brdf_factorization.factors import factor_brdf
from glossbench.methods.lighting_factorization import LightingFactorization
from glossbench.methods.lighting_factorization.cube_rows import cube_rows
from glossbench.methods.lighting_factorization.factors import dominant_direction, factor_direction, factor_lighting
from glossbench.methods.lighting_factorization.fixed_point import fixed_point
from glossbench.prefilter.lighting_function import LightingSamples
from glossbench.run.measuring import measure
from glossbench.scene.virtual_cube import pair_points, tangent, valid_pairs
from glossbench.shading.method import find_dependencies, order_stages
from glossbench.shading.stage_cache import StageCache

SMALL = {"virtual_edge": 4, "light_edge": 8, "edge": 8, "first_edge": 4, "tolerance": 1e-6}


def random_light(resolution=8, seed=0):
    faces = torch.rand(6, resolution, resolution, 3, generator=torch.Generator().manual_seed(seed))
    return CubeMap(faces + 0.1, f"random {seed}")


def random_pairs(n=500, seed=0):
    """Normals and views above the surface."""
    generator = torch.Generator().manual_seed(seed)
    n_, v = (torch.nn.functional.normalize(torch.randn(n, 3, generator=generator), dim=1) for _ in range(2))
    v = v * torch.sign((n_ * v).sum(1, keepdim=True))
    return Vec3(*n_.T), Vec3(*v.T)


def solved(samples, parameters="NR", edges=(4, 8), smoothness=0.0, tolerance=1e-10, solver="qmr"):
    dominant = torch.tensor([0.6, 0.8, 0.0])
    return factor_lighting(samples, parameters, dominant, edges, smoothness, 1e-9, 1e9, solver, tolerance, 2000)


def read(factors, names, points, level=-1):
    """The product of the maps between texels of the logarithm, by the rows of the solve."""
    total = 0.0
    for name, log in zip(names, factors.logs[level], strict=True):
        d = factor_direction(name, points.n, points.wo, factors.dominant)
        total = total + cube_rows(d, log.shape[1]) @ log.reshape(-1, 3).double().numpy()
    return np.exp(total)


@pytest.mark.parametrize(("parameters", "names"), [("NR", ("normal", "reflection")),
                                                   ("NRV", ("normal", "reflection", "view"))])  # fmt: skip
@pytest.mark.parametrize("solver", ["qmr", "cg"])
def test_a_lighting_function_that_is_a_product_is_recovered(parameters, names, solver):
    pairs = valid_pairs(4)
    points = pair_points(4, pairs).map(lambda c: c.double())
    true = {"normal": 0.3, "reflection": 1.0, "view": -0.5}
    generator = np.random.default_rng(0)
    log_lo = sum(
        true[name] * (cube_rows(factor_direction(name, points.n, points.wo, torch.zeros(3)), 4)
                      @ generator.normal(size=(96, 3)))
        for name in names
    )  # fmt: skip
    samples = LightingSamples(torch.from_numpy(np.exp(log_lo)), pairs, 4, 0)

    factors = solved(samples, parameters, edges=(4,), solver=solver)

    # Maps are kept in float32.
    np.testing.assert_allclose(read(factors, names, points), np.exp(log_lo), rtol=1e-5)


def test_finer_maps_start_from_the_coarser_ones():
    pairs = valid_pairs(4)
    points = pair_points(4, pairs)
    lo = torch.stack([2 + points.n.y, 2 + points.n.x, 2 + points.wo.z], 1).double()
    samples = LightingSamples(lo, pairs, 4, 0)

    at_once = solved(samples, edges=(16,), smoothness=0.3, tolerance=1e-6)
    by_steps = solved(samples, edges=(4, 8, 16), smoothness=0.3, tolerance=1e-6)

    assert [log[0].shape[1] for log in by_steps.logs] == [4, 8, 16]
    np.testing.assert_allclose(read(by_steps, ("normal", "reflection"), points),
                               read(at_once, ("normal", "reflection"), points), rtol=1e-3)  # fmt: skip


def test_directions_of_the_factors_are_those_of_the_paper():
    n, v = random_pairs()
    l = torch.tensor([0.6, 0.0, -0.8])  # noqa: E741
    t = torch.stack(tangent(n), 1)
    b = torch.linalg.cross(torch.stack(n, 1), t)

    half, difference = (torch.stack(factor_direction(f, n, v, l), 1) for f in ("half", "difference"))

    h = torch.nn.functional.normalize(l + torch.stack(v, 1), dim=1)
    expected = torch.stack([(h * t).sum(1), (h * b).sum(1), (h * torch.stack(n, 1)).sum(1)], 1)
    torch.testing.assert_close(half, expected, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(difference[:, 2], torch.stack(n, 1) @ l, rtol=1e-4, atol=1e-5)
    mirrored = factor_direction("reflection", n, v, l)
    torch.testing.assert_close(dot(mirrored, n), dot(v, n))
    assert factor_direction("view", n, v, l) is v


@pytest.mark.parametrize("face", range(6))
def test_the_dominant_direction_is_that_of_the_only_light(face):
    light = gb.light("texel", face=face, resolution=16)
    d = torch.stack([c[face, 8, 8] for c in texel_directions(16)])

    assert float(dominant_direction(light) @ d) > 1 - 1e-6


def test_a_light_without_a_direction_has_one_all_the_same():
    assert dominant_direction(gb.light("constant")).tolist() == [0.0, 1.0, 0.0]
    assert dominant_direction(CubeMap(torch.zeros(6, 4, 4, 3), "black")).tolist() == [0.0, 1.0, 0.0]


def test_eight_bits_round_to_half_a_step_and_bring_the_range_back():
    generator = torch.Generator().manual_seed(0)
    textures = [torch.rand(6, 8, 8, 3, generator=generator) * s + 0.01 for s in (1.5, 2.0)]

    stored = fixed_point(textures, 1.0)

    assert stored.scale in (1, 2, 4)
    assert bool((stored.color <= 1).all())
    assert all(torch.equal(q, torch.round(q * 255) / 255) and float(q.max()) == 1.0 for q in stored.textures)
    shown = stored.textures[0] * stored.textures[1] * stored.color * stored.scale
    largest = float(textures[0].max() * textures[1].max())
    # Each texture is off by at most half of 1/255 of its maximum.
    assert float((shown - textures[0] * textures[1]).abs().max()) <= 1.01 * largest / 255


def test_a_range_beyond_four_costs_highlights_or_all_of_the_brightness():
    textures = [torch.linspace(0.1, 10, 96).view(-1, 1).repeat(1, 3), torch.ones(96, 3)]

    cut, dark = fixed_point(textures, 1.0), fixed_point(textures, 0.0)

    def shown(one):
        return one.textures[0] * one.textures[1] * one.color * one.scale

    torch.testing.assert_close(cut.excess, torch.full((3,), 2.5))
    # Cut off: right in the dark, too dark where it was brightest. Dark: all by the excess.
    torch.testing.assert_close(shown(cut)[5], textures[0][5], rtol=0.05, atol=0)
    assert float(shown(cut)[-1, 0]) < 8
    torch.testing.assert_close(shown(dark)[-1] * 2.5, textures[0][-1])


def test_constant_light_on_a_lambertian_surface_is_exact():
    light = gb.light("constant", radiance=[1.0, 2.0, 3.0], resolution=8)
    material = gb.material("phong", s=0, ks=0, kd=0.5)
    view = gb.view("sphere", resolution=16)

    image = gb.shade(gb.method("lighting_factorization", **SMALL), light, material, view)

    # The light is summed over 384 texels.
    shown = image.radiance[image.mask]
    torch.testing.assert_close(shown, torch.tensor([0.5, 1.0, 1.5]).expand_as(shown), rtol=1e-2, atol=0)


@pytest.mark.parametrize("textures", ["float", "8bit"])
@pytest.mark.parametrize("parameters", ["NR", "NRV", "NRHD"])
def test_a_black_light_is_black(parameters, textures):
    method = gb.method("lighting_factorization", **SMALL, parameters=parameters, textures=textures)
    light = CubeMap(torch.zeros(6, 8, 8, 3), "black")

    image = gb.shade(method, light, gb.material("phong", s=3), gb.view("sphere", resolution=8))

    assert not image.radiance.any()


def test_normalisation_is_undone_and_clamp_is_in_its_unit():
    light, material = random_light(), gb.material("phong", s=3)
    view = gb.view("sphere", resolution=16)

    def image(**options):
        return gb.shade(gb.method("lighting_factorization", **SMALL, **options), light, material, view).radiance

    torch.testing.assert_close(image(normalisation="mean", clamp=4.0), image(clamp=100.0), rtol=1e-3, atol=1e-4)
    assert float(image(clamp=0.2).max()) < 0.3


@pytest.mark.parametrize("mip", ["factorized", "box"])
def test_mip_levels_have_the_brightness_of_the_finest(mip):
    light, material, view = random_light(), gb.material("phong", s=3), gb.view("sphere", resolution=16)

    fine, coarse = (
        gb.shade(gb.method("lighting_factorization", **SMALL, level=level, mip=mip), light, material, view)
        for level in (0, 1)
    )

    assert not torch.equal(fine.radiance, coarse.radiance)
    torch.testing.assert_close(coarse.radiance[fine.mask].mean(0), fine.radiance[fine.mask].mean(0), rtol=0.05, atol=0)


def test_all_is_redone_for_a_new_light_or_material_and_nothing_for_a_view():
    depends = find_dependencies(order_stages(LightingFactorization))

    assert all({"light", "material"} <= inputs for inputs in depends.values())
    assert not any({"scene", "view"} & inputs for inputs in depends.values())


def test_an_anisotropic_material_is_skipped_with_a_reason():
    method = gb.method("lighting_factorization")

    assert "anisotropic" in method.supports(gb.material("kurt", m=[0.3, 0.1]), None)
    assert method.supports(gb.material("kurt", m=0.3), None) is None


def test_the_virtual_cube_shows_pairs_and_metrics_stop_at_its_ceiling():
    view = gb.view("virtual_cube", edge=3, every=5, ceiling=0.5)
    light, material = random_light(), gb.material("phong", s=3)
    truth = gb.reference(light, material, view, relative_error=0.1)
    method = gb.method("lighting_factorization", **SMALL)

    image = gb.shade(method, light, material, view)
    empty = CellRecord(key="", reference_key="", light="", material="", view="", method="")
    record, *_ = measure(
        empty,
        method,
        None,
        {name: gb.metric(name) for name in ("max_error", "rms")},
        StageCache(),
        light,
        material,
        view,
        truth,
    )

    assert int(view.mask().sum()) == len(view.points()) == len(valid_pairs(3)[::5])
    cut = replace(truth, radiance=truth.radiance.clamp(max=0.5))
    assert record.left_out["rms"][0] == gb.metric("rms")(replace(image, radiance=image.radiance.clamp(max=0.5)), cut)
    assert record.left_out["max_error"][0] <= 0.5


def test_brdf_factors_are_those_of_a_product():
    """A constant BRDF is a product, and is recovered."""
    factors = factor_brdf(gb.material("phong", s=0, ks=0, kd=0.4), 8, 4000, 0.1, 1e-4, "cg", 1e-10)
    theta, phi = torch.linspace(0.1, 1.4, 20), torch.linspace(0, 6, 20)
    wo, wi = spherical(theta, phi), spherical(theta.flip(0), 2 * phi)

    torch.testing.assert_close(factors.f(wo, wi), torch.full((20, 3), 0.4 / np.pi), rtol=1e-4, atol=0)


def test_brdf_factors_are_reciprocal_and_follow_the_lobe():
    material = gb.material("cook_torrance", m=0.4)
    factors = factor_brdf(material, 32, 50_000, 0.3, 1e-4, "cg", 1e-6)
    n = torch.tensor([0.0, 0.0, 1.0])
    wo = spherical(torch.linspace(0.1, 0.9, 30), torch.linspace(0, 6, 30))
    up = Vec3(*(c.expand(30) for c in n))
    wi = reflect(wo, half_vector(up, spherical(torch.full((30,), 0.15), torch.linspace(0, 3, 30))))

    f = factors.f(wo, wi)

    torch.testing.assert_close(f, factors.f(wi, wo), rtol=1e-4, atol=1e-6)
    assert float((f[:, 0] / material.f(wo, wi)[0] - 1).abs().median()) < 0.2


def test_the_loch_has_the_sun_and_its_reflection_raised_by_powers_of_ten():
    low, high = (Loch(powers=p, resolution=32).cubemap().faces for p in (0.0, 3.0))

    changed = (high != low).any(-1)
    directions = torch.stack(texel_directions(32), -1)

    assert float(low.max()) <= 1
    assert 990 < float(high.max()) <= 1000
    assert 0.0005 < float(changed.float().mean()) < 0.02
    assert bool((directions[changed][:, 1] > 0).any())
    assert bool((directions[changed][:, 1] < 0).any())


def test_a_light_half_a_turn_away_gives_another_image():
    """Nothing is fixed to the axes: the light turned about +y shows its back."""
    view, material = gb.view("sphere", resolution=16), gb.material("phong", s=8)
    method = gb.method("lighting_factorization", **SMALL)

    images = [gb.shade(method, Loch(azimuth=a, resolution=16).cubemap(), material, view) for a in (60.0, 300.0)]

    # The sun from the right and from the left: one is the other's mirror image.
    left, right = images[1].radiance, images[0].radiance.flip(1)
    torch.testing.assert_close(left, right, rtol=0.02, atol=0.02)
    assert not torch.allclose(images[0].radiance, left, rtol=0.1, atol=0.1)


def test_pictures_are_the_unfolded_factors_whose_product_is_shown():
    light, material = gb.light("gradient", resolution=8), gb.material("phong", s=10)

    image = gb.shade(gb.method("lighting_factorization", **SMALL), light, material, gb.view("sphere", resolution=1))

    assert list(image.pictures) == ["normal", "reflection"]
    assert {tuple(p.shape) for p in image.pictures.values()} == {(24, 32, 3)}
    # The one pixel has n = r = +z, the middle of the last square of the middle row, between four texels.
    middles = [p[11:13, 27:29].mean((0, 1)) for p in image.pictures.values()]
    # Measured: equal.
    torch.testing.assert_close(image.radiance[0, 0], middles[0] * middles[1], rtol=1e-6, atol=0)
