"""Running a method: its stages, if they are not in the cache, and then its shade, timed and checked."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from jaxtyping import Shaped
from torch import Tensor

from glossbench.brdf.material import Material
from glossbench.envmap.cubemap import CubeMap
from glossbench.errors import InputError, MethodError, check_call
from glossbench.process.surroundings import settled
from glossbench.scene.points import ShadingPoints, View, image_of
from glossbench.shading.costs import Costs, time_work
from glossbench.shading.kernels.backend import noting
from glossbench.shading.method import CHANGES, INPUTS, Method, find_dependencies, order_stages
from glossbench.shading.outputs import check_count, check_pictures, check_reason
from glossbench.shading.stage_cache import PreparedStage, StageCache, forbid_writes
from glossbench.shapes import Mask, Picture, Radiance


@dataclass(frozen=True)
class Image:
    """The result of a method.

    Attributes:
        radiance: zero outside the mask.
        mask: true where the surface is visible.
        costs: seconds and bytes.
        pictures: pictures of the method's state, by name.
        kernels: how each kernel that shade called ran, "eager" or "compiled", by name.
    """

    radiance: Picture
    mask: Mask
    costs: Costs = field(default_factory=Costs)
    pictures: Mapping[str, Shaped[Tensor, "_ _ 3"]] = field(default_factory=dict)
    kernels: Mapping[str, str] = field(default_factory=dict)


@settled()
def shade(
    method: Method,
    light: CubeMap,
    material: Material,
    view: View,
    *,
    cache: StageCache | None = None,
    time_it: bool = True,
) -> Image:
    """The image of a material under a light by a method.

    Args:
        cache: stages of earlier calls, which this call shares; by default none.
        time_it: run shade again, so that its time does not include a cold start.

    Raises:
        InputError: the method does not support the combination.
        MethodError: the method returned a wrong shape, dtype or device, or radiance that is not finite; or it wrote
            into a tensor that it was given; or another of its results is wrong.
    """
    check_call(
        "shade", method=(method, Method), light=(light, CubeMap), material=(material, Material), view=(view, View)
    )
    reason = check_reason(method.name, method.supports(material, view.scene()))
    if reason:
        raise InputError(f"{method.name} cannot show this: {reason}")
    cache = StageCache() if cache is None else cache
    device = str(light.faces.device)
    inputs = {"light": light, "material": material, "scene": view.scene(), "view": view}
    patience = 0.2 if time_it else 0.0
    prepared = prepare(method, inputs, cache, patience)
    points = view.points().to(device)
    known = inputs | {"points": points} | {name: p.value for name, p in prepared.items()}
    state = select_arguments(method.shade, known)
    with forbid_writes(f"{method.name}.shade", state), noting() as kernels:
        values, timing = time_work(lambda: method.shade(**state), device, patience)
    mask = view.mask()
    depends = find_dependencies(order_stages(type(method)))
    costs = method.stated_costs() or Costs(
        stage_seconds={name: p.seconds for name, p in prepared.items()},
        update_seconds={
            change: sum(p.seconds for name, p in prepared.items() if source in depends[name])
            for change, source in CHANGES.items()
        },
        shade=timing,
        state_bytes=sum(p.n_bytes for p in prepared.values()),
        n_samples=check_count(method.name, method.n_samples(material)),
    )
    pictures: Mapping[str, Tensor] = {}
    if method.pictures is not None and time_it:
        pictures = check_pictures(method.name, method.pictures(**select_arguments(method.pictures, known)))
    return Image(image_of(mask, _check_radiance(method, points, values)), mask, costs, pictures, kernels)


def prepare(
    method: Method, inputs: Mapping[str, Any], cache: StageCache, patience: float = 0.0
) -> dict[str, PreparedStage]:
    """The stages of a method, from the cache if it has them, otherwise computed.

    Args:
        inputs: light, material, scene and view.
        patience: seconds for which the runs of a stage are repeated to measure its time.
    """
    light = inputs["light"]
    device = str(light.faces.device)
    cache.begin()
    keys: dict[str, Any] = {**inputs, "light": (light.key, light.resolution, device)}
    prepared: dict[str, PreparedStage] = {}
    for name, current in order_stages(type(method)).items():
        values = {n: inputs[n] if n in INPUTS else prepared[n].value for n in current.needs}
        names = tuple(keys[n] for n in current.needs)
        prepared[name] = cache.get(current.function, method, values, names, device, patience)
        keys[name] = prepared[name].key
    return prepared


def select_arguments(function: Callable[..., Any], known: Mapping[str, Any]) -> dict[str, Any]:
    """The known values that a function has as parameters, by name."""
    return {name: known[name] for name in inspect.signature(function).parameters}


def _check_radiance(method: Method, points: ShadingPoints, values: Any) -> Radiance:
    """The radiance that a method returned, or MethodError."""
    if not isinstance(values, Tensor):
        raise MethodError(f"{method.name}.shade must return a tensor, got {type(values).__name__}")
    if tuple(values.shape) != (len(points), 3) or values.dtype != torch.float32:
        got = f"{tuple(values.shape)} {str(values.dtype).removeprefix('torch.')}"
        raise MethodError(f"{method.name}.shade must return ({len(points)}, 3) float32, got {got}")
    if values.device.type != points.n.x.device.type:
        raise MethodError(f"{method.name}.shade must return a tensor on {points.device}, got {values.device}")
    bad = ~torch.isfinite(values).all(dim=1)
    if bad.any():
        first = int(bad.nonzero()[0])
        n = [round(float(c[first]), 4) for c in points.n]
        raise MethodError(
            f"{method.name}.shade: {int(bad.sum())} points are not finite, the first where the normal is {n}"
        )
    return values.detach()
