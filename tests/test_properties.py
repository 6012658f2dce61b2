"""Properties that hold for any light, resolution, direction and material: drawn at random, the same draws each time."""

from math import pi
from typing import Any, get_args

import pytest
import torch
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st

from glossbench.brdf.material import MATERIALS, Material
from glossbench.catalog.entries import list_entries
from glossbench.contract.cases import turn_light
from glossbench.directions import Vec3, dot, half_vector, normalize, points_2d, spherical, stack, vec3
from glossbench.envmap.cubemap import CubeMap, face_coordinates, face_directions, texel_directions, texel_solid_angles
from glossbench.envmap.importance import luminance_distribution
from glossbench.envmap.projections.conversion import Written, from_cubemap, to_cubemap
from glossbench.envmap.projections.layouts import LAYOUTS
from glossbench.envmap.pyramid import lookup
from glossbench.errors import InputError
from glossbench.options import make_schema
from glossbench.prefilter.pyramids import MipFilter, build_paraboloid, build_pyramid, repeat_edge

PROJECTIONS = get_args(Written)
FILTERS = get_args(MipFilter)


def drawn(n: int) -> settings:
    """n draws, the same ones in every run; what fails is shown as it was drawn, for to shrink it takes minutes."""
    return settings(
        max_examples=n, deadline=None, derandomize=True, database=None, phases=[Phase.generate],
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much, HealthCheck.data_too_large],
    )  # fmt: skip


def random_light(seed: int, log2_resolution: int, contrast: float) -> CubeMap:
    """Texels exp(contrast x), x standard normal: as rough as a light can be."""
    resolution = 1 << log2_resolution
    texels = torch.randn(6, resolution, resolution, 3, generator=torch.Generator().manual_seed(seed))
    return CubeMap((contrast * texels).exp())


def random_directions(seed: int, n: int = 500) -> Vec3:
    return normalize(vec3(torch.randn(n, 3, generator=torch.Generator().manual_seed(seed))))


SEEDS = st.integers(0, 2**31)
LIGHTS = st.builds(random_light, SEEDS, st.integers(1, 4), st.floats(0, 2))
DIRECTIONS = st.builds(random_directions, SEEDS)


def relative(a: torch.Tensor, b: torch.Tensor) -> float:
    """The largest difference over the largest value."""
    return float((a.double() - b.double()).abs().max() / b.double().abs().max())


# Projections


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_there_and_back_keeps_the_energy_of_any_light(projection):
    @drawn(12)
    @given(LIGHTS)
    def check(light):
        image = from_cubemap(light, projection)
        again = to_cubemap(image, projection, light.resolution)

        assert relative(again.mean(), light.mean()) < ENERGY[projection]

    check()


# Of noise texel by texel, down to cubes of 2 texels, which no rim or pole resolves. Measured: dual_paraboloid 0.077,
# octahedral 0.037, the others 0.019; crosses and strips 0.
ENERGY = dict.fromkeys(PROJECTIONS, 0.04) | {"dual_paraboloid": 0.15, "octahedral": 0.08}
ENERGY |= dict.fromkeys(["vertical_cross", "horizontal_cross", "strip"], 1e-9)


@pytest.mark.parametrize("name", LAYOUTS)
def test_any_direction_goes_to_its_pixel_and_back(name):
    @drawn(30)
    @given(DIRECTIONS)
    def check(d):
        u, v = LAYOUTS[name].place(d)
        again, density = LAYOUTS[name].direction(u.double(), v.double())

        assert bool(((u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)).all())
        assert bool((density > 0).all())
        assert float((stack(again) - stack(d)).abs().max()) < 2e-6  # measured 3e-7 to 6e-7

    check()


@pytest.mark.parametrize("name", LAYOUTS)
def test_any_pixel_of_any_resolution_goes_to_its_direction_and_back(name):
    layout = LAYOUTS[name]

    @drawn(30)
    @given(st.integers(1, 70), SEEDS)
    def check(size, seed):
        height, width = size * layout.rows, size * layout.columns
        u, v = ((torch.arange(n, dtype=torch.float64) + 0.5) / n for n in (width, height))
        u, v = (c.reshape(-1) for c in torch.broadcast_tensors(u[None, :], v[:, None]))
        d, density = layout.direction(u, v)
        shown = density > 0
        again = layout.place(Vec3(*(c[shown].double() for c in d)))

        # Measured: 6e-14 of a pixel.
        assert all(
            float((a - b[shown]).abs().max() * n) < 1e-9 for a, b, n in zip(again, (u, v), (width, height), strict=True)
        )

    check()


