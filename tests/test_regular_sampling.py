"""Regular sampling: the paper's own sample counts, and its pseudo code in plain numbers against the method."""

from math import acos, atan, cos, exp, floor, hypot, log, pi, radians, sin, sqrt, tan

import pytest
import torch

from glossbench.brdf.ggx import GGX
from glossbench.brdf.kurt import Kurt
from glossbench.directions import Vec3
from glossbench.envmap.pyramid import build_pyramid, lookup
from glossbench.envmap.synthetic import Constant, Spots
from glossbench.errors import InputError
from glossbench.methods.regular_sampling import RegularSampling, lobe_area, sample_pattern
from glossbench.scene.points import ShadingPoints
from glossbench.scene.sphere import Sphere
from glossbench.shading import shade

# m_x, m_y, xi, n_circles, spacing -> samples: figures 4, 8 (top, bottom), 9 and 10 of the paper.
COUNTS = [
    (0.1, 0.1, 0.1, 3, "s1", 19),
    (0.1, 0.1, 0.1, 3, "s2", 30),
    (0.1, 0.1, 0.2, 2, "s2", 14),
    (0.15, 0.15, 0.2, 3, "s2", 30),
    (0.2, 0.075, 0.2, 4, "s1", 17),
    (0.15, 0.15, 0.01, 10, "s1", 271),
]
WIDTHS = [(0.1, 0.1), (0.2, 0.075), (0.05, 0.4), (1.0, 0.3)]


# The paper's pseudo code in plain numbers. Only the texel lookup is the library's.


def spacing_as_read(theta_max, n_circles, spacing):
    return theta_max / (n_circles - 1 / 2) if spacing == "s1" else theta_max / (n_circles + 1 / 6)


def spacing_as_printed(theta_max, n_circles, spacing):
    """Eq. 12."""
    return theta_max / (n_circles + 1) if spacing == "s1" else theta_max / (n_circles + 2)


def q_beckmann(theta, phi, m_x, m_y):
    """Eq. 5."""
    return exp(-(tan(theta) ** 2) * (cos(phi) ** 2 / m_x**2 + sin(phi) ** 2 / m_y**2))


def pattern_by_hand(m_x, m_y, xi, n_circles, spacing, space=spacing_as_read):
    """Section 5: circles, eq. 13, rejection, and the better of two half-turned circles."""
    s = space(atan(sqrt(-log(xi)) * max(m_x, m_y)), n_circles, spacing)
    thetas = [i * s if spacing == "s1" else (i + 2 / 3) * s for i in range(n_circles)]
    n_0, theta_0 = (6, s) if spacing == "s1" else (4, thetas[0])
    kept = []
    for theta in thetas:
        n = 2 * floor(n_0 * sin(theta) / (2 * sin(theta_0)) + 0.5) if theta > 0 else 1
        circles = [[(theta, 2 * pi * (i + turn) / n) for i in range(n)] for turn in (0, 0.5)]
        circles = [[h for h in circle if q_beckmann(*h, m_x, m_y) >= xi] for circle in circles]
        sums = [sum(q_beckmann(*h, m_x, m_y) for h in circle) for circle in circles]
        kept += circles[1] if sums[1] > sums[0] + 1e-9 else circles[0]
    return kept


def inner(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def reflect_by_hand(wo, h):
    return [2 * inner(wo, h) * b - a for a, b in zip(wo, h, strict=True)]


def direction(theta, phi):
    return [sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta)]


def area_by_hand(wo, m_x, m_y, xi):
    """Eq. 14 and 15 in the local frame; no angle beyond 85 degrees."""
    centre = reflect_by_hand(wo, [0.0, 0.0, 1.0])
    edges = direction(atan(sqrt(-log(xi)) * m_x), 0), direction(atan(sqrt(-log(xi)) * m_y), pi / 2)
    angles = [acos(min(1.0, inner(centre, reflect_by_hand(wo, h)))) for h in edges]
    return pi * tan(min(angles[0], radians(85))) * tan(min(angles[1], radians(85)))


