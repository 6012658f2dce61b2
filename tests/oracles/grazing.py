"""Grazing views and peaks of 1 : 100000, integrated by product Gauss quadrature over the faces of the cube."""

from dataclasses import dataclass
from functools import cache
from math import pi, sqrt

import numpy as np
import torch

from glossbench.brdf.cook_torrance import CookTorrance
from glossbench.brdf.phong import Phong
from glossbench.directions import Vec3
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.lights.synthetic import Constant
from glossbench.scene.points import ShadingPoints, View
from glossbench.scene.sphere import UnitSphere
from oracles.cube_by_hand import centres, face_points
from oracles.texel_sums import MATERIALS, Glossy, gauss_light, lights

COSINES = np.array([0.3, 0.1, 0.03, 0.01, 0.003])  # n . wo of the pixels


class Grazing(View):
    """A surface of normal +z seen from the side of +x, one pixel a cosine."""

    def mask(self):
        return torch.ones(1, len(COSINES), dtype=torch.bool)

    def points(self):
        c = torch.tensor(COSINES).float()
        zero, one = torch.zeros_like(c), torch.ones_like(c)
        wo = Vec3(torch.sqrt(1 - c * c), zero, c)
        return ShadingPoints(Vec3(one, zero, zero), Vec3(zero, one, zero), Vec3(zero, zero, one), wo)

    def scene(self):
        return UnitSphere()  # hides nothing


@dataclass(frozen=True)
class Grooves:
    """Cook-Torrance by hand."""

    m: float
    f0: tuple[float, ...]

    def material(self):
        return CookTorrance(m=self.m, f0=self.f0)

    def f(self, wo, wi):
        h = wo + wi
        h = h / np.linalg.norm(h, axis=1, keepdims=True)
        c, cos2 = h @ wo, h[:, 2] ** 2
        beckmann = np.exp((1 - 1 / cos2) / self.m**2) / (pi * self.m**2 * cos2**2)
        masked = np.minimum(1, 2 * h[:, 2] * np.minimum(wi[:, 2], wo[2]) / c)
        fresnel = np.array(self.f0) + (1 - np.array(self.f0)) * ((1 - c) ** 5)[:, None]
        return fresnel * (beckmann * masked / (4 * wi[:, 2] * wo[2]))[:, None]


@dataclass(frozen=True)
class Cosine:
    """Phong by hand."""

    s: float

    def material(self):
        return Phong(s=self.s)

    def f(self, wo, wi):
        cosine = (wi @ (wo * [-1, -1, 1])).clip(min=0)
        return np.broadcast_to((cosine**self.s * (self.s + 2) / (2 * pi))[:, None], wi.shape)


AT_GRAZING = {
    "kurt": Glossy("kurt", (0.1, 0.1)),
    "kurt_anisotropic": MATERIALS["kurt_anisotropic"],
    "ggx": Glossy("ggx", (0.1, 0.1), (0.04, 0.04, 0.04)),
    "ggx_anisotropic": MATERIALS["ggx_anisotropic"],
    "cook_torrance": Grooves(0.2, (0.9, 0.6, 0.2)),
    "phong": Cosine(30.0),
}


def disc(centre):
    """A few texels of 1e5 about a direction, on a floor of 1."""
    points = face_points(centres(16), centres(16))
    cosine = points @ centre / np.linalg.norm(points, axis=-1) / np.linalg.norm(centre)
    faces = np.ones((6, 16, 16, 3), np.float32)
    faces[cosine > np.cos(0.1)] = (1e5, 7e4, 4e4)
    return CubeMap(torch.tensor(faces), f"disc {centre}")


DISCS = {"disc in the lobe": (-1, 0.05, 0.2), "disc above": (-0.5, 0.4, 0.8), "disc on the horizon": (-1, 0.2, 0.03)}


@cache
def light_at_grazing(name):
    if name == "rough":
        return lights()["rough"]
    if name == "constant":
        return Constant(resolution=8).cubemap()
    return disc(DISCS[name])


def gauss(faces, order):
    """Directions above the horizon and radiance times solid angle, flat.

    Panels halve 14 times towards the horizon and the plane of incidence: the lobe of a grazing view is as narrow as its
    distance from their crossing.
    """
    halves = 2.0 ** -np.arange(15)
    d, weighted = gauss_light(faces, order, [*-halves, 0, *halves])
    above = d[..., 2] > 0
    return d[above], weighted[above]


def integrate(f, light, order=6, cosine=True):
    """Radiance (P, 3) of the grazing views."""
    d, weighted = gauss(light.faces.double().numpy(), order)
    weighted = weighted * d[:, 2:] if cosine else weighted
    return np.array([(f(np.array([sqrt(1 - c * c), 0, c]), d) * weighted).sum(0) for c in COSINES])
