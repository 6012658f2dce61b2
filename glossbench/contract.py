"""The contract that every method keeps, measured: what `glossbench check-method` runs on any plug-in.

Each check takes a method and a case whose answer is known, and returns an Outcome. What a method promises and
how closely, is its `Contract`; what holds for every method alike (finite, pure, the same for any chunking) is
here. A method that raises breaks the check in which it does.
"""

import importlib
import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import wraps
from math import log, pi
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from glossbench.brdf.ggx import GGX
from glossbench.brdf.kurt import Kurt, KurtLobe
from glossbench.brdf.material import MATERIALS, Material
from glossbench.directions import Vec3, cross, normalize, points_2d, spherical, to_world
from glossbench.envmap.cubemap import CubeMap, face_coordinates, texel_directions
from glossbench.envmap.synthetic import Constant, SingleTexel, Spots
from glossbench.errors import InputError, nearest
from glossbench.ground_truth import Reference, compute_reference
from glossbench.options import option_names
from glossbench.scene.points import ShadingPoints, View
from glossbench.scene.sphere import UnitSphere
from glossbench.shading import INPUTS, METHODS, Method, dependencies, stages_of

Measured = tuple[bool | None, str]  # kept and measured of an Outcome

# Float32 sums in another order. Measured over the methods here, largest change over the largest radiance:
# 5e-7 for a sum of lights, and none at all for pieces of odd sizes and single points.
ROUNDING = 1e-5

FURNACE_MATERIALS: tuple[Material, ...] = (
    Kurt(m=(0.1, 0.1)),
    Kurt(m=(0.2, 0.075)),
    Kurt(m=(0.4, 0.4), f0=(0.04, 0.04, 0.04), kd=(0.5, 0.4, 0.3)),
    GGX(alpha=(0.3, 0.3), f0=(1.0, 0.7, 0.3)),
)
# An anisotropic lobe, so that a frame that does not turn shows.
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


@dataclass(frozen=True)
class Outcome:
    """What a check found.

    Attributes:
        check: its name.
        kept: None where nothing is claimed or the check does not apply.
        measured: the number and its bound, in one line.
    """

    check: str
    kept: bool | None
    measured: str


class Truth(NamedTuple):
    """A light, a material, points and their converged radiance."""

    light: CubeMap
    material: Material
    points: ShadingPoints
    reference: Reference


class GivenPoints(View):
    """Points as an image of one row, on the unit sphere."""

    def __init__(self, points: ShadingPoints) -> None:
        object.__setattr__(self, "given", points)

    # Two views of other points are not the same view, although no option tells them apart.
    def __eq__(self, other: object) -> bool:
        return self is other

    def __hash__(self) -> int:
        return id(self)

    def mask(self) -> Tensor:
        """All true, (1, P)."""
        return torch.ones(1, len(self.points()), dtype=torch.bool)

    def points(self) -> ShadingPoints:
        """The points."""
        given: ShadingPoints = vars(self)["given"]
        return given

    def scene(self) -> UnitSphere:
        """The unit sphere: turned, it is itself."""
        return UnitSphere()


@dataclass(frozen=True)
class UnknownScene:
    """Geometry that no method has heard of."""


class Shader:
    """A method under a light, ready for any points: for others, only stages that need the view are redone."""

    def __init__(self, method: Method, light: CubeMap, material: Material) -> None:
        self.method, self.light, self.material = method, light, material
        self.kept: dict[str, Any] = {}

    def __call__(self, points: ShadingPoints) -> Tensor:
        view = GivenPoints(points)
        values = dict(zip(INPUTS, (self.light, self.material, view.scene(), view), strict=True))
        stages = stages_of(type(self.method))
        depends = dependencies(stages)
        for name, stage in stages.items():
            if name not in self.kept or "view" in depends[name]:
                needed = {n: (values | self.kept)[n] for n in stage.needs}
                self.kept[name] = stage.function(self.method, **needed)
        values |= self.kept | {"points": points}
        wanted = inspect.signature(self.method.shade).parameters
        return self.method.shade(**{name: values[name] for name in wanted})


def check_contract(name: str) -> list[Outcome]:
    """All checks of a registered method, or of each method that an importable module registers.

    Raises:
        InputError: no such method or module, the module registers none, or an option has no default.
    """
    methods = _methods_of(name)
    outcomes = []
    for method in methods:
        prefix = f"{method.name}: " if len(methods) > 1 else ""
        for check in CHECKS:
            outcome = check(method)
            outcomes.append(replace(outcome, check=prefix + outcome.check))
    return outcomes