def evaluate_specular_lobe(frame, view, m_x, m_y, xi, half_vectors, pyramid, f0=1.0, shadowing=0.0, mip_bias=0.0):
    """Section 7: EvaluateSpecularLobe, one pixel, RGB."""

    def D(theta, phi):
        return q_beckmann(theta, phi, m_x, m_y) / (pi * m_x * m_y * cos(theta) ** 4)

    pdf_constant = sum(D(*h) for h in half_vectors) / len(half_vectors)
    wo = [inner(view, axis) for axis in frame]
    a = area_by_hand(wo, m_x, m_y, xi)
    brdf_sum = [0.0, 0.0, 0.0]
    for theta, phi in half_vectors:
        h = direction(theta, phi)
        wi = reflect_by_hand(wo, h)
        if wi[2] <= 0:
            continue
        world = [sum(wi[k] * frame[k][axis] for k in range(3)) for axis in range(3)]
        texels = a * int(pyramid.sizes[0]) ** 2 / (4 * len(half_vectors))
        level = log(texels / max(abs(c) for c in world) / inner(wi, h), 4) + mip_bias
        at = Vec3(*(torch.tensor([c]) for c in world))
        radiance = lookup(pyramid, at, torch.tensor([max(level, 0.0)]))[0].tolist()
        fresnel = f0 + (1 - f0) * (1 - inner(wo, h)) ** 5
        brdf = fresnel * D(theta, phi) / (4 * inner(wo, h) * (wi[2] * wo[2]) ** shadowing)
        pdf = pdf_constant / (4 * inner(h, wi))
        brdf_sum = [s + L * brdf / pdf * wi[2] for s, L in zip(brdf_sum, radiance, strict=True)]
    return [s / len(half_vectors) for s in brdf_sum]


def spots():
    return Spots(seed=7, resolution=64).cubemap()


def pixels_of(view):
    """Frames (t, b, n) and viewing directions as lists of numbers."""
    p = view.points()
    axes = [torch.stack(list(v), dim=1).double().tolist() for v in (p.t, p.b, p.n, p.wo)]
    return [([t, b, n], wo) for t, b, n, wo in zip(*axes, strict=True)]


def worst_relative(image, by_hand):
    """Largest error of a pixel and channel over the pixel's radiance."""
    expected = torch.tensor(by_hand, dtype=torch.float64)
    return ((image.radiance[image.mask].double() - expected).abs() / expected).max().item()


@pytest.mark.parametrize(
    ("m", "xi", "n_circles", "spacing", "options"),
    [
        ((0.1, 0.1), 0.2, 2, "s2", {}),
        ((0.2, 0.075), 0.2, 4, "s1", {"mip_bias": -0.5}),
        ((0.05, 0.4), 0.05, 5, "s2", {"f0": 0.04, "shadowing": 0.4}),
        ((0.5, 0.3), 0.01, 3, "s1", {"f0": 0.5, "mip_bias": 0.7}),
    ],
)
@pytest.mark.parametrize("mip_filter", ["box", "gauss6"])
def test_image_is_what_the_papers_pseudo_code_computes(m, xi, n_circles, spacing, options, mip_filter):
    light, view, half_vectors = spots(), Sphere(resolution=12), pattern_by_hand(*m, xi, n_circles, spacing)
    bias = {k: v for k, v in options.items() if k == "mip_bias"}
    material = Kurt(m=m, **{k: v for k, v in options.items() if k != "mip_bias"})
    method = RegularSampling(xi=xi, n_circles=n_circles, spacing=spacing, mip_filter=mip_filter, **bias)

    image = shade(method, light, material, view, time_it=False)

    pyramid = build_pyramid(light, mip_filter)
    by_hand = [
        evaluate_specular_lobe(*pixel, *m, xi, half_vectors, pyramid, **options) for pixel in pixels_of(view)
    ]
    assert worst_relative(image, by_hand) < 1e-4
