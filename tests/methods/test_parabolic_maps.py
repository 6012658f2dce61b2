"""Parabolic storage of partial environment maps: energy, the lookup in plain numbers, a lobe a map, planted faults."""

from dataclasses import replace
from math import floor, pi, sqrt

import numpy as np
import pytest
import torch

import glossbench as gb
from glossbench.directions import Vec3, reflect, stack, vec3
from glossbench.envmap.cubemap import CubeMap, texel_directions, texel_solid_angles
from glossbench.envmap.pyramid import finest, lookup, weighted_radiance
from glossbench.errors import InputError
from glossbench.methods.partial_environment_maps import parabolic_maps
from glossbench.methods.partial_environment_maps.map_calibration import calibrate_maps
from glossbench.methods.partial_environment_maps.parabolic_maps import build_parabolic_maps
from glossbench.prefilter.cosine_lobes.calibration import calibrate
from glossbench.prefilter.cosine_lobes.lobe_sum import fit_lobe_sum
from glossbench.prefilter.cosine_lobes.pyramid import FIVE_TAPS, LOBE_FILTERS, build_partial_maps
from glossbench.prefilter.median_cut import _describe_regions, make_whole, median_cut
from glossbench.shading.image import shade

ROOM = 1e9
VIEW = gb.view("sphere", resolution=24)


def random_light(resolution, seed=0):
    return CubeMap(torch.randn(6, resolution, resolution, 3, generator=torch.Generator().manual_seed(seed)).exp())


def even_directions(n):
    i = np.arange(n) + 0.5
    z, phi = 1 - 2 * i / n, pi * (1 + sqrt(5)) * i
    d = np.stack([np.sqrt(1 - z * z) * np.cos(phi), np.sqrt(1 - z * z) * np.sin(phi), z], axis=1)
    return vec3(torch.tensor(d).float()[:, None])


def parabolic(light, n_maps, mip_filter="sqrt_cosine"):
    return build_parabolic_maps(light, median_cut(light, n_maps), mip_filter, ROOM)


def at_level_0(maps, d):
    """Every map in every direction, (P, N, 3)."""
    rows, weights = maps.taps(d, None)
    return sum(maps.texels[row.long()] * weight[..., None] for row, weight in zip(rows, weights, strict=True))


# Energy


def check_energy(maps, power):
    """At every level: the sum of a map's texels times their area on the plane is the power of its region."""
    for level in range(maps.windows.shape[0]):
        for i, (_, _, height, width, first) in enumerate(maps.windows[level].tolist()):
            energy = (
                maps.texels[first : first + height * width].double().sum(0) * (float(maps.pitch[i]) * 2**level) ** 2
            )
            # Measured 4e-7: float32.
            torch.testing.assert_close(energy, power[i].double(), rtol=4e-6, atol=0)


@pytest.mark.parametrize("mip_filter", LOBE_FILTERS)
def test_each_map_holds_the_energy_of_its_region_at_every_level(mip_filter):
    light = random_light(32)

    maps = parabolic(light, 20, mip_filter)

    check_energy(maps, median_cut(light, 20).power)


def check_sum(maps, light, bound):
    """At level 0 all maps together show the light: mean difference over the mean, all over the sphere."""
    d = even_directions(4000)

    together = at_level_0(maps, d).sum(1).double()

    expected = lookup(finest(light), Vec3(*(c[:, 0] for c in d))).double()
    assert float((together - expected).abs().mean() / expected.mean()) < bound


@pytest.mark.parametrize(
    ("name", "bound"),
    # Measured 0.006, 0.005 and 0.106: spots of a few texels, whose edges a second bilinear lookup blurs.
    [("constant", 0.01), ("gradient", 0.01), ("spots", 0.12)],
)
def test_regions_sum_to_the_light(name, bound):
    light = gb.light(name, resolution=64)

    check_sum(parabolic(light, 24), light, bound)