def _methods_of(name: str) -> list[Method]:
    if name in METHODS.names():
        return [METHODS.create(name, {})]
    try:
        importlib.import_module(name)
    except Exception as error:  # a plug-in is anyone's code
        if isinstance(error, ModuleNotFoundError) and error.name == name.split(".")[0]:
            raise InputError(f"unknown method {name!r}, nor a module{nearest(name, METHODS.names())}") from None
        raise InputError(f"module {name!r}: {_one_line(error)}") from error
    classes = [METHODS.get(n) for n in METHODS.names()]
    own = [cls.create({}) for cls in classes if cls.__module__ == name]
    if not own:
        raise InputError(f"module {name!r} registers no method")
    return own


def _one_line(error: Exception) -> str:
    first, *_ = [*str(error).splitlines(), ""]
    return f"{type(error).__name__}: {first}"


def _check(name: str) -> Callable[[Callable[..., Measured]], Callable[..., Outcome]]:
    """Decorator: (kept, measured) becomes an Outcome, and an exception a broken one."""

    def named(function: Callable[..., Measured]) -> Callable[..., Outcome]:
        @wraps(function)
        def run(*args: Any) -> Outcome:
            try:
                return Outcome(name, *function(*args))
            except Exception as error:  # a plug-in is anyone's code
                return Outcome(name, False, _one_line(error))

        return run

    return named


@_check("furnace")
def check_furnace(method: Method) -> Measured:
    """Constant light comes back times the directional albedo; RMS error over the mean, the worst material."""
    accurate, points, light = (
        _largest(_accurate(method)),
        general_points(),
        Constant(radiance=(2.5, 2.5, 2.5)).cubemap(),
    )
    errors = {}
    for material in _supported(method, FURNACE_MATERIALS):
        expected = 2.5 * material.albedo(points.wo_local())
        errors[_label(material)] = _relative(Shader(accurate, light, material)(points), expected)
    if not errors:
        return None, "none of the materials is supported"
    # max() of a NaN and a number may be either.
    worst = next((m for m, e in errors.items() if not np.isfinite(e)), max(errors, key=errors.__getitem__))
    bound = method.contract.furnace
    return errors[worst] <= bound, f"{errors[worst]:.1e} of the mean with {worst}, at most {bound:g}"


@_check("linear in the light")
def check_linear(method: Method) -> Measured:
    """The image of a sum of lights is the sum of their images, that of a threefold light threefold."""
    if not method.contract.linear:
        return None, "not claimed"
    material, points = _general_material(method), general_points()
    one, two = spots(3), spots(4)
    a, b, total, triple = (
        Shader(method, CubeMap(faces, key), material)(points).double()
        for key, faces in (
            ("one", one.faces),
            ("two", two.faces),
            ("sum", one.faces + two.faces),
            ("triple", 3 * one.faces),
        )
    )
    error = max(_largest_change(total, a + b), _largest_change(triple, 3 * a))
    return error <= ROUNDING, f"{error:.1e} of the brightest, at most {ROUNDING:g}"


@_check("turns with light and surface")
def check_turns(method: Method) -> Measured:
    """Light and points turned by 90 degrees about x, y and z show the same; RMS change over the mean."""
    accurate, material, points, light = (
        _largest(method),
        _general_material(method),
        general_points(),
        spots(3),
    )
    image = Shader(accurate, light, material)(points)
    changes = {}
    for axis in range(3):
        turned_points = ShadingPoints(*(turn(v, axis) for v in (points.t, points.b, points.n, points.wo)))
        changes["xyz"[axis]] = _relative(Shader(accurate, turn_light(light, axis), material)(turned_points), image)
    worst = next((a for a, c in changes.items() if not np.isfinite(c)), max(changes, key=changes.__getitem__))
    bound = method.contract.turns
    return changes[worst] <= bound, f"{changes[worst]:.1e} of the mean about {worst}, at most {bound:g}"


@_check("converges")
def check_converges(method: Method, truth: Truth | None = None) -> Measured:
    """The fitted slope of log RMS over log samples against the reference."""
    contract = method.contract
    if contract.slope is None or contract.budget is None:
        return None, "not claimed"
    option, values = contract.budget
    if option not in option_names(type(method)):
        return False, f"the contract's budget is {option!r}, which is no option"
    truth = truth or truth_for(method)
    accurate = _accurate(method)
    samples, errors = [], []
    for value in values:
        budgeted = replace(accurate, **{option: value})
        image = Shader(budgeted, truth.light, truth.material)(truth.points)
        samples.append(budgeted.n_samples(truth.material))
        errors.append(_relative(image, truth.reference.radiance[0]))
        # Below twice the reference's own noise an error says nothing.
        if errors[-1] <= 2 * truth.reference.noise / truth.reference.mean:
            break
    if len(errors) == 1:
        return True, f"at the noise floor with {samples[0]} samples already"
    if len(set(samples)) == 1:
        return False, f"{samples[0]} samples whatever the budget"
    slope = float(np.polyfit([log(n) for n in samples], [log(e) for e in errors], 1)[0])
    span = f"error {errors[0]:.2g} with {samples[0]} samples, {errors[-1]:.2g} with {samples[-1]}"
    return slope <= contract.slope, f"slope {slope:.2f}, at most {contract.slope:g}; {span}"


