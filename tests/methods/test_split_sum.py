"""The split sum: presets in the formulas of their programs, the table by quadrature, levels, formats, and its floor."""

from functools import cache
from math import acos, cos, exp, log, log2, pi, sin, sqrt

import numpy as np
import pytest
import torch

from glossbench.brdf.cook_torrance import CookTorrance
from glossbench.brdf.ggx import GGX
from glossbench.brdf.phong import Phong
from glossbench.contract.cases import GivenPoints
from glossbench.directions import Vec3, cross, points_2d, vec3
from glossbench.envmap.cubemap import CubeMap, texel_directions
from glossbench.envmap.lights.synthetic import Constant, Gradient, Spots
from glossbench.envmap.pyramid import lookup
from glossbench.errors import InputError
from glossbench.methods.split_sum import SplitSum
from glossbench.methods.split_sum.chain import build_chain
from glossbench.methods.split_sum.directions import lean
from glossbench.methods.split_sum.final import build_table, fit_terms
from glossbench.methods.split_sum.mappings import MAPPINGS, Layout
from glossbench.methods.split_sum.settings import PRESETS, Settings
from glossbench.methods.split_sum.storage import store
from glossbench.prefilter.pyramids import build_pyramid
from glossbench.scene.points import ShadingPoints
from glossbench.scene.sphere import Sphere
from glossbench.scene.virtual_cube import tangent
from glossbench.shading.image import shade
from glossbench.shading.stage_cache import StageCache
from glossbench.truth.reference import compute_reference

EDGE = 32
CACHE = StageCache()


@cache
def spots():
    light = Spots(seed=7, resolution=EDGE).cubemap()
    return light, build_pyramid(light, "box")


def small(preset):
    """The settings of a preset with so few samples that a test takes no time."""
    return SplitSum(preset=preset, samples=[16]).settings


# One texel of a level in the formulas of each program, in plain numbers. Only the lookup is the library's.


def ggx_samples(alpha, n):
    """cos_l, phi and D of half vectors at n = v: Karis 2013, ImportanceSampleGGX, at Hammersley points."""
    for u, v in points_2d(n).tolist():
        cos_h = sqrt((1 - v) / (1 + (alpha * alpha - 1) * v))
        D = alpha**2 / (pi * ((alpha**2 - 1) * cos_h**2 + 1) ** 2)
        yield 2 * cos_h**2 - 1, 2 * pi * u, D


def filament(alpha, n):
    for c, phi, D in ggx_samples(alpha, n):
        omega_s, omega_p = 1 / (n * D / 4), 4 * pi / (6 * EDGE**2)
        yield c, phi, max(c, 0), log(4 * omega_s / omega_p, 4)  # K = 4


def hdrp(alpha, n):
    for c, phi, D in ggx_samples(alpha, n):
        omega_s, inverse_omega_p = 1 / (n * D / 4), 6 * EDGE**2 / (4 * pi)
        G2 = 2 * c / (c + sqrt(alpha**2 + (1 - alpha**2) * c * c)) if c > 0 else 0.0
        yield c, phi, G2, 0.5 * log2(omega_s * inverse_omega_p) + alpha


def three_r187(alpha, n):
    for u, v in points_2d(n).tolist():
        q = 1 / (1 - v + alpha**2 * v)
        c = (1 - v - alpha**2 * v) * q
        lod = log2(alpha**2 * q) + log2(EDGE) + 0.5 * log2(6 / (n * alpha**2)) + 0.5
        yield c, 2 * pi * u, max(c, 0), lod


def gltf_ibl_sampler(alpha, n):
    for c, phi, D in ggx_samples(alpha, n):
        yield c, phi, max(c, 0), 0.5 * log2(6 * EDGE**2 / (n * D / 4))  # without 4 pi


def unreal(alpha, n):
    """The tail of the lobe is cut off, and the area of a texel is taken twice."""
    for u, v in points_2d(n).tolist():
        cos_h2 = (1 - 0.995 * v) / (1 + (alpha * alpha - 1) * 0.995 * v)
        D = alpha**2 / (pi * ((alpha**2 - 1) * cos_h2 + 1) ** 2)
        c = 2 * cos_h2 - 1
        yield c, 2 * pi * u, max(c, 0), 0.5 * log2(1 / (n * D / 4) / (2 * 4 * pi / (6 * EDGE**2)))


def godot(alpha, n):
    for c, phi, D in ggx_samples(alpha, n):
        texels = 6 * EDGE**2  # of an octahedral map with as many
        yield c, phi, max(c, 0), 0.5 * log2(1 / (n * D / 4) / (4 * pi / (6 * texels)))


