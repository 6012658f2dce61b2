"""The cases of the contract's checks: lights, materials and points, also hard ones, and a method ready to shade them.

Points are given directly, not by a camera: with any normal, seen from any direction, in any order.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from math import pi
from typing import NamedTuple

import torch
from torch import Tensor

from glossbench.brdf.ggx import GGX
from glossbench.brdf.kurt import Kurt, KurtLobe
from glossbench.brdf.material import MATERIALS, Material
from glossbench.catalog.entries import list_entries
from glossbench.directions import Vec3, cross, normalize, points_2d, spherical, to_world
from glossbench.envmap.cubemap import CubeMap, face_coordinates, texel_directions
from glossbench.envmap.lights.synthetic import Spots
from glossbench.errors import InputError
from glossbench.scene.points import ShadingPoints, View
from glossbench.scene.sphere import UnitSphere
from glossbench.shading.image import prepare, select_arguments
from glossbench.shading.method import INPUTS, Method, find_budget_option
from glossbench.shading.stage_cache import StageCache
from glossbench.truth.reference import Reference, compute_reference

FURNACE_MATERIALS: tuple[Material, ...] = (
    Kurt(m=(0.1, 0.1)),
    Kurt(m=(0.2, 0.075)),
    Kurt(m=(0.4, 0.4), f0=(0.04, 0.04, 0.04), kd=(0.5, 0.4, 0.3)),
    GGX(alpha=(0.3, 0.3), f0=(1.0, 0.7, 0.3)),
)
# Anisotropic lobes first, so that a frame that does not turn becomes visible.
GENERAL_MATERIALS: tuple[Material, ...] = (
    Kurt(m=(0.3, 0.15)),
    GGX(alpha=(0.3, 0.15)),
    Kurt(m=(0.3, 0.3)),
    GGX(alpha=(0.3, 0.3)),
)
HARD_MATERIALS: tuple[Material, ...] = (
    Kurt(m=(1e-3, 1e-3)),
    Kurt(m=(1.0, 1.0), shadowing=1.0),
    Kurt(m=(1.0, 1e-3), kd=(1.0, 1.0, 1.0)),
    Kurt(lobes=(KurtLobe(m=(0.01, 0.01)), KurtLobe(m=(0.5, 0.5), ks=(0.0, 0.5, 1.0)))),
    GGX(alpha=(1e-3, 1e-3)),
    GGX(alpha=(1.0, 1.0), f0=(0.0, 0.0, 0.0)),
)


class Truth(NamedTuple):
    """A light, a material, points, and their converged reference."""

    light: CubeMap
    material: Material
    points: ShadingPoints
    reference: Reference


class GivenPoints(View):
    """Given points on the unit sphere, as an image of one row."""

    def __init__(self, points: ShadingPoints) -> None:
        object.__setattr__(self, "given", points)

    # Two views of different points are different views, although their options are equal.
    def __eq__(self, other: object) -> bool:
        return self is other

    def __hash__(self) -> int:
        return id(self)

    def mask(self) -> Tensor:
        """All true, (1, P)."""
        return torch.ones(1, len(self.points()), dtype=torch.bool)

    def points(self) -> ShadingPoints:
        """The given points."""
        given: ShadingPoints = vars(self)["given"]
        return given

    def scene(self) -> UnitSphere:
        """The unit sphere, which looks the same when it is turned."""
        return SPHERE


SPHERE = UnitSphere()


@dataclass(frozen=True)
class UnknownScene:
    """A scene of a type that no method knows."""


class Shader:
    """A method under a light, ready for any points. For new points, only stages that need the view are computed again.

    Args:
        kept: stages of the method for other lights and materials, to be shared; by default none.
    """

    def __init__(self, method: Method, light: CubeMap, material: Material, kept: StageCache | None = None) -> None:
        self.method, self.light, self.material = method, light, material
        self.kept = StageCache() if kept is None else kept

    def __call__(self, points: ShadingPoints) -> Tensor:
        view = GivenPoints(points)
        inputs = dict(zip(INPUTS, (self.light, self.material, view.scene(), view), strict=True))
        prepared = prepare(self.method, inputs, self.kept)
        known = {**inputs, "points": points, **{name: each.value for name, each in prepared.items()}}
        return self.method.shade(**select_arguments(self.method.shade, known))


def build_truth(method: Method) -> Truth:
    """The case against which convergence is measured; the noise of its reference is at most 0.1 % of the mean."""
    light, material, points = build_spots(3), choose_material(method), build_general_points(100)
    return Truth(light, material, points, compute_reference(light, material, GivenPoints(points)))


def build_spots(seed: int) -> CubeMap:
    """Small lights of moderate contrast, so that with few samples all pixels have an error, not only some."""
    light = _build_spots(seed)
    return CubeMap(light.faces.clone(), light.key)  # a copy, because a method may write into it


@cache
def _build_spots(seed: int) -> CubeMap:
    return Spots(seed=seed, resolution=32, contrast=100.0).cubemap()


def build_general_points(n: int = 200) -> ShadingPoints:
    """Points all over the sphere, seen from all sides with cos_o in [0.05, 1], with tangents in all directions."""
    u, v = points_2d(n, "r2").double(), points_2d(n, "random", seed=1).double()
    azimuth = 2 * pi * points_2d(n, "random", seed=2).double()[:, 0]
    normal = spherical(torch.acos(1 - 2 * u[:, 0]), 2 * pi * u[:, 1])
    return _build_points(normal, 0.05 + 0.95 * v[:, 0], 2 * pi * v[:, 1], azimuth)


@cache
def compute_albedo(material: Material) -> Tensor:
    """The directional albedo of a material at the general points, (P, 3)."""
    return material.albedo(build_general_points().wo_local())


def build_hard_points() -> ShadingPoints:
    """Normals towards the faces, edges and corners of the cube, seen at cos_o = 1, 0.5 and 1e-4."""
    signs = torch.cartesian_prod(*[torch.tensor([-1.0, 0.0, 1.0], dtype=torch.float64)] * 3)
    signs = signs[signs.any(1)].repeat(3, 1)
    n = len(signs) // 3
    cos_o = torch.tensor([1.0, 0.5, 1e-4], dtype=torch.float64).repeat_interleave(n)
    azimuth = torch.arange(3 * n, dtype=torch.float64)
    return _build_points(normalize(Vec3(*signs.T)), cos_o, torch.zeros(3 * n, dtype=torch.float64), azimuth)


def _build_points(n: Vec3, cos_o: Tensor, tangent: Tensor, azimuth: Tensor) -> ShadingPoints:
    upright = n.y.abs() > 0.9
    up = Vec3(upright.double(), (~upright).double(), torch.zeros_like(n.x))
    t = normalize(cross(up, n))
    t = to_world(spherical(torch.full_like(n.x, pi / 2), tangent), t, cross(n, t), n)
    b = cross(n, t)
    wo = to_world(spherical(torch.acos(cos_o), azimuth), t, b, n)
    return ShadingPoints(*(Vec3(*(c.float() for c in v)) for v in (t, b, n, wo)))


def turn(v: Vec3, axis: int) -> Vec3:
    """v turned by +90 degrees about a coordinate axis. Exact: a permutation of components with one change of sign."""
    turned = list(v)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turned[i], turned[j] = -v[j], v[i]
    return Vec3(*turned)


def turn_light(light: CubeMap, axis: int) -> CubeMap:
    """The light turned by +90 degrees about a coordinate axis: each texel moves to one texel, unchanged."""
    r = light.resolution
    source = texel_directions(r)
    for _ in range(3):  # L'(d) = L(R^-1 d), and R^-1 = R^3
        source = turn(source, axis)
    face, s, t, _ = face_coordinates(source)
    column, row = (((c + 1) * (r / 2)).long().clamp(0, r - 1) for c in (s, t))
    return CubeMap(light.faces[face.long(), row, column], f"{light.key} turned about {'xyz'[axis]}")


def select_points(points: ShadingPoints, start: int, stop: int) -> ShadingPoints:
    return points.map(lambda c: c[start:stop])


def make_registered_materials() -> Iterator[Material]:
    """The registered materials that need no file, with default options."""
    for name in sorted(set(MATERIALS.names()) - {entry.name for entry in list_entries("brdf")}):
        try:
            yield MATERIALS.create(name, {})
        except InputError:
            continue  # needs options, such as a file


def select_supported(method: Method, materials: tuple[Material, ...]) -> list[Material]:
    return [material for material in materials if method.supports(material, UnitSphere()) is None]


def choose_material(method: Method) -> Material:
    for material in select_supported(method, GENERAL_MATERIALS):
        return material
    reason = method.supports(GENERAL_MATERIALS[0], UnitSphere())
    raise InputError(f"supports none of the {len(GENERAL_MATERIALS)} materials of the check: {reason}")


def make_accurate(method: Method) -> Method:
    """The method with the options for which its contract promises accuracy."""
    return replace(method, **method.contract.options)


def with_all_budget(method: Method) -> Method:
    """The method with the largest budget of its contract; unchanged if it has no budget."""
    budget = method.contract.budget
    if budget is None or not find_budget_option(type(method)):
        return method
    return replace(method, **{budget[0]: max(budget[1])})


def label_material(material: Material) -> str:
    """A material in a few words: its name and its widths."""
    widths = material.as_dict().get("m") or material.as_dict().get("alpha") or ()
    return " ".join([material.name, *(f"{w:g}" for w in widths)])