@_check("finite on hard inputs")
def check_finite(method: Method) -> Measured:
    """Finite at grazing views, with the widest and narrowest lobes; exactly zero under a black map."""
    lights = {
        "a black map": CubeMap(torch.zeros(6, 16, 16, 3), "black"),
        "one lit texel": SingleTexel(resolution=16, radiance=(1e5, 1e5, 1e5)).cubemap(),
        "contrast 1e5": Spots(resolution=16, contrast=1e5).cubemap(),
    }
    points, n = hard_points(), 0
    for label, light in lights.items():
        for material in _supported(method, HARD_MATERIALS):
            image = Shader(method, light, material)(points)
            n_bad = int((~torch.isfinite(image)).any(-1).sum())
            if n_bad:
                return False, f"{n_bad} of {len(points)} points not finite: {label}, {_label(material)}"
            if not light.faces.any() and image.any():
                return False, f"{float(image.abs().max()):.1e} under a black map, {_label(material)}"
            n += 1
    return (True, f"{n} lights and materials") if n else (None, "none of the materials is supported")


@_check("same for any chunking")
def check_chunks(method: Method) -> Measured:
    """Points shaded in pieces of odd sizes are the points shaded at once."""
    return _in_pieces(method, [1, 2, 3, 7, 61, 5, 1])


@_check("batch is one by one")
def check_one_by_one(method: Method) -> Measured:
    """Points shaded singly are the points shaded at once."""
    return _in_pieces(method, [1] * 40)


def _in_pieces(method: Method, sizes: list[int]) -> Measured:
    """Pieces of these sizes against all points at once."""
    points = general_points(sum(sizes))
    shader = Shader(method, spots(3), _general_material(method))
    whole = shader(points)
    stops = np.cumsum(sizes).tolist()
    pieces = [shader(_slice(points, stop - size, stop)) for size, stop in zip(sizes, stops, strict=True)]
    error = _largest_change(torch.cat(pieces), whole)
    return error <= ROUNDING, f"{error:.1e} of the brightest, at most {ROUNDING:g}"


@_check("shape and type")
def check_shape(method: Method) -> Measured:
    """P points give (P, 3), float32."""
    shader = Shader(method, spots(3), _general_material(method))
    for n in (5, 1):
        image = shader(general_points(n))
        if not isinstance(image, Tensor):
            return False, f"{type(image).__name__} for ({n}, 3) float32"
        got = f"{tuple(image.shape)} {str(image.dtype).removeprefix('torch.')}"
        if got != f"({n}, 3) float32":
            return False, f"{got} for ({n}, 3) float32"
    return True, "(P, 3) float32"


@_check("pure")
def check_pure(method: Method) -> Measured:
    """The same call gives the same bytes, from the same stages and from new ones; nothing is written to."""
    material, points, light = _general_material(method), general_points(), spots(3)
    shader = Shader(method, light, material)
    images = [shader(points).clone(), shader(points).clone(), Shader(method, light, material)(points)]
    if not torch.equal(light.faces, spots(3).faces):
        return False, "writes into the light"
    for name, used, fresh in zip(
        "t b n wo".split(), vars(points).values(), vars(general_points()).values(), strict=True
    ):
        if not all(torch.equal(a, b) for a, b in zip(used, fresh, strict=True)):
            return False, f"writes into the points' {name}"
    for image, what in zip(images[1:], ("the same stages", "new stages"), strict=True):
        if not torch.equal(images[0], image):
            return False, f"{_largest_change(image, images[0]):.1e} of the brightest from {what}, must be 0"
    return True, "3 calls, the same bytes"


@_check("says what it cannot show")
def check_supports(method: Method) -> Measured:
    """`supports` gives None or a reason for any material and scene; what it supports, it can shade."""
    materials = [*_registered_materials(), *FURNACE_MATERIALS, *GENERAL_MATERIALS, *HARD_MATERIALS]
    reasons, n = [], 0
    for scene in (UnitSphere(), UnknownScene()):
        for material in materials:
            reason = method.supports(material, scene)
            if not (reason is None or (isinstance(reason, str) and reason.strip())):
                return False, f"{reason!r} for {_label(material)}, must be None or a reason"
            if reason is not None:
                reasons.append(reason)
            elif isinstance(scene, UnitSphere):
                Shader(method, spots(3), material)(general_points(3))
            n += 1
    return True, f"{n} combinations, {len(reasons)} unsupported" + (f": {reasons[0]}" if reasons else "")


