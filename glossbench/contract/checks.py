"""The checks of the contract that every method keeps.

Each check applies a method to a case with a known answer, and returns an Outcome. The `Contract` of a method states
what it promises, and how closely. The checks that hold for every method (finite, pure, the same for any chunking) need
no promise. If a method raises, the check that called it is broken.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import wraps
from math import log
from typing import Any

import numpy as np
import torch
from torch import Tensor

from glossbench.contract.cases import (
    FURNACE_MATERIALS,
    GENERAL_MATERIALS,
    HARD_MATERIALS,
    Shader,
    Truth,
    UnknownScene,
    build_general_points,
    build_hard_points,
    build_spots,
    build_truth,
    choose_material,
    compute_albedo,
    label_material,
    make_accurate,
    make_registered_materials,
    select_points,
    select_supported,
    turn,
    turn_light,
    with_all_budget,
)
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.lights.synthetic import Constant, SingleTexel, Spots
from glossbench.plugin_errors import locate_error, summarize_error
from glossbench.scene.points import ShadingPoints
from glossbench.scene.sphere import UnitSphere
from glossbench.shading.method import Method, find_budget_option
from glossbench.shading.stage_cache import StageCache

Measured = tuple[bool | None, str]  # (kept, measured) of an Outcome

# Allows for float32 sums in another order. Measured with the methods here, as largest change / largest radiance:
# 5e-7 for a sum of lights, and 0 for pieces of odd sizes and single points.
ROUNDING = 1e-5


@dataclass(frozen=True)
class Outcome:
    """The outcome of a check.

    Attributes:
        check: name of the check.
        kept: whether the promise is kept; None if nothing is promised, or the check does not apply.
        measured: the number and its bound, in one line.
        where: FILE:LINE of the plug-in, if it raised.
    """

    check: str
    kept: bool | None
    measured: str
    where: str = field(default="", compare=False)


def _check(name: str) -> Callable[[Callable[..., Measured]], Callable[..., Outcome]]:
    """Decorator that turns (kept, measured) into an Outcome, and an exception into a broken Outcome.

    A check may be given stages that other checks of the method computed.
    """

    def decorate(function: Callable[..., Measured]) -> Callable[..., Outcome]:
        @wraps(function)
        def run(method: Method, kept: StageCache | None = None, **others: Any) -> Outcome:
            try:
                return Outcome(name, *function(method, kept or StageCache(), **others))
            except (Exception, SystemExit) as error:  # a plug-in may raise anything
                return Outcome(name, False, summarize_error(error), locate_error(error))

        return run

    return decorate


@_check("furnace")
def check_furnace(method: Method, kept: StageCache) -> Measured:
    """Under constant light, the image is the light times the directional albedo; RMS error / mean, worst material."""
    accurate, points, light = (
        with_all_budget(make_accurate(method)),
        build_general_points(),
        Constant(radiance=(2.5, 2.5, 2.5)).cubemap(),
    )
    errors = {}
    for material in select_supported(method, FURNACE_MATERIALS):
        expected = 2.5 * compute_albedo(material)
        errors[label_material(material)] = _compute_relative_error(
            Shader(accurate, light, material, kept)(points), expected
        )
    if not errors:
        return None, "none of the materials is supported"
    # max() of a NaN and a number may return either.
    worst = next((m for m, e in errors.items() if not np.isfinite(e)), max(errors, key=errors.__getitem__))
    bound = method.contract.furnace
    return errors[
        worst
    ] <= bound, f"{errors[worst]:.1e} of the mean with {worst}, at most {bound:g}{_describe_conditions(method)}"


@_check("linear in the light")
def check_linear(method: Method, kept: StageCache) -> Measured:
    """The image of a sum of lights is the sum of their images; three times the light gives three times the image."""
    if not method.contract.linear:
        return None, "not claimed"
    material, points = choose_material(method), build_general_points()
    one, two = build_spots(3), build_spots(4)
    a, b, total, triple = (
        Shader(method, CubeMap(faces, key), material, kept)(points).double()
        for key, faces in (
            ("one", one.faces),
            ("two", two.faces),
            ("sum", one.faces + two.faces),
            ("triple", 3 * one.faces),
        )
    )
    error = max(_compute_largest_change(total, a + b), _compute_largest_change(triple, 3 * a))
    return error <= ROUNDING, f"{error:.1e} of the brightest, at most {ROUNDING:g}"


@_check("turns with light and surface")
def check_turns(method: Method, kept: StageCache) -> Measured:
    """Light and points turned by 90 degrees about x, y and z give the same image; RMS change / mean."""
    accurate, material, points, light = (
        with_all_budget(method),
        choose_material(method),
        build_general_points(),
        build_spots(3),
    )
    image = Shader(accurate, light, material, kept)(points)
    changes = {}
    for axis in range(3):
        turned_points = ShadingPoints(*(turn(v, axis) for v in (points.t, points.b, points.n, points.wo)))
        changes["xyz"[axis]] = _compute_relative_error(
            Shader(accurate, turn_light(light, axis), material, kept)(turned_points), image
        )
    worst = next((a for a, c in changes.items() if not np.isfinite(c)), max(changes, key=changes.__getitem__))
    bound = method.contract.turns
    return changes[worst] <= bound, f"{changes[worst]:.1e} of the mean about {worst}, at most {bound:g}"


@_check("converges")
def check_converges(method: Method, kept: StageCache, truth: Truth | None = None) -> Measured:
    """The fitted slope of log(RMS error against the reference) over log(samples)."""
    contract = method.contract
    if contract.slope is None or contract.budget is None:
        return None, "not claimed"
    option, values = contract.budget
    if not find_budget_option(type(method)):
        return False, f"the contract's budget is {option!r}, which is not an option"
    truth = truth or build_truth(method)
    accurate = make_accurate(method)
    samples, errors = [], []
    for value in values:
        budgeted = replace(accurate, **{option: value})
        image = Shader(budgeted, truth.light, truth.material, kept)(truth.points)
        samples.append(budgeted.n_samples(truth.material))
        errors.append(_compute_relative_error(image, truth.reference.radiance[0]))
        # Below twice the noise of the reference, an error cannot be measured.
        if errors[-1] <= 2 * truth.reference.noise / truth.reference.mean:
            break
    if len(errors) == 1:
        return True, f"at the noise floor with {samples[0]} samples already"
    if len(set(samples)) == 1:
        return False, f"{samples[0]} samples at every budget"
    slope = float(np.polyfit([log(n) for n in samples], [log(e) for e in errors], 1)[0])
    span = f"error {errors[0]:.2g} with {samples[0]} samples, {errors[-1]:.2g} with {samples[-1]}"
    return (
        slope <= contract.slope,
        f"slope {slope:.2f}, at most {contract.slope:g}; {span}{_describe_conditions(method)}",
    )


@_check("finite on hard inputs")
def check_finite(method: Method, kept: StageCache) -> Measured:
    """The image is finite at grazing views, with the widest and narrowest lobes, and exactly zero under a black map."""
    lights = {
        "a black map": CubeMap(torch.zeros(6, 16, 16, 3), "black"),
        "one lit texel": SingleTexel(resolution=16, radiance=(1e5, 1e5, 1e5)).cubemap(),
        "contrast 1e5": Spots(resolution=16, contrast=1e5).cubemap(),
    }
    points, n = build_hard_points(), 0
    for label, light in lights.items():
        for material in select_supported(method, HARD_MATERIALS):
            image = Shader(method, light, material, kept)(points)
            n_bad = int((~torch.isfinite(image)).any(-1).sum())
            if n_bad:
                return False, f"{n_bad} of {len(points)} points not finite: {label}, {label_material(material)}"
            if not light.faces.any() and image.any():
                return False, f"{float(image.abs().max()):.1e} under a black map, {label_material(material)}"
            n += 1
    return (True, f"{n} lights and materials") if n else (None, "none of the materials is supported")


@_check("same for any chunking")
def check_chunks(method: Method, kept: StageCache) -> Measured:
    """Points shaded in pieces of odd sizes have the same radiance as points shaded at once."""
    return _shade_in_pieces(method, kept, [1, 2, 3, 7, 61, 5, 1])


@_check("batch is one by one")
def check_one_by_one(method: Method, kept: StageCache) -> Measured:
    """Points shaded one by one have the same radiance as points shaded at once."""
    return _shade_in_pieces(method, kept, [1] * 40)


def _shade_in_pieces(method: Method, kept: StageCache, sizes: list[int]) -> Measured:
    """Compare points shaded in pieces of these sizes with all points shaded at once."""
    points = build_general_points(sum(sizes))
    shader = Shader(method, build_spots(3), choose_material(method), kept)
    whole = shader(points)
    stops = np.cumsum(sizes).tolist()
    pieces = [shader(select_points(points, stop - size, stop)) for size, stop in zip(sizes, stops, strict=True)]
    error = _compute_largest_change(torch.cat(pieces), whole)
    return error <= ROUNDING, f"{error:.1e} of the brightest, at most {ROUNDING:g}"


@_check("shape and type")
def check_shape(method: Method, kept: StageCache) -> Measured:
    """P points give radiance of shape (P, 3), float32."""
    shader = Shader(method, build_spots(3), choose_material(method), kept)
    for n in (5, 1):
        image = shader(build_general_points(n))
        if not isinstance(image, Tensor):
            return False, f"{type(image).__name__} for ({n}, 3) float32"
        got = f"{tuple(image.shape)} {str(image.dtype).removeprefix('torch.')}"
        if got != f"({n}, 3) float32":
            return False, f"{got} for ({n}, 3) float32"
    return True, "(P, 3) float32"


@_check("pure")
def check_pure(method: Method, kept: StageCache) -> Measured:
    """The same call gives the same bytes, with the same stages and with new ones, and writes into no argument."""
    material, points, light = choose_material(method), build_general_points(), build_spots(3)
    shader = Shader(method, light, material, kept)
    images = [shader(points).clone(), shader(points).clone(), Shader(method, light, material)(points)]
    if not torch.equal(light.faces, build_spots(3).faces):
        return False, "writes into the light"
    fresh_points = build_general_points()
    for name in ("t", "b", "n", "wo"):
        used, fresh = getattr(points, name), getattr(fresh_points, name)
        if not all(torch.equal(a, b) for a, b in zip(used, fresh, strict=True)):
            return False, f"writes into the points' {name}"
    for image, what in zip(images[1:], ("the same stages", "new stages"), strict=True):
        if not torch.equal(images[0], image):
            return False, f"{_compute_largest_change(image, images[0]):.1e} of the brightest from {what}, must be 0"
    return True, "3 calls, the same bytes"


@_check("says what it cannot show")
def check_supports(method: Method, kept: StageCache) -> Measured:
    """`supports` returns None or a reason for any material and scene, and the method can shade what it supports."""
    materials = [*make_registered_materials(), *FURNACE_MATERIALS, *GENERAL_MATERIALS, *HARD_MATERIALS]
    reasons, n, light = [], 0, Constant(resolution=8).cubemap()  # small, as there are many stages to make
    for scene in (UnitSphere(), UnknownScene()):
        for material in materials:
            reason = method.supports(material, scene)
            if not (reason is None or (isinstance(reason, str) and reason.strip())):
                return False, f"{reason!r} for {label_material(material)}, must be None or a reason"
            if reason is not None:
                reasons.append(reason)
            elif isinstance(scene, UnitSphere):
                Shader(method, light, material, kept)(build_general_points(3))
            n += 1
    return True, f"{n} combinations, {len(reasons)} unsupported" + (f": {reasons[0]}" if reasons else "")


def _compute_relative_error(image: Tensor, expected: Tensor) -> float:
    """RMS of the difference / mean; 0 for two black images."""
    rms = float((image.double() - expected.double()).square().mean().sqrt())
    return rms / float(expected.double().mean()) if rms else 0.0


def _compute_largest_change(image: Tensor, expected: Tensor) -> float:
    """Largest difference / largest value; 0 for two black images."""
    change = float((image.double() - expected.double()).abs().max())
    return change / float(expected.abs().max()) if change else 0.0


def _describe_conditions(method: Method) -> str:
    """The options that the contract states, in words; "" if it states none."""
    options = ", ".join(f"{key}={value}" for key, value in method.contract.options.items())
    return f"; with {options}" if options else ""