@drawn(50)
@given(DIRECTIONS)
def test_any_direction_goes_to_its_place_on_a_face_and_back(d):
    face, s, t, major = face_coordinates(d)
    again = face_directions(s.double(), t.double())

    found = torch.stack([c.gather(0, face.long()[None])[0] for c in again], dim=1)
    assert float((found - stack(d)).abs().max()) < 1e-6  # measured 2e-7
    assert float(s.abs().max()) <= 1
    assert float(t.abs().max()) <= 1
    assert bool((major >= 3**-0.5 - 1e-6).all())


@drawn(30)
@given(st.integers(1, 9))
def test_texels_of_any_resolution_cover_the_sphere(log2_resolution):
    assert float(6 * texel_solid_angles(1 << log2_resolution).sum()) == pytest.approx(4 * pi, rel=1e-12)


# Pyramids


@pytest.mark.parametrize("mip_filter", FILTERS)
@pytest.mark.parametrize("build", [build_pyramid, build_paraboloid])
def test_filtering_is_linear(build, mip_filter):
    @drawn(15)
    @given(SEEDS, st.integers(1, 4), st.floats(0, 100), st.floats(0, 100))
    def check(seed, log2_resolution, a, b):
        assume(a + b > 1e-3)
        first, second = (random_light(seed + k, log2_resolution, 1.0) for k in range(2))
        both = build(CubeMap(a * first.faces + b * second.faces), mip_filter).texels

        parts = a * build(first, mip_filter).texels + b * build(second, mip_filter).texels
        assert relative(both, parts) < 1e-6  # measured 2e-7

    check()


@pytest.mark.parametrize("mip_filter", FILTERS)
@pytest.mark.parametrize("build", [build_pyramid, build_paraboloid])
def test_filtering_keeps_any_constant(build, mip_filter):
    @drawn(15)
    @given(st.floats(1e-6, 1e6), st.integers(1, 5))
    def check(level, log2_resolution):
        resolution = 1 << log2_resolution
        texels = build(CubeMap(torch.full((6, resolution, resolution, 3), level)), mip_filter).texels

        assert float((texels / level - 1).abs().max()) < 1e-6  # measured 2e-7

    check()


@drawn(30)
@given(LIGHTS)
def test_every_level_of_a_box_pyramid_has_the_mean_of_the_texels(light):
    pyramid = build_pyramid(light, "box")

    means = torch.stack([pyramid.level(k).double().mean((0, 1, 2)) for k in range(len(pyramid.sizes))])
    assert relative(means, light.faces.double().mean((0, 1, 2)).expand_as(means)) < 1e-6  # measured 5e-8


@pytest.mark.parametrize("mip_filter", ["gauss4", "gauss6"])
def test_every_level_of_a_gauss_pyramid_has_nearly_the_mean_of_the_texels(mip_filter):
    @drawn(20)
    @given(st.builds(random_light, SEEDS, st.integers(3, 5), st.floats(0, 1)))
    def check(light):
        pyramid = build_pyramid(light, mip_filter)

        means = torch.stack([pyramid.level(k).double().mean((0, 1, 2)) for k in range(len(pyramid.sizes))])
        # Only at the corners of the cube, where three texels meet, do the weights of a texel not sum to one: 0.0018.
        assert relative(means, light.faces.double().mean((0, 1, 2)).expand_as(means)) < 0.005

    check()


@pytest.mark.parametrize("mip_filter", FILTERS)
def test_a_turned_light_has_a_turned_pyramid(mip_filter):
    @drawn(15)
    @given(LIGHTS, st.integers(0, 2))
    def check(light, axis):
        turned = build_pyramid(turn_light(light, axis), mip_filter)
        straight = build_pyramid(light, mip_filter)

        for level in range(len(straight.sizes) - 1):
            expected = turn_light(CubeMap(straight.level(level).contiguous()), axis).faces
            assert relative(turned.level(level), expected) < 1e-6  # measured 2e-7

    check()


def test_the_turn_notices_a_light_turned_the_other_way():
    """Twin of the above."""
    light = random_light(1, 3, 1.0)

    turned = build_pyramid(turn_light(light, 0), "gauss4")

    back = turn_light(turn_light(turn_light(CubeMap(build_pyramid(light, "gauss4").level(1).contiguous()), 0), 0), 0)
    assert relative(turned.level(1), back.faces) > 0.1


# Lookups