CHECKS: tuple[Callable[..., Outcome], ...] = (
    check_furnace,
    check_linear,
    check_turns,
    check_converges,
    check_finite,
    check_chunks,
    check_one_by_one,
    check_shape,
    check_pure,
    check_supports,
)


def truth_for(method: Method) -> Truth:
    """The truth that convergence is measured against; its noise is at most 0.1 % of the mean."""
    light, material, points = spots(3), _general_material(method), general_points(100)
    return Truth(light, material, points, compute_reference(light, material, GivenPoints(points)))


def spots(seed: int) -> CubeMap:
    """Small lights, of moderate contrast, so that errors of a few samples are errors of all pixels."""
    return Spots(seed=seed, resolution=32, contrast=100.0).cubemap()


def general_points(n: int = 200) -> ShadingPoints:
    """Points all over the sphere, seen from all sides with cos_o in [0.05, 1], tangents turned anyhow."""
    u, v = points_2d(n, "r2").double(), points_2d(n, "random", seed=1).double()
    azimuth = 2 * pi * points_2d(n, "random", seed=2).double()[:, 0]
    normal = spherical(torch.acos(1 - 2 * u[:, 0]), 2 * pi * u[:, 1])
    return _points(normal, 0.05 + 0.95 * v[:, 0], 2 * pi * v[:, 1], azimuth)


def hard_points() -> ShadingPoints:
    """Normals to the faces, edges and corners of the cube, seen head-on, aslant and at cos_o = 1e-4."""
    signs = torch.cartesian_prod(*[torch.tensor([-1.0, 0.0, 1.0], dtype=torch.float64)] * 3)
    signs = signs[signs.any(1)].repeat(3, 1)
    n = len(signs) // 3
    cos_o = torch.tensor([1.0, 0.5, 1e-4], dtype=torch.float64).repeat_interleave(n)
    azimuth = torch.arange(3 * n, dtype=torch.float64)
    return _points(normalize(Vec3(*signs.T)), cos_o, torch.zeros(3 * n, dtype=torch.float64), azimuth)


def _points(n: Vec3, cos_o: Tensor, tangent: Tensor, azimuth: Tensor) -> ShadingPoints:
    upright = n.y.abs() > 0.9
    up = Vec3(upright.double(), (~upright).double(), torch.zeros_like(n.x))
    t = normalize(cross(up, n))
    t = to_world(spherical(torch.full_like(n.x, pi / 2), tangent), t, cross(n, t), n)
    b = cross(n, t)
    wo = to_world(spherical(torch.acos(cos_o), azimuth), t, b, n)
    return ShadingPoints(*(Vec3(*(c.float() for c in v)) for v in (t, b, n, wo)))


def turn(v: Vec3, axis: int) -> Vec3:
    """v turned by +90 degrees about a coordinate axis: exact, a permutation with one sign."""
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


def _slice(points: ShadingPoints, start: int, stop: int) -> ShadingPoints:
    return ShadingPoints(*(Vec3(*(c[start:stop] for c in v)) for v in vars(points).values()))


def _registered_materials() -> Iterator[Material]:
    for name in MATERIALS.names():
        try:
            yield MATERIALS.create(name, {})
        except InputError:
            continue  # needs options, such as a file


def _supported(method: Method, materials: tuple[Material, ...]) -> list[Material]:
    return [material for material in materials if method.supports(material, UnitSphere()) is None]


def _general_material(method: Method) -> Material:
    for material in _supported(method, GENERAL_MATERIALS):
        return material
    reason = method.supports(GENERAL_MATERIALS[0], UnitSphere())
    raise InputError(f"supports none of the {len(GENERAL_MATERIALS)} materials of the check: {reason}")


def _accurate(method: Method) -> Method:
    """The method with the options under which it promises accuracy."""
    return replace(method, **method.contract.options)


def _largest(method: Method) -> Method:
    """The method with the largest budget of its contract, or as it is where it has no budget."""
    budget = method.contract.budget
    if budget is None or budget[0] not in option_names(type(method)):
        return method
    return replace(method, **{budget[0]: max(budget[1])})


def _relative(image: Tensor, expected: Tensor) -> float:
    """RMS of the difference over the mean; 0 for two black images."""
    rms = float((image.double() - expected.double()).square().mean().sqrt())
    return rms / float(expected.double().mean()) if rms else 0.0


def _largest_change(image: Tensor, expected: Tensor) -> float:
    """The largest difference over the largest value; 0 for two black images."""
    change = float((image.double() - expected.double()).abs().max())
    return change / float(expected.abs().max()) if change else 0.0


def _label(material: Material) -> str:
    """A material in a few words: its name and its widths."""
    widths = material.as_dict().get("m") or material.as_dict().get("alpha") or ()
    return " ".join([material.name, *(f"{w:g}" for w in widths)])