def without_solid_angle(maps):
    """The maps as if radiance were stored: each texel over (1 + d.a)^2 = 4 / (1 + r^2)^2."""
    texels = maps.texels.clone()
    for level in range(maps.windows.shape[0]):
        for i, (row, column, height, width, first) in enumerate(maps.windows[level].tolist()):
            edge = float(maps.pitch[i]) * 2**level
            y, x = (torch.arange(n) + start + 0.5 for n, start in ((height, row), (width, column)))
            r2 = (y[:, None] ** 2 + x[None] ** 2) * edge**2
            texels[first : first + height * width] *= ((1 + r2) ** 2 / 4).reshape(-1, 1)
    return replace(maps, texels=texels)


def test_the_energy_check_notices_a_missing_solid_angle():
    light = random_light(32)

    with pytest.raises(AssertionError):
        check_energy(without_solid_angle(parabolic(light, 20)), median_cut(light, 20).power)


def test_the_sum_check_notices_a_missing_solid_angle():
    light = gb.light("constant", resolution=64)

    with pytest.raises(AssertionError):
        check_sum(without_solid_angle(parabolic(light, 24)), light, 0.02)


# The lookup in plain numbers


def slow_lookup(maps, d, lods):
    """Radiance (3,) of each map in one direction: section 5 of the paper in scalars, in float64."""
    out = np.zeros((len(maps), 3))
    texels = maps.texels.double().numpy()
    for i, lod in enumerate(lods):
        t, b, a = (np.array([float(c[0, i]) for c in axis]) for axis in (maps.t, maps.b, maps.a))
        x, y = np.dot(d, t) / (1 + np.dot(d, a)), np.dot(d, b) / (1 + np.dot(d, a))
        lod = min(max(lod, 0), maps.windows.shape[0] - 1)
        for level, share in ((floor(lod), 1 - lod + floor(lod)), (floor(lod) + 1, lod - floor(lod))):
            if share == 0:
                continue
            row, column, height, width, first = maps.windows[level, i].tolist()
            u, v = (c / (float(maps.pitch[i]) * 2**level) - 0.5 for c in (x, y))
            for k in (floor(v), floor(v) + 1):
                for m in (floor(u), floor(u) + 1):
                    weight = (1 - abs(v - k)) * (1 - abs(u - m))
                    if row <= k < row + height and column <= m < column + width:
                        out[i] += share * weight * texels[first + (k - row) * width + m - column]
        # An area of the plane spans 4 / (1 + r^2)^2 times its solid angle.
        out[i] *= (1 + x * x + y * y) ** 2 / 4
    return out


def check_lookup(maps, lods, slow):
    d = even_directions(60)

    rows, weights = maps.taps(d, lods)

    found = sum(maps.texels[row.long()] * weight[..., None] for row, weight in zip(rows, weights, strict=True))
    for k in range(60):
        expected = slow(maps, np.array([float(c[k, 0]) for c in d]), lods[0].tolist())
        # Measured 2e-5 of the brightest: float32 coordinates of a map of 40 texels.
        np.testing.assert_allclose(found[k].numpy(), expected, rtol=0, atol=1e-4 * max(1.0, expected.max()))


LODS = torch.linspace(-1, 9, 12)[None]


def test_the_lookup_is_its_transcription_in_plain_numbers():
    check_lookup(parabolic(random_light(32), 12), LODS, slow_lookup)


def test_the_lookup_check_notices_axes_exchanged():
    maps = parabolic(random_light(32), 12)

    with pytest.raises(AssertionError):
        check_lookup(replace(maps, t=maps.b, b=maps.t), LODS, lambda _, d, lods: slow_lookup(maps, d, lods))


def test_opposite_to_a_map_all_is_black():
    maps = parabolic(random_light(16), 6)
    back = Vec3(*(-c.T for c in maps.a))

    rows, weights = maps.taps(back, torch.full((1, 6), 20.0))

    value = sum(maps.texels[row.long()] * weight[..., None] for row, weight in zip(rows, weights, strict=True))
    assert torch.isfinite(value).all()
    assert (value.diagonal(dim1=0, dim2=1) == 0).all()


# The level of a lobe, one a map


