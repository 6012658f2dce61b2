"""The sphere under a light as Mitsuba 3 sees it: its intersections, frames, light sampling and weighting.

Built-in materials are used where both have the formula. For the others there is one BSDF whose value is a formula
of this module, by Mitsuba's own microfacet distribution where it has one, and whose directions a built-in material
draws, which no formula of ours enters. Mitsuba's wi is the viewer and its wo the light: here they are o and i.
"""

from math import pi

import numpy as np
import pytest

from oracles.cube_by_hand import FACES, with_border

mi = pytest.importorskip("mitsuba")
mi.set_variant("scalar_rgb")
import drjit as dr  # noqa: E402

N_RENDERS = 24
PAIRS = 24  # of a light and a material sample, a pixel and render
HEIGHT = 1025  # of the image of a light


def interpolant(faces):
    """The bilinear interpolant of faces (6, R, R, 3) as a function of directions (..., 3), float64."""
    r, padded = faces.shape[1], with_border(faces)

    def radiance(d):
        along = d.reshape(-1, 3) @ FACES[:, 0].T
        face, found = along.argmax(-1), np.empty((len(along), 3))
        for k, (_, *axes) in enumerate(FACES):
            on = np.flatnonzero(face == k)
            u, v = ((d.reshape(-1, 3)[on] @ axis / along[on, k] + 1) * r / 2 + 0.5 for axis in axes)
            column, row = u.astype(int), v.astype(int)
            u, v = (u - column)[:, None], (v - row)[:, None]
            upper, lower = (padded[k, y, column] * (1 - u) + padded[k, y, column + 1] * u for y in (row, row + 1))
            found[on] = upper * (1 - v) + lower * v
        return found.reshape(d.shape)

    return radiance


def emitter(radiance, height=HEIGHT):
    """The environment emitter of a radiance, its first and last row at the poles."""
    width = 2 * (height - 1)
    theta, phi = np.arange(height)[:, None] * pi / (height - 1), (np.arange(width) + 0.5) * 2 * pi / width
    sin, one = np.sin(theta), np.ones(width)
    d = np.stack([sin * np.sin(phi), np.cos(theta) * one, -sin * np.cos(phi)], axis=-1)
    return mi.load_dict({"type": "envmap", "bitmap": mi.Bitmap(radiance(d).astype(np.float32))})


class Formula(mi.BSDF):
    """A value f(o, i) [1/sr] a channel; directions drawn and weighed by another material."""

    def __init__(self, f, sampler):
        mi.BSDF.__init__(self, mi.Properties("formula"))
        self.f, self.sampler = f, mi.load_dict(sampler)
        self.m_flags = self.sampler.flags()
        self.m_components = [self.m_flags]

    def value(self, o, i):
        return mi.Color3f(self.f(o, i)) * i.z if o.z > 0 and i.z > 0 else mi.Color3f(0)

    def sample(self, ctx, si, sample1, sample2, active=True):
        drawn, _ = self.sampler.sample(ctx, si, sample1, sample2)
        return drawn, self.value(si.wi, drawn.wo) / drawn.pdf if drawn.pdf > 0 else mi.Color3f(0)

    def eval(self, ctx, si, wo, active=True):
        return self.value(si.wi, wo)

    def pdf(self, ctx, si, wo, active=True):
        return self.sampler.pdf(ctx, si, wo)

    def eval_pdf(self, ctx, si, wo, active=True):
        return self.value(si.wi, wo), self.sampler.pdf(ctx, si, wo)


def conductor(kind, widths, half_diffuse=False):
    """Mitsuba's rough conductor without Fresnel, mixed half and half with a white diffuse surface on request."""
    rough = {"type": "roughconductor", "distribution": kind, "alpha_u": widths[0], "alpha_v": widths[1]}
    rough["material"] = "none"
    white = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}
    return {"type": "blendbsdf", "weight": 0.5, "a": rough, "b": white} if half_diffuse else rough