@pytest.mark.parametrize("build", [build_pyramid, build_paraboloid])
def test_a_lookup_is_within_the_texels_and_clamps_its_level(build):
    @drawn(30)
    @given(LIGHTS, DIRECTIONS, st.sampled_from(FILTERS), st.floats(-50, 50))
    def check(light, d, mip_filter, lod):
        table = build(light, mip_filter)
        top = float(len(table.sizes) - 1)
        found = lookup(table, d, torch.full_like(d.x, lod))

        low, high = light.faces.amin((0, 1, 2)), light.faces.amax((0, 1, 2))
        assert bool((found >= low * (1 - 1e-5)).all())
        assert bool((found <= high * (1 + 1e-5)).all())
        clamped = lookup(table, d, torch.full_like(d.x, min(max(lod, 0.0), top)))
        assert torch.equal(found, clamped)

    check()


def jump(light: CubeMap, seed: int, mip_filter: MipFilter, lod: float, edge: int) -> float:
    """The largest change of a lookup across an edge of the cube, over the largest that an interpolant can have."""
    axis, signs = edge // 4, (1 - 2 * (edge & 1), 1 - (edge & 2))
    along = 2 * torch.rand(200, generator=torch.Generator().manual_seed(seed)) - 1
    step = 1e-4
    sides = []
    for shift in (step, -step):
        v: list[Any] = [None] * 3
        v[axis] = along
        v[(axis + 1) % 3] = torch.full_like(along, signs[0] * (1 + shift))
        v[(axis + 2) % 3] = torch.full_like(along, signs[1] * (1 - shift))
        sides.append(lookup(build_pyramid(light, mip_filter), normalize(Vec3(*v)), torch.full_like(along, lod)))
    # A texel is 2 / R wide, so 4 steps are 2 R steps of a texel, along each of two axes.
    spread = float(light.faces.max() - light.faces.min())
    bound = 4 * step * light.resolution * spread + 1e-5 * float(light.faces.max())
    return float((sides[0] - sides[1]).abs().max()) / bound


@drawn(40)
@given(LIGHTS, SEEDS, st.sampled_from(FILTERS), st.floats(0, 5), st.integers(0, 11))
def test_a_lookup_is_continuous_across_any_edge(light, seed, mip_filter, lod, edge):
    assert jump(light, seed, mip_filter, lod, edge) <= 1  # measured 0.24


@pytest.mark.parametrize("edge", range(12))
def test_the_seam_would_show_without_the_neighbours_texels(monkeypatch, edge):
    """Twin of the above: borders that repeat the face's own texels."""
    monkeypatch.setattr("glossbench.prefilter.pyramids.add_border", repeat_edge)

    assert jump(random_light(1, 3, 1.0), 2, "gauss4", 0.5, edge) > 10


# Samplers


