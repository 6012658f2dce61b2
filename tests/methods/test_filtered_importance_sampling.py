"""Filtered importance sampling: the paper's shader in plain numbers, the presets, and convergence."""

from functools import cache
from math import atan, atan2, cos, exp, log, log2, pi, sin, sqrt, tan

import pytest
import torch

from glossbench.brdf.ggx import GGX, SAMPLERS
from glossbench.brdf.kurt import Kurt
from glossbench.brdf.phong import Phong
from glossbench.directions import Vec3
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.lights.synthetic import Constant, Gradient, Spots
from glossbench.envmap.pyramid import lookup
from glossbench.errors import InputError
from glossbench.methods.filtered_importance_sampling import FilteredImportanceSampling
from glossbench.methods.filtered_importance_sampling.stratum import EDGE, mean_pdf, stratum_ratio
from glossbench.prefilter.pyramids import build_paraboloid, build_pyramid
from glossbench.scene.points import ShadingPoints, View
from glossbench.scene.sphere import Sphere
from glossbench.shading.image import shade
from glossbench.shading.stage_cache import StageCache
from glossbench.truth.reference import compute_reference

RESOLUTION = 64
CACHE = StageCache()


class Picked(View):
    """Eight points of a sphere from its middle to its rim, and its four outermost, at 88 degrees."""

    def mask(self):
        return torch.ones(3, 4, dtype=torch.bool)

    def points(self):
        points = Sphere(resolution=100).points()
        order = torch.argsort(points.n.z, stable=True)
        rows = torch.cat([order[:4], order[4 :: len(order) // 8][:8]])
        return ShadingPoints(*(Vec3(*(c[rows] for c in v)) for v in (points.t, points.b, points.n, points.wo)))

    def scene(self):
        return None


@cache
def spots():
    return Spots(seed=7, resolution=RESOLUTION).cubemap()


@cache
def pixels():
    """Frames (t, b, n) and viewing directions as lists of numbers, orthonormal to the last digit of float64."""
    p = Picked().points()
    t, n, wo = (torch.stack(list(v), dim=1).double() for v in (p.t, p.n, p.wo))
    n = torch.nn.functional.normalize(n, dim=1)
    t = torch.nn.functional.normalize(t - (t * n).sum(1, keepdim=True) * n, dim=1)
    frames = torch.stack([t, torch.linalg.cross(n, t), n], dim=1)
    return list(zip(frames.tolist(), wo.tolist(), strict=True))


# The paper's shader in plain numbers. Only the texel lookup is the library's.


def inner(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def unit(v):
    return [x / sqrt(inner(v, v)) for x in v]


def hammersley(i, n):
    """(i + 1/2) / n, and i with its binary digits mirrored at the point, half a step on."""
    return (i + 0.5) / n, sum(int(d) / 2 ** (k + 1) for k, d in enumerate(reversed(f"{i:b}"))) + 0.5 / n


def mirror(wo, h):
    return [2 * inner(wo, h) * b - a for a, b in zip(wo, h, strict=True)]


def kurt(m_x, m_y, f0=1.0, shadowing=0.0):
    """Sampler, density and value of the Kurt lobe: Luksch et al. 2014 eq. 2 to 7 and 10."""

    def angles(h):
        return atan(sqrt(h[0] ** 2 + h[1] ** 2) / h[2]), atan2(h[1], h[0])

    def q(theta, phi):
        return exp(-(tan(theta) ** 2) * (cos(phi) ** 2 / m_x**2 + sin(phi) ** 2 / m_y**2))

    def sample(u, wo):
        phi = atan2(m_y * sin(2 * pi * u[1]), m_x * cos(2 * pi * u[1]))
        theta = atan(sqrt(-log(u[0]) / (cos(phi) ** 2 / m_x**2 + sin(phi) ** 2 / m_y**2)))
        return mirror(wo, [sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta)])

    def pdf(wi, wo):
        h = unit([a + b for a, b in zip(wi, wo, strict=True)])
        theta, phi = angles(h)
        return q(theta, phi) / (4 * pi * m_x * m_y * cos(theta) ** 3 * inner(wo, h))

    def f(wi, wo):
        h = unit([a + b for a, b in zip(wi, wo, strict=True)])
        theta, phi = angles(h)
        fresnel = f0 + (1 - f0) * (1 - inner(wo, h)) ** 5
        D = q(theta, phi) / (pi * m_x * m_y * cos(theta) ** 4)
        return fresnel * D / (4 * inner(wo, h) * (wi[2] * wo[2]) ** shadowing)

    return sample, pdf, f


def ggx(a_x, a_y, f0=1.0):
    """Sampler, density and value of GGX: Heitz 2018, listing 1 and eq. 3; Heitz 2014 eq. 99."""

    def big_lambda(v):
        return (-1 + sqrt(1 + ((a_x * v[0]) ** 2 + (a_y * v[1]) ** 2) / v[2] ** 2)) / 2

    def D(h):
        return 1 / (pi * a_x * a_y * ((h[0] / a_x) ** 2 + (h[1] / a_y) ** 2 + h[2] ** 2) ** 2)

    def sample(u, wo):
        v = unit([a_x * wo[0], a_y * wo[1], wo[2]])
        length = v[0] ** 2 + v[1] ** 2
        t1 = [-v[1] / sqrt(length), v[0] / sqrt(length), 0.0] if length > 0 else [1.0, 0.0, 0.0]
        t2 = [v[1] * t1[2] - v[2] * t1[1], v[2] * t1[0] - v[0] * t1[2], v[0] * t1[1] - v[1] * t1[0]]
        r, phi = sqrt(u[0]), 2 * pi * u[1]
        p1, s = r * cos(phi), (1 + v[2]) / 2
        p2 = (1 - s) * sqrt(1 - p1 * p1) + s * r * sin(phi)
        p3 = sqrt(max(0.0, 1 - p1 * p1 - p2 * p2))
        n = [p1 * t1[k] + p2 * t2[k] + p3 * v[k] for k in range(3)]
        return mirror(wo, unit([a_x * n[0], a_y * n[1], max(0.0, n[2])]))

    def pdf(wi, wo):
        h = unit([a + b for a, b in zip(wi, wo, strict=True)])
        visible_normals = D(h) * inner(wo, h) / ((1 + big_lambda(wo)) * wo[2])
        return visible_normals / (4 * inner(wo, h))

    def f(wi, wo):
        h = unit([a + b for a, b in zip(wi, wo, strict=True)])
        fresnel = f0 + (1 - f0) * (1 - inner(wo, h)) ** 5
        return fresnel * D(h) / ((1 + big_lambda(wo) + big_lambda(wi)) * 4 * wi[2] * wo[2])

    return sample, pdf, f


def texel_on_cube(world):
    """Solid angle at a direction of a texel, edge 2 / R, of the face [-1, 1]^2 at distance 1: cos^3 4 / R^2."""
    return max(abs(c) for c in world) ** 3 * 4 / RESOLUTION**2


def texel_on_paraboloid(world):
    """r(z) / (w h), r = 4 b^2 (|z| + 1)^2, b = 1.2; two images of twice the cube's edge."""
    return 4 * 1.2**2 * (abs(world[2]) + 1) ** 2 / (2 * RESOLUTION) ** 2


def filtered_importance_sampling(frame, view, brdf, n, environment, texel, k=4.0, mip_bias=0.0, cosine=True):
    """Section 5.1: FIS, one pixel, RGB, with l = max(1/2 log2(K / (N p Omega_texel)), 0)."""
    sample_brdf, p, f = brdf
    wo = [inner(view, axis) for axis in frame]
    c = [0.0, 0.0, 0.0]
    for i in range(n):
        wi = sample_brdf(hammersley(i, n), wo)
        if wi[2] <= 0:
            continue
        world = [sum(wi[j] * frame[j][axis] for j in range(3)) for axis in range(3)]
        pdf = p(wi, wo)
        lod = max(log2(k / (n * pdf * texel(world))) / 2 + mip_bias, 0.0)
        L = lookup(environment, Vec3(*(torch.tensor([x]) for x in world)), torch.tensor([lod]))[0].tolist()
        weight = f(wi, wo) * (wi[2] if cosine else 1) / pdf
        c = [s + x * weight for s, x in zip(c, L, strict=True)]
    return [s / n for s in c]


BRDFS = {
    "kurt": (Kurt(m=(0.1, 0.1)), kurt(0.1, 0.1)),
    "kurt_anisotropic": (Kurt(m=(0.3, 0.08), f0=0.2, shadowing=0.4), kurt(0.3, 0.08, 0.2, 0.4)),
    "ggx": (GGX(alpha=(0.2, 0.2), f0=0.04), ggx(0.2, 0.2, 0.04)),
    "ggx_anisotropic": (GGX(alpha=(0.1, 0.4)), ggx(0.1, 0.4)),
}
PROJECTIONS = {"cube": (build_pyramid, texel_on_cube), "dual_paraboloid": (build_paraboloid, texel_on_paraboloid)}


def image_by_hand(brdf, projection, n=24, mip_filter="box", **options):
    """The image by a name of BRDFS or by functions (sample, pdf, f)."""
    build, texel = PROJECTIONS[projection]
    environment = build(spots(), mip_filter)
    by_hand = BRDFS[brdf][1] if isinstance(brdf, str) else brdf
    return [filtered_importance_sampling(*pixel, by_hand, n, environment, texel, **options) for pixel in pixels()]


def image_of(material, samples=24, **options):
    method = FilteredImportanceSampling(samples=samples, **options)
    image = shade(method, spots(), material, Picked(), cache=CACHE, time_it=False)
    return image.radiance[image.mask].double()


def worst_relative(image, by_hand):
    """Largest error of a pixel and channel over its radiance."""
    expected = torch.tensor(by_hand, dtype=torch.float64)
    return ((image - expected).abs() / expected).max().item()


@pytest.mark.parametrize("options", [{}, {"k": 1.0, "mip_bias": -0.5, "mip_filter": "gauss6"}], ids=str)
@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("brdf", BRDFS)
def test_image_is_what_the_papers_shader_computes(brdf, projection, options):
    by_hand = image_by_hand(brdf, projection, **options)

    image = image_of(BRDFS[brdf][0], projection=projection, **options)

    # Measured: 2.3e-6, views to 88 degrees.
    assert worst_relative(image, by_hand) < 2e-5


@pytest.mark.parametrize(
    "fault",
    [
        {"brdf": kurt(0.09, 0.0064)},
        {"brdf": kurt(0.08, 0.3)},
        {"cosine": False},
        {"k": 4.1},
        {"mip_bias": 0.02},
        {"mip_filter": "gauss4"},
        {"n": 25},
    ],
    ids=["widths squared", "widths swapped", "no cosine", "k", "mip_bias", "mip_filter", "n"],
)
def test_comparison_with_the_shader_notices(fault):
    image = image_of(Kurt(m=(0.3, 0.08)))
    right = {"brdf": kurt(0.3, 0.08), "projection": "cube"}

    planted = image_by_hand(**(right | fault))

    assert worst_relative(image, image_by_hand(**right)) < 2e-5
    assert worst_relative(image, planted) > 1e-3


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_comparison_with_the_shader_notices_the_other_projections_texels(projection):
    image = image_of(Kurt(m=(0.3, 0.08)), projection=projection)
    (other,) = set(PROJECTIONS) - {projection}
    environment, texel = PROJECTIONS[projection][0](spots(), "box"), PROJECTIONS[other][1]

    planted = [filtered_importance_sampling(*pixel, kurt(0.3, 0.08), 24, environment, texel) for pixel in pixels()]

    assert worst_relative(image, planted) > 1e-3


# The level of detail by other names.


def test_k_of_4_is_one_level_and_the_code_of_filament():
    material = Kurt(m=(0.3, 0.08))

    images = [image_of(material, **o) for o in ({"k": 4.0}, {"k": 1.0, "mip_bias": 1.0}, {"lod_bias": "filament"})]

    assert (images[0] == images[1]).all()
    assert (images[0] == images[2]).all()


@pytest.mark.parametrize(
    ("code", "levels"),
    [("plain", 0.0), ("bevy", 0.0), ("unreal", -0.5), ("three_r187", 0.5), ("hdrp", 0.25), ("filament", 1.0),
     ("filament_last_level", 2.0), ("babylon", 1.0), ("materialx", 1.15), ("godot", 1.29), ("gltf_ibl_sampler", 1.83),
     ("playcanvas", 1.83)],
)  # fmt: skip
def test_lod_bias_of_a_code_adds_its_levels(code, levels):
    by_name = image_of(GGX(alpha=0.25), 16, lod_bias=code, mip_bias=0.25)

    by_number = image_of(GGX(alpha=0.25), 16, k=1.0, mip_bias=0.25 + levels)

    assert (by_name == by_number).all()


def test_dropped_4_pi_of_the_gltf_sampler_is_its_number_of_levels():
    """1/2 log2(4 pi) = 1.826."""
    assert log2(4 * pi) / 2 == pytest.approx(1.83, abs=0.005)


def test_unknown_code_is_refused():
    with pytest.raises(InputError, match="lod_bias"):
        FilteredImportanceSampling(lod_bias="cryengine")


# The kernel of a stratum.


def solid_angle_of_share(alpha, n):
    """Of the cone about the mirror direction along the normal that holds 1 / n: cos_l = 2 cos_h^2 - 1 at u = 1 / n."""
    cos2 = (1 - 1 / n) / (1 + (alpha**2 - 1) / n)
    return 2 * pi * (2 - 2 * cos2)


@pytest.mark.parametrize("alpha", [0.05, 0.3, 0.6])
@pytest.mark.parametrize(("n", "error"), [(4, 0.02), (16, 3e-4), (256, 1e-5)])
def test_mean_density_holds_one_sample_of_n(alpha, n, error):
    """Measured: 1.2e-2 with 4 samples, 1.6e-4 with 16, 1e-6 with 256; the density at the sample: 25, 6 and 0.4 %."""
    lobe = GGX(alpha=alpha).reflectance().lobes[0]
    up = Vec3(*torch.tensor([[[0.0]], [[0.0]], [[1.0]]]).double())
    pdf, expected = lobe.pdf(up, up), solid_angle_of_share(alpha, n)

    mean = mean_pdf(lobe, up, up, pdf, torch.tensor(n))

    assert 1 / (n * mean).item() == pytest.approx(expected, rel=error)
    assert 1 / (n * pdf).item() != pytest.approx(expected, rel=5 * error)


def test_the_kernel_of_a_stratum_reads_coarser_levels_and_converges_to_that_of_a_point():
    def differ(samples):
        point, stratum = (image_of(GGX(alpha=0.3), samples, k=1.0, kernel=kernel) for kernel in ("point", "stratum"))
        return ((point - stratum).square().mean().sqrt() / point.mean()).item()

    assert differ(16) > 4 * differ(1024) > 0


@pytest.mark.parametrize("kernel", ["stratum", "normal_stratum"])
def test_an_affine_footprint_has_no_stratum_kernel(kernel):
    with pytest.raises(InputError, match=f"'{kernel}' is for the isotropic footprint, got affine"):
        FilteredImportanceSampling(kernel=kernel, footprint="affine")


def grid(edge):
    """The middles of edge^2 squares, whose strata tile the unit square."""
    middles = (torch.arange(edge) + 0.5) / edge
    return torch.cartesian_prod(middles, middles)


def omega_of(lobe, u, ratio):
    """The solid angle that a ratio stands for: 1 / (N p ratio)."""
    up = Vec3(*torch.tensor([[[0.0]], [[0.0]], [[1.0]]]))
    return (1 / (len(u) * lobe.sample(up, lobe.sample_points(u)).pdf * ratio))[0]


def check_own_strata(ratio_of):
    """dphi (cos_l(u-) - cos_l(u+)) of GGX, cos_l = 2 cos_h^2 - 1, cos_h^2 = (1 - u) / (1 + (alpha^2 - 1) u)."""
    edge, alpha = 8, 0.3
    u, lobe = grid(edge), GGX(alpha=alpha).reflectance().lobes[0]
    edges = [2 * (1 - e) / (1 + (alpha**2 - 1) * e) - 1 for e in (u[:, 0] - 0.5 / edge, u[:, 0] + 0.5 / edge)]
    expected = (2 * pi / edge * (edges[0] - edges[1])).clamp(max=2 * pi)
    torch.testing.assert_close(omega_of(lobe, u, ratio_of(lobe, u)), expected, rtol=1e-4, atol=0)  # measured 2e-5


def test_own_strata_along_the_normal_are_those_of_the_closed_form():
    check_own_strata(stratum_ratio)


def test_the_check_of_own_strata_notices_strata_that_are_a_tenth_too_large():
    with pytest.raises(AssertionError):
        check_own_strata(lambda lobe, u: stratum_ratio(lobe, u) / 1.1)


@pytest.mark.parametrize(
    ("material", "lowest"),
    [
        (GGX(alpha=(0.4, 0.05)), -1),
        (Kurt(m=(0.2, 0.2)), 2 / (1 - 0.2**2 * log(EDGE)) - 1),  # cos_h^2 = 1 / (1 - m^2 log u)
        (Phong(s=40.0), EDGE ** (1 / 41)),  # cos = u^(1 / (s + 1))
    ],
)
def test_own_strata_tile_the_directions(material, lowest):
    """Half vectors up to the horizon reflect to all of the sphere; `kurt` and `phong` end at u = EDGE."""
    lobe, u = material.reflectance().lobes[0], grid(32)
    total = omega_of(lobe, u, stratum_ratio(lobe, u)).sum().item()
    assert total == pytest.approx(2 * pi * (1 - lowest), rel=2e-3)


def test_the_kernel_of_own_strata_converges_to_that_of_a_point():
    def differ(samples):
        images = [image_of(GGX(alpha=0.3), samples, k=1.0, kernel=kernel) for kernel in ("point", "normal_stratum")]
        return ((images[0] - images[1]).square().mean().sqrt() / images[0].mean()).item()

    assert differ(16) > 4 * differ(1024) > 0


def test_every_sampler_has_the_same_limit():
    images = []
    for sampler in SAMPLERS:
        method = FilteredImportanceSampling(samples=4096, k=1.0, sampler=sampler)
        image = shade(method, rough(), GGX(alpha=(0.2, 0.5)), Sphere(resolution=6), cache=CACHE, time_it=False)
        images.append(image.radiance[image.mask])

    for image in images[1:]:
        difference = (image - images[0]).square().mean().sqrt() / images[0].mean()
        assert 0 < difference < 5e-3  # measured up to 2.7e-3; four times that at 1024 samples


def test_a_material_without_masking_has_no_visible_normals():
    kurt = Kurt(m=(0.1, 0.1))

    reasons = [FilteredImportanceSampling(sampler=s).supports(kurt, None) for s in ("own", "normals", "bounded_caps")]

    assert reasons[:2] == [None, None]
    assert reasons[2] == "a lobe of the material has no sampler 'bounded_caps', it has own, normals"


# Limits.


@cache
def rough():
    generator = torch.Generator().manual_seed(4)
    return CubeMap(10 ** (2 * torch.rand(6, 16, 16, 3, generator=generator) - 1), "rough")


@pytest.mark.parametrize("material", [Kurt(m=(0.3, 0.15), f0=0.5), GGX(alpha=0.3)], ids=["kurt", "ggx"])
@pytest.mark.parametrize("projection", PROJECTIONS)
def test_many_samples_reach_the_reference(material, projection):
    # A light of single texels does not survive the change of projection: 1.6 % RMS at any budget.
    light = rough() if projection == "cube" else Gradient(resolution=32).cubemap()
    view = Sphere(resolution=6)
    truth = compute_reference(light, material, view, relative_error=1e-3)

    def rms(samples):
        method = FilteredImportanceSampling(samples=samples, projection=projection)
        image = shade(method, light, material, view, cache=CACHE, time_it=False)
        return ((image.radiance - truth.radiance)[truth.mask].square().mean().sqrt() / truth.mean).item()

    errors = [rms(n) for n in (16, 256, 16384)]

    assert errors[0] > errors[1] > errors[2]
    # Measured: 5e-4 to 8e-4, which is the reference's own noise.
    assert errors[2] < 2e-3


def test_lobes_and_diffuse_part_add_up():
    lobes = ({"m": (0.1, 0.1), "ks": 0.75}, {"m": (0.3, 0.2), "ks": 0.25, "f0": 0.5})

    together = image_of(Kurt(lobes=lobes, kd=0.4), samples=32)

    apart = image_of(Kurt(**lobes[0]), 24) + image_of(Kurt(**lobes[1]), 8) + image_of(Kurt(ks=0.0, kd=0.4), 1)
    torch.testing.assert_close(together, apart, rtol=1e-5, atol=0)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_constant_light_returns_the_albedo_of_the_same_samples(projection):
    view, material = Sphere(resolution=8), GGX(alpha=0.3, f0=(0.9, 0.5, 0.1), kd=0.2)
    method = FilteredImportanceSampling(samples=64, projection=projection)

    image = shade(method, Constant(radiance=2.0).cubemap(), material, view, cache=CACHE, time_it=False)

    expected = 2 * material.albedo(view.points().wo_local(), n_samples=64)
    torch.testing.assert_close(image.radiance[image.mask].double(), expected, rtol=1e-5, atol=0)


def test_a_limit_darkens_what_is_brighter_and_nothing_else():
    light = Spots(seed=7, resolution=16).cubemap()
    weights = torch.tensor([0.2126, 0.7152, 0.0722])
    limit = 3 * float(light.mean() @ weights.double())
    faces, luminance = light.faces.clone(), light.faces @ weights
    bright = luminance > limit
    faces[bright] *= (limit / luminance[bright])[:, None]

    cut = FilteredImportanceSampling.pyramid.function(FilteredImportanceSampling(clamp=3.0), light)

    assert 0 < bright.double().mean() < 0.2
    torch.testing.assert_close(cut.texels, build_pyramid(CubeMap(faces), "box").texels, rtol=1e-6, atol=0)


def test_a_limit_leaves_black_light_black():
    black = CubeMap(torch.zeros(6, 4, 4, 3))

    cut = FilteredImportanceSampling.pyramid.function(FilteredImportanceSampling(clamp=3.0), black)

    assert (cut.texels == 0).all()