def distribution(kind, widths):
    kind = {"ggx": mi.MicrofacetType.GGX, "beckmann": mi.MicrofacetType.Beckmann}[kind]
    return mi.MicrofacetDistribution(kind, *widths, True)


def schlick(f0, c):
    """Schlick 1994, a channel."""
    return [r + (1 - r) * (1 - c) ** 5 for r in f0]


def ggx(alpha, f0=(1.0, 1.0, 1.0), separable=False):
    """F D G2 / (4 cos cos), G2 of Heitz 2014 eq. 99 from the shadowing G1 = 1 / (1 + Lambda) of each direction."""
    facets = distribution("ggx", alpha)

    def f(o, i):
        h = dr.normalize(o + i)
        g_o, g_i = facets.smith_g1(o, h), facets.smith_g1(i, h)
        g = g_o * g_i if separable else g_o * g_i / (g_o + g_i - g_o * g_i)
        value = facets.eval(h) * g / (4 * o.z * i.z)
        return [value * r for r in schlick(f0, dr.dot(o, h))]

    return Formula(f, conductor("ggx", alpha))


def kurt(m, f0=(1.0, 1.0, 1.0), shadowing=0.0, kd=(0.0, 0.0, 0.0)):
    """kd / pi + F D / (4 (o . h) (cos cos)^shadowing), Kurt et al. 2010."""
    facets = distribution("beckmann", m)

    def f(o, i):
        h = dr.normalize(o + i)
        c = dr.dot(o, h)
        value = facets.eval(h) / (4 * c * (o.z * i.z) ** shadowing)
        return [d / pi + value * r for d, r in zip(kd, schlick(f0, c), strict=True)]

    return Formula(f, conductor("beckmann", m, half_diffuse=True))


def cook_torrance(m, f0=(1.0, 1.0, 1.0)):
    """F D G / (4 cos cos), G the V-grooves' masking of light, of view, or none: Cook and Torrance 1982."""
    facets = distribution("beckmann", m)

    def f(o, i):
        h = dr.normalize(o + i)
        c = dr.dot(o, h)
        g = min(1, 2 * h.z * o.z / c, 2 * h.z * i.z / c)
        value = facets.eval(h) * g / (4 * o.z * i.z)
        return [value * r for r in schlick(f0, c)]

    return Formula(f, conductor("beckmann", m, half_diffuse=True))


def phong(s, ks, kd):
    """kd / pi + ks (s + 2) / (2 pi) cos^s of the angle from i to o mirrored at n: Lafortune and Willems 1994."""

    def f(o, i):
        lobe = max(o.z * i.z - o.x * i.x - o.y * i.y, 0) ** s * (s + 2) / (2 * pi)
        return [d / pi + k * lobe for d, k in zip(kd, ks, strict=True)]

    return Formula(f, conductor("beckmann", [(2 * s) ** -0.5] * 2, half_diffuse=True))


def diffuse(albedo):
    return mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": list(albedo)}})


def render(light, material, resolution):
    """Radiance (S, P, 3) of independent renders of the view's pixels, each ray through its pixel's centre."""
    about_y = mi.ScalarTransform4f().rotate([1, 0, 0], -90)  # the sphere's longitude runs about z
    sphere = {"type": "sphere", "bsdf": material, "to_world": about_y}
    scene = mi.load_dict({"type": "scene", "sphere": sphere, "light": light})
    direct = mi.load_dict({"type": "direct", "emitter_samples": PAIRS, "bsdf_samples": PAIRS})
    sampler = mi.load_dict({"type": "independent"})
    centres = (2 * np.arange(resolution) + 1) / resolution - 1
    rays = [
        mi.RayDifferential3f(mi.Ray3f([x, y, 2], [0, 0, -1])) for y in -centres for x in centres if x * x + y * y < 1
    ]
    images = []
    for seed in range(N_RENDERS):
        sampler.seed(seed, 1)
        images.append([direct.sample(scene, sampler, ray)[0] for ray in rays])
    return np.array(images, dtype=np.float64)