def bevy(alpha, n):
    """The area is that of the output, which is half as fine."""
    for c, phi, D in ggx_samples(alpha, n):
        G = c / (c * (1 - alpha / 2) + alpha / 2)
        yield c, phi, max(c * G, 0), 0.5 * log2(1 / (n * D / 4) / (4 * pi / (6 * (EDGE / 2) ** 2)))


def point_samples(alpha, n):
    """karis from the light, three_r185 from the level before."""
    for c, phi, _ in ggx_samples(alpha, n):
        yield c, phi, max(c, 0), 0.0


def eevee(alpha, n):
    cone = 2 * acos(1 + log(0.01 + (0.14 - 0.01) * alpha) * alpha**2 / 2)
    for u, v in points_2d(n).tolist():
        c = 1 - v * (1 - cos(cone))
        yield c, 2 * pi * u, exp(2 * (sqrt((1 + c) / 2) - 1) / alpha**2), 0.0


def roughness_of_eevee(t):
    """t = 0.6 x + 0.4 sqrt(x), by bisection."""
    low, high = 0.0, 1.0
    for _ in range(60):
        x = (low + high) / 2
        low, high = (x, high) if 0.6 * x + 0.4 * sqrt(x) < t else (low, x)
    return 0.7 * low


def eevee_step(t, before):
    return (roughness_of_eevee(t) ** 3 - roughness_of_eevee(before) ** 3) ** (2 / 3)


# Of each preset: its formulas, a level, and the width with which they filter it.
PROGRAMS = {
    "karis": (point_samples, 2, (2 / 5) ** 2),
    "filament": (filament, 1, (1 - sqrt(1 - 1 / 4)) ** 2),
    "hdrp": (hdrp, 1, (1.7 / 1.4 - sqrt(2.89 / 1.96 - (2.8 / 1.96) / 6)) ** 2),
    "unreal": (unreal, 4, 2 ** (2 * (4 - 8 + 3) / 1.2)),
    "three_r187": (three_r187, 2, (1 - sqrt(1 - 2 / 5)) ** 2),
    "three_r185": (point_samples, 6, (sqrt(0.6**2 - 0.5**2) * 1.25 * 0.6) ** 2),
    "godot": (godot, 4, (4 / 7) ** 4),
    "babylon": (filament, 2, 2 ** (2 / 0.8) / EDGE),
    "gltf_ibl_sampler": (gltf_ibl_sampler, 1, (1 / 7) ** 2),
    "playcanvas": (gltf_ibl_sampler, 2, (1 - log2(128) / 11) ** 2),
    "bevy": (bevy, 1, (1 / 8) ** 2),
    "eevee": (eevee, 3, eevee_step(3 / 4, 2 / 4)),
}
FROM_THE_LEVEL_BEFORE = ("three_r185", "eevee")


def by_hand(program, alpha, n, r, source):
    """The filtered light in the direction r, an array of three numbers."""
    # The frame of the texel: the tangent nearest to +x.
    t = np.array([1.0, 0, 0]) - r[0] * r
    t /= np.linalg.norm(t)
    b = np.cross(r, t)
    total, weights = np.zeros(3), 0.0
    for c, phi, weight, lod in program(alpha, n):
        s = sqrt(max(0, 1 - c * c))
        d = s * cos(phi) * t + s * sin(phi) * b + c * r
        L = lookup(source, vec3(torch.tensor(d[None]).float()), torch.tensor([lod], dtype=torch.float32))
        total += weight * L[0].double().numpy()
        weights += weight
    return total / weights