def lit_texels(resolution=64):
    """One texel of unit flux a face, from its middle to its corner, the only lit one of a region of 8 x 8 texels."""
    faces = torch.zeros(6, resolution, resolution, 3)
    index = torch.arange(6, 12, dtype=torch.int32)[:, None, None].repeat(1, resolution, resolution)
    solid_angle, directions, own = texel_solid_angles(resolution), stack(texel_directions(resolution)), []
    for face, at in enumerate((32, 37, 42, 48, 54, 60)):
        faces[face, at, at] = 1 / float(solid_angle[at, at])
        index[face, at - 4 : at + 4, at - 4 : at + 4] = face
        own.append(directions[face, at, at])
    light = CubeMap(faces)
    return build_parabolic_maps(light, _describe_regions(light, index, 12), "sqrt_cosine", ROOM), torch.stack(own)


@pytest.fixture(scope="module")
def lit():
    return lit_texels()


def check_volumes(maps, own, s, levels):
    """Of each map: the integral of the radiance over that at the lit texel is 2 pi / (s + 1)."""

    def shown(d):
        rows, weights = maps.taps(d, torch.tensor(levels).float()[None])
        values = [maps.texels[row.long(), 0] * weight for row, weight in zip(rows, weights, strict=True)]
        return torch.stack(values).sum(0).double()[:, :6]

    found = shown(even_directions(20_000)).mean(0) * 4 * pi / shown(vec3(own[:, None])).diagonal()

    # Measured 0.3 % at s = 1 and 3, 0.7 % at 10, 2 % at 30, 5 % at 100, where resampling has widened the lit texel.
    np.testing.assert_allclose(found.numpy(), 2 * pi / (s + 1), rtol=0.08)


@pytest.mark.parametrize("s", [1, 3, 10, 30, 100])
def test_a_lit_texel_has_become_the_cosine_lobe_in_each_map(lit, s):
    maps, own = lit

    check_volumes(maps, own, s, calibrate_maps(maps.pitch, "sqrt_cosine").level(s))


def test_the_volume_check_notices_one_level_for_all_maps(lit):
    maps, own = lit
    levels = calibrate_maps(maps.pitch, "sqrt_cosine").level(10)
    assert float(maps.pitch[0] / maps.pitch[5]) > 1.8

    with pytest.raises(AssertionError):
        check_volumes(maps, own, 10, np.full_like(levels, levels[0]))


@pytest.mark.parametrize("mip_filter", FIVE_TAPS)
@pytest.mark.parametrize("volume", ["radial_plot", "solid_angle"])
def test_levels_rise_from_a_mirror_to_diffuse_in_each_map(mip_filter, volume):
    calibration = calibrate_maps(torch.tensor([1 / 64, 1 / 128]), mip_filter, volume)

    levels = np.array([calibration.level(s) for s in (1e5, 1000, 300, 100, 30, 10, 3, 1)])

    assert (np.diff(levels, axis=0) >= 0).all()
    assert (levels[0] == 0).all()
    # Half the pitch, one level: measured 0.85 ("none", s = 10) to 0.99.
    assert levels[4:, 1] - levels[4:, 0] == pytest.approx([1] * 4, abs=0.2)


# The method


def convolved(light, s, d):
    """Mean of the light under cos^s about directions (P,), summed over all texels: (P, 3)."""
    texels = stack(texel_directions(light.resolution)).reshape(-1, 3).double()
    flux = light.faces.double() * texel_solid_angles(light.resolution)[None, :, :, None]
    cosine = (stack(d).double() @ texels.T).clamp(min=0)
    return (s + 1) / (2 * pi) * cosine**s @ flux.reshape(-1, 3)


@pytest.mark.parametrize(
    ("s", "bound"),
    # Measured 0.066, 0.065 and 0.070; cubes 0.120, 0.179 and 0.223.
    [(1, 0.08), (5, 0.08), (50, 0.09)],
)
def test_parabolic_maps_are_nearer_to_the_convolved_light_than_cubes(s, bound):
    light, n = gb.light("spots", seed=7, resolution=64), 24
    d = even_directions(500)
    maps, cubes = (
        parabolic(light, n),
        build_partial_maps(light.faces, make_whole(light).index, 1, "sqrt_cosine", "cube", ROOM),
    )
    level = calibrate(64, "sqrt_cosine").level(s)
    levels = torch.tensor(calibrate_maps(maps.pitch, "sqrt_cosine").level(s)).float()[None]

    by_maps = weighted_radiance(maps, d, levels, (torch.ones(500, n),))
    by_cubes = weighted_radiance(cubes, d, torch.full((1, 1), level), (torch.ones(500, 1),))

    exact = convolved(light, s, Vec3(*(c[:, 0] for c in d)))
    error, of_cubes = (float((found - exact).abs().mean() / exact.mean()) for found in (by_maps, by_cubes))
    assert error < min(bound, 0.7 * of_cubes)
    assert float(by_maps.mean() / exact.mean()) == pytest.approx(1, abs=0.02)