@drawn(30)
@given(st.builds(random_light, SEEDS, st.integers(1, 4), st.floats(0, 6)), SEEDS)
def test_the_density_of_any_light_integrates_to_one_and_its_samples_have_it(light, seed):
    distribution = luminance_distribution(light)
    r = light.resolution
    fine = max(4, 64 // r)
    grid = texel_directions(r, fine)
    pdf = distribution.pdf(Vec3(*(c.reshape(-1) for c in grid))).double()
    solid_angle = texel_solid_angles(r * fine).reshape(-1).repeat(6)
    d, of_sample = distribution.sample(points_2d(500, "random", seed % 1000))

    assert float((pdf * solid_angle).sum()) == pytest.approx(1, abs=3e-4)  # measured 1e-4
    assert bool((torch.isfinite(of_sample) & (of_sample > 0)).all())
    assert float((stack(d).norm(dim=1) - 1).abs().max()) < 1e-6
    assert float((distribution.pdf(d) / of_sample - 1).abs().median()) < 1e-5


def number(schema: dict[str, Any], smooth: bool) -> st.SearchStrategy[Any]:
    """A number within a schema's bounds; where `smooth`, no lobe so narrow or sharp that a grid would miss it."""
    low = schema.get("minimum", schema.get("exclusiveMinimum"))
    high = schema.get("maximum", schema.get("exclusiveMaximum"))
    if low is None or high is None:
        return st.sampled_from([-1.5, -1.0, -0.5, 0.5, 1.0, 1.5])
    if smooth:
        low, high = (2.0, 20.0) if high > 100 else (max(low, 0.3), high)
    elif "exclusiveMinimum" in schema:
        low = max(low, 1e-3)
    return st.floats(low, high)


def option(schema: dict[str, Any], smooth: bool) -> st.SearchStrategy[Any] | None:
    """Values of an option; None if its schema is not a number, vector, choice or Boolean."""
    if "enum" in schema:
        return st.sampled_from(schema["enum"])
    if schema.get("type") == "boolean":
        return st.booleans()
    if schema.get("type") == "number":
        return number(schema, smooth)
    parts = schema.get("prefixItems", [])
    if parts and all(part.get("type") == "number" for part in parts):
        return st.tuples(*(number(part, smooth) for part in parts))
    return None


@st.composite
def materials(draw: Any, name: str, smooth: bool) -> Material:
    """Any material of a name; a sum has two summands."""
    cls = MATERIALS.get(name)
    if name == "sum":
        parts = [draw(materials(part, smooth)) for part in ("kurt", "ggx")]
        return cls.create({"of": [{part.name: part.as_dict()} for part in parts]})
    options = {}
    for key, schema in make_schema(cls)["properties"].items():
        values = option(schema, smooth)
        if values is not None and (smooth or draw(st.booleans())):
            options[key] = draw(values)
    try:
        return cls.create(options)
    except InputError:
        assume(False)
        raise


def drawable() -> list[str]:
    """Materials that need no file: densities of measured ones are too narrow for this grid, and have their own test."""
    names = []
    for name in sorted(set(MATERIALS.names()) - {entry.name for entry in list_entries("brdf")}):
        required = make_schema(MATERIALS.get(name)).get("required", [])
        if name == "sum" or not required:
            try:
                names += [name] if name == "sum" or MATERIALS.create(name, {}) else []
            except InputError:
                continue
    return names


@pytest.mark.parametrize("name", drawable())
def test_samples_of_any_material_are_unit_with_finite_weights(name):
    @drawn(25)
    @given(materials(name, smooth=False), st.floats(1e-3, 1), st.floats(0, 2 * pi), SEEDS)
    def check(material, cos_o, azimuth, seed):
        theta = torch.acos(torch.tensor([[cos_o]]))
        wo = spherical(theta, torch.full_like(theta, azimuth))
        u = points_2d(200, "random", seed % 1000)
        for lobe in material.reflectance().lobes:
            wi, pdf, weight = lobe.sample(wo, lobe.sample_points(u))

            assert bool((torch.isfinite(pdf) & (pdf > 0)).all())
            assert float((stack(wi).norm(dim=-1) - 1).abs().max()) < 2e-6  # measured 6e-7
            for w in weight:
                assert bool((torch.isfinite(w) & (w >= 0)).all())
                assert bool((w.expand_as(wi.z)[wi.z <= 0] == 0).all())

    check()


N_SAMPLES = 20_000


def hemisphere() -> tuple[Vec3, torch.Tensor]:
    """Midpoints of 256 x 512 cells, cos_i = x^2 with x and phi evenly spaced, and their solid angles."""
    x, phi = (torch.arange(256) + 0.5) / 256, (torch.arange(512) + 0.5) / 512 * 2 * pi
    x, phi = (c.reshape(1, -1) for c in torch.broadcast_tensors(x[:, None], phi[None]))
    return spherical(torch.acos(x * x), phi), 2 * x.double() * (2 * pi / (256 * 512))


@pytest.mark.parametrize("name", drawable())
def test_the_density_of_any_material_integrates_to_the_share_of_samples_above(name):
    grid, solid_angle = hemisphere()

    @drawn(12)
    @given(materials(name, smooth=True), st.floats(0.4, 1), st.floats(0, 2 * pi), SEEDS)
    def check(material, cos_o, azimuth, seed):
        theta = torch.acos(torch.tensor([[cos_o]]))
        wo = spherical(theta, torch.full_like(theta, azimuth))
        u = points_2d(N_SAMPLES, "random", seed % 1000)
        for lobe in material.reflectance().lobes:
            above = float((lobe.sample(wo, lobe.sample_points(u)).wi.z > 0).double().mean())
            integral = float((lobe.pdf(wo, grid).double() * solid_angle).sum())

            # Five standard errors: one false alarm in 1.7 million draws; the midpoint rule adds up to 2.1e-3, measured.
            assert abs(integral - above) < 5 * (max(above * (1 - above), 1e-4) / N_SAMPLES) ** 0.5 + 4e-3

    check()


def test_the_share_notices_a_density_without_its_factor():
    """Twin of the above: a density of half vectors, not turned into one of light directions."""
    material = MATERIALS.create("ggx", {"alpha": 0.4})
    [lobe] = material.reflectance().lobes
    wo = spherical(torch.tensor([[0.5]]), torch.tensor([[0.0]]))
    wi, solid_angle = hemisphere()
    above = float((lobe.sample(wo, lobe.sample_points(points_2d(N_SAMPLES, "random", 1))).wi.z > 0).double().mean())

    without = lobe.pdf(wo, wi) * 4 * dot(wo, half_vector(wo, wi))

    assert abs(float((without.double() * solid_angle).sum()) - above) > 0.5