def texel(chain, level):
    """One texel of a level, and its direction."""
    faces = chain.level(level)
    at = (2, faces.shape[1] // 2, 0)
    return faces[at].double().numpy(), np.array([float(c[at]) for c in texel_directions(faces.shape[1])])


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_texel_of_a_preset_is_that_of_its_programs_formulas(name):
    program, level, width = PROGRAMS[name]
    chain = build_chain(*spots(), SplitSum(preset=name, samples=[16], storage="float32").settings)
    before = CubeMap(chain.level(level - 1).clone()) if name in FROM_THE_LEVEL_BEFORE else spots()[0]
    source = build_pyramid(before, "box")

    found, r = texel(chain, level)

    assert np.allclose(found, by_hand(program, width, 16, r, source), rtol=1e-5)  # measured 1.2e-6
    assert not np.allclose(found, by_hand(program, 1.02 * width, 16, r, source), rtol=1e-3)


def test_a_texel_of_a_preset_notices_a_bias_of_a_tenth_of_a_level():
    settings = SplitSum(preset="filament", samples=[16], storage="float32", lod_bias=1.1).settings

    found, r = texel(build_chain(*spots(), settings), 1)

    assert not np.allclose(found, by_hand(filament, (1 - sqrt(0.75)) ** 2, 16, r, spots()[1]), rtol=1e-2)  # 0.027


def test_the_last_levels_of_three_r187_are_a_sum_over_a_mip_of_16():
    """c_l (1 + u^2 + v^2)^(-3/2) / (1 + alpha^2 + (alpha^2 - 1) c_l)^2, its weights of texels up to a constant."""
    light, source = spots()
    settings = SplitSum(preset="three_r187", storage="float32").settings
    found, r = texel(build_chain(light, source, settings), 3)

    alpha = (1 - sqrt(1 - 3 / 5)) ** 2
    faces, d = source.level(1).double().numpy(), np.stack([c.double().numpy() for c in texel_directions(16)], -1)
    c = np.clip(d @ r, 0, None)
    s = (np.arange(16) * 2 + 1) / 16 - 1
    omega = (1 + s[:, None] ** 2 + s[None, :] ** 2) ** -1.5
    k = c * omega / (1 + alpha**2 + (alpha**2 - 1) * c) ** 2
    # The solid angle is exact here, and that at the texel's centre there: measured 8e-4.
    assert np.allclose(found, (k[..., None] * faces).sum((0, 1, 2)) / k.sum(), rtol=2e-3)


def test_an_octahedral_map_reads_1_29_levels_coarser_and_output_area_one_level_finer_at_level_1():
    as_is, octahedral, output = (
        build_chain(*spots(), SplitSum(preset="filament", samples=[16], levels=2, **options).settings).level(1)
        for options in ({"lod_bias": 1.0}, {"lod_bias": 1 - log(6, 4), "texel_area": "octahedral"},
                        {"lod_bias": 2.0, "texel_area": "output"})
    )  # fmt: skip

    assert log(6, 4) == pytest.approx(1.29, abs=5e-3)
    assert torch.allclose(octahedral, as_is, rtol=1e-5)
    assert torch.allclose(output, as_is, rtol=1e-5)


# Constant light, mappings, formats


@pytest.mark.parametrize("preset", [*PRESETS, None])
def test_constant_light_gives_constant_levels(preset):
    light = Constant(radiance=(1.0, 2.0, 3.0), resolution=16).cubemap()
    settings = small(preset) if preset else SplitSum(mapping="linear").settings

    chain = build_chain(light, build_pyramid(light, "box"), settings)

    assert len(chain.sizes) == settings.levels
    for level in range(settings.levels):
        faces = chain.level(level)
        assert torch.allclose(faces, torch.tensor([1.0, 2.0, 3.0]).expand_as(faces), rtol=1e-5)


@pytest.mark.parametrize("name", MAPPINGS)
def test_the_level_of_the_width_of_a_level_is_that_level(name):
    layout = Layout(levels=9 if name == "babylon" else 6, edge=256)
    mapping = MAPPINGS[name]
    inside = [i for i in range(layout.levels) if 1e-4 < mapping.alpha(i, layout) < 1]

    back = [mapping.level(mapping.alpha(i, layout), layout) for i in inside]

    assert len(inside) >= 3
    exact = back == pytest.approx(inside, abs=1e-9)
    assert exact == (name not in ("three_r185", "playcanvas")), back


def test_mappings_in_the_numbers_of_their_programs():
    eleven, eight, nine, six = (Layout(n, 256) for n in (11, 8, 9, 6))

    read = {r: MAPPINGS["three_r185"].level(r * r, eleven) for r in (0.0762, 0.1078, 0.1524, 0.21, 0.305, 0.4, 0.8, 1)}
    assert list(read.values()) == pytest.approx([1, 2, 3, 4, 5, 6, 9, 10], abs=0.01)
    assert MAPPINGS["three_r185"].alpha(5, eleven) == pytest.approx(0.5**2)
    # Roughness 1 lies at the cube of 4 x 4, whatever the number of mips.
    assert [MAPPINGS["unreal"].level(1.0, Layout(n, 2 ** (n - 1))) for n in (8, 9)] == [5, 6]
    assert MAPPINGS["unreal"].alpha(3, eight) == pytest.approx(2 ** (2 * (3 - 8 + 3) / 1.2))
    assert MAPPINGS["babylon"].alpha(4, nine) == pytest.approx(2**5 / 256)
    assert MAPPINGS["playcanvas"].alpha(2, six) == pytest.approx((1 - log2(128) / 11) ** 2)
    assert MAPPINGS["godot"].alpha(2, eight) == pytest.approx((2 / 7) ** 4)
    x = (0.5 / 0.7,)
    assert MAPPINGS["eevee"].level(0.25, Layout(5, 256)) == pytest.approx(4 * (0.6 * x[0] + 0.4 * sqrt(x[0])))


def test_half_is_that_of_numpy():
    radiance = torch.cat([torch.logspace(-7, 6, 3000), torch.zeros(3)]).view(-1, 3)

    expected = np.minimum(radiance.numpy(), 65504).astype(np.float16).astype(np.float32)
    assert np.array_equal(store(radiance, "half").numpy(), expected)
    assert torch.equal(store(radiance, "float32"), radiance)


@pytest.mark.parametrize(("channel", "mantissa"), [(0, 6), (1, 6), (2, 5)])
def test_r11g11b10_is_the_nearest_number_of_the_format(channel, mantissa):
    """All numbers of 5 bits of exponent (bias 15) and 6 or 5 of mantissa, as in the extension of OpenGL."""
    n = 2**mantissa
    numbers = np.array([m / n * 2.0**-14 for m in range(n)]
                       + [(1 + m / n) * 2.0 ** (e - 15) for e in range(1, 31) for m in range(n)])  # fmt: skip
    values = np.concatenate([np.geomspace(1e-8, 1e6, 2000), [0.0]])

    found = store(torch.tensor(values)[:, None].expand(-1, 3), "r11g11b10")[:, channel].numpy()

    nearest = np.abs(values[:, None] - numbers[None]).min(1)
    assert np.isin(found, numbers).all()
    assert np.allclose(np.abs(values - found), nearest, rtol=1e-12, atol=0)
    assert numbers.max() == (65024 if mantissa == 6 else 64512)


# The table, the directions


def albedo_by_quadrature(alpha, cos_o, fresnel):
    """Integral of D G2 F / (4 cos_o), midpoint rule over half vectors; Walter 2007 eq. 33, Heitz 2014 eq. 99."""
    u, phi = (np.arange(2000) + 0.5) / 2000, (np.arange(200) + 0.5) / 200 * 2 * pi
    cos_h = np.sqrt((1 - u) / (1 + (alpha**2 - 1) * u))[:, None]  # equal shares of D cos_h
    sin_h = np.sqrt(1 - cos_h**2)
    sin_o = sqrt(1 - cos_o**2)
    c = sin_h * np.cos(phi) * sin_o + cos_h * cos_o
    cos_i = 2 * c * cos_h - cos_o
    visible = (cos_i > 0) & (c > 0)
    cos_i = np.where(visible, cos_i, 1)

    def big_lambda(z):
        return (np.sqrt(1 + alpha**2 * (1 - z * z) / z**2) - 1) / 2

    G2 = 1 / (1 + big_lambda(cos_o) + big_lambda(cos_i))
    F = (1 - np.clip(c, 0, 1)) ** 5 if fresnel else 1.0
    return float(np.where(visible, G2 * c * F / (cos_h * cos_o), 0).mean())


@pytest.mark.parametrize("alpha", [0.1, 0.5])
@pytest.mark.parametrize("cos_o", [0.2, 0.5, 0.95])
def test_the_table_is_the_integral_over_half_vectors(alpha, cos_o):
    table = build_table(GGX(alpha=(alpha, alpha), f0=(0.3, 0.6, 0.9), ks=(0.5, 0.5, 0.5)).reflectance().lobes[0])

    x, y = table.at(vec3(torch.tensor([[sqrt(1 - cos_o**2), 0.0, cos_o]])))[0].tolist()

    # Measured 8e-4 for the narrow lobe at 0.2, else 6e-5.
    assert x == pytest.approx(albedo_by_quadrature(alpha, cos_o, True), abs=2e-3)
    assert y == pytest.approx(albedo_by_quadrature(alpha, cos_o, False), abs=2e-3)
    assert y != pytest.approx(albedo_by_quadrature(alpha**0.5, cos_o, False), abs=2e-3)  # twin: roughness for alpha


def test_the_fit_loses_light_of_metals_and_is_near_the_table_for_f0_of_4_percent():
    cos_o = torch.linspace(0.1, 1, 10)
    views = Vec3(torch.sqrt(1 - cos_o * cos_o), torch.zeros_like(cos_o), cos_o)
    for alpha in (0.05, 0.2, 0.6):
        x, y = build_table(GGX(alpha=(alpha, alpha)).reflectance().lobes[0]).at(views).unbind(1)
        fit_x, fit_y = fit_terms(sqrt(alpha), cos_o).unbind(1)

        assert torch.allclose(fit_y, torch.tensor(1 - 0.55 * sqrt(alpha)))  # -1.04 a + 1.04 a cancel
        assert (fit_y - y).abs().max() > 0.1  # measured 0.12, 0.19, 0.27
        assert (0.04 * (fit_y - y) + 0.96 * (fit_x - x)).abs().max() < 0.07  # measured 0.06, 0.03, 0.05


def test_directions_lean_from_the_mirror_direction_to_the_normal():
    n, r = vec3(torch.tensor([[0.0, 0.0, 1.0]])), vec3(torch.tensor([[0.8, 0.0, 0.6]]))
    cos_o = torch.tensor([0.6])

    def share(direction, alpha):
        d = lean(r, n, cos_o, alpha, direction)
        return float(d.x / (0.8 * d.z + 0.4 * d.x)), float(d.x**2 + d.z**2)

    a = 1 - 0.25
    wanted = {
        "mirror": 1.0,
        "filament": 1 - 0.25**2,
        "frostbite": a * (sqrt(a) + 0.25),
        "hdrp": (sqrt(a) + 0.25) * min(a * a + a * 0.36, 1),
    }
    for direction, f in wanted.items():
        # d ~ n + f (r - n) = (0.8 f, 0, 1 - 0.4 f), so that d.x / (0.8 d.z + 0.4 d.x) = f.
        found, length2 = share(direction, 0.25)
        assert found == pytest.approx(f, rel=1e-5)
        assert length2 == pytest.approx(1, rel=1e-5)
    assert share("frostbite", 1.0)[0] == pytest.approx(0, abs=1e-6)


# The method


def test_options_beside_a_preset_replace_its_own():
    assert SplitSum().settings == Settings()
    assert SplitSum(preset="filament").settings == PRESETS["filament"]
    assert SplitSum(preset="filament", weight="g2").settings.weight == "g2"
    assert SplitSum(preset="filament", weight="g2").settings.samples == (1024, 2048, 4096, 8192)
    with pytest.raises(InputError, match="preset"):
        SplitSum(preset="filamnt")


def test_chains_that_differ_in_shading_alone_are_computed_once():
    view, light, cache = Sphere(resolution=8), spots()[0], StageCache()
    told = []
    cache = StageCache(tell=told.append)
    for options in ({}, {"direction": "mirror"}, {"final": "fit"}, {"multiscatter": True}):
        shade(SplitSum(preset="filament", samples=[16], **options), light, GGX(), view, cache=cache, time_it=False)
    shade(SplitSum(preset="filament", samples=[16]), light, GGX(alpha=(0.4, 0.4)), view, cache=cache, time_it=False)

    assert told.count("split_sum: chain") == 1
    assert told.count("split_sum: tables") == 2


def test_materials_without_half_vectors_are_refused():
    assert "no alpha" in SplitSum().supports(Phong(), None)
    assert SplitSum().supports(CookTorrance(), None) is None


@pytest.mark.parametrize("alpha", [0.1, 0.4])
def test_the_floor_is_the_truth_where_the_view_is_along_the_normal(alpha):
    """There the lobe is exact, and with F = 1 the product of means is the mean of the product."""
    n = Vec3(*(c.flatten() for c in texel_directions(4)))
    t = tangent(n)
    light, material, view = (
        Gradient(resolution=EDGE).cubemap(),
        GGX(alpha=(alpha, alpha)),
        GivenPoints(ShadingPoints(t, cross(n, t), n, n)),
    )
    truth = compute_reference(light, material, view, relative_error=1e-3).radiance

    def error(**options):
        image = shade(SplitSum(**options), light, material, view, cache=CACHE, time_it=False).radiance
        return float((image - truth).square().mean().sqrt() / truth.mean())

    assert error() < 3e-3
    assert error(weight="cos") > 2 * error()


def test_multiscatter_returns_all_light_of_a_white_furnace():
    light, view = Constant(radiance=(1.0, 1.0, 1.0), resolution=16).cubemap(), Sphere(resolution=16)
    image = shade(SplitSum(multiscatter=True), light, GGX(alpha=(0.6, 0.6)), view, cache=CACHE, time_it=False)

    assert torch.allclose(image.radiance[view.mask()], torch.ones(1), rtol=1e-5)