def image_of(light, material, **options):
    return shade(gb.method("partial_environment_maps", regions=24, **options), light, material, VIEW, time_it=False)


def test_eq_5_with_nothing_hidden_is_the_same_with_and_without_shadow_maps():
    light, material = random_light(16), gb.material("phong", s=12, kd=[0.2, 0.3, 0.1], ks=0.6)

    images = [image_of(light, material, storage="parabolic", visibility=v) for v in ("none", "shadow_maps")]

    assert torch.equal(images[0].radiance, images[1].radiance)
    assert [image.costs.n_samples for image in images] == [48, 48]


def test_the_shade_of_a_point_is_the_sum_of_each_map_at_its_own_level():
    light, material = random_light(16), gb.material("phong", s=9)
    maps = parabolic(light, 24)
    levels = calibrate_maps(maps.pitch, "sqrt_cosine").level(10).tolist()

    image = image_of(light, material, storage="parabolic")

    points = VIEW.points()
    d = stack(reflect(points.wo, points.n)).double().numpy()
    found = image.radiance[image.mask]
    for k in range(0, len(points), 29):
        # Within 1e-3: float32 coordinates against float64.
        np.testing.assert_allclose(found[k].numpy(), slow_lookup(maps, d[k], levels).sum(0), rtol=1e-3)


def test_a_constant_light_is_constant_except_for_what_large_regions_lose():
    light, material = gb.light("constant", resolution=32), gb.material("phong", s=10)

    image = image_of(light, material, storage="parabolic", energy="albedo")

    radiance = image.radiance[image.mask]
    exact = material.reflectance().lobes[0].albedo(VIEW.points().wo_local())
    # Measured 0.027.
    assert float(((radiance - exact) ** 2).mean().sqrt() / exact.mean()) < 0.04


# Memory


def test_the_bytes_are_stated_before_the_maps_are_made(monkeypatch):
    light = random_light(64)
    partition = median_cut(light, 64)
    monkeypatch.setattr(parabolic_maps, "_build_level_0", lambda *_: pytest.fail("a map was made"))

    with pytest.raises(InputError, match=r"64 parabolic partial maps of 6 x 64\^2 texels need 0.00 GB, more than the"):
        build_parabolic_maps(light, partition, "box", 1e5)


def test_the_table_is_full_and_the_bytes_are_those_of_the_image():
    light, material = random_light(32), gb.material("phong", s=9)
    maps = parabolic(light, 24)

    image = image_of(light, material, storage="parabolic")

    spans = maps.windows.flatten(0, 1).long()
    counts = spans[:, 2] * spans[:, 3]
    assert maps.texels.shape[0] == 1 + int(counts.sum())
    assert (spans[:, 4] == 1 + counts.cumsum(0) - counts).all()
    tables = maps.texels.nbytes + maps.windows.nbytes + maps.pitch.nbytes + 9 * 24 * 4
    partition = median_cut(light, 24)
    described = (partition.index, *partition.direction, partition.power, partition.solid_angle)
    others = sum(t.nbytes for t in described) + fit_lobe_sum(material.reflectance().lobes[0], 2).albedo.nbytes
    assert image.costs.state_bytes == tables + others


def test_a_region_of_the_whole_sphere_is_refused():
    light = random_light(16)

    with pytest.raises(
        InputError, match=r"up to 2 on its plane \(127 degrees\) from its direction; a region of this light"
    ):
        build_parabolic_maps(light, make_whole(light), "box", ROOM)
