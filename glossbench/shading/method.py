"""The shade interface: a method is options, stages of precomputation, and shade.

A stage is a function of a method whose parameter names say what it needs: `light` (CubeMap), `material`, `scene`,
`view`, or an earlier stage. From the names the framework derives the order of the stages, what is shared between
methods and budgets, and what must be redone when the light, the material, the geometry or the view changes.
"""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic, TypeVar

import torch
from torch import Tensor

from glossbench.brdf.material import Material
from glossbench.catalog.naming import kind_in_catalog
from glossbench.envmap.cubemap import CubeMap
from glossbench.errors import InputError, MethodError, check_call
from glossbench.options import Options, option_names
from glossbench.process.surroundings import settled
from glossbench.registry import Registry
from glossbench.scene.points import ShadingPoints, View, image_of
from glossbench.shading.costs import Costs, timed
from glossbench.shading.outputs import count_of, pictures_of, reason_of
from glossbench.shading.stage_cache import Prepared, StageCache, unwritten

INPUTS = ("light", "material", "scene", "view")
# What an artist or a game changes -> the input that is then new. A view change leaves the geometry as it is.
CHANGES = {"light": "light", "material": "material", "geometry": "scene", "view": "view"}


T = TypeVar("T")


class Stage(Generic[T]):
    """One step of precomputation: a function (self, *inputs) -> T of a method.

    The same Stage may serve several methods.
    """

    def __init__(self, function: Callable[..., T]) -> None:
        self.function = function
        self.needs = tuple(inspect.signature(function).parameters)[1:]
        self.__doc__ = function.__doc__


def stage(function: Callable[..., T]) -> Stage[T]:
    """Decorator: this function of a method is a stage; its parameter names say what it depends on."""
    return Stage(function)


@dataclass(frozen=True)
class Contract:
    """What a method promises, checked by `glossbench check-method`.

    Attributes:
        furnace: largest RMS error over the mean under constant light, at the largest budget, of any material.
        linear: the image of a sum of lights is the sum of their images.
        turns: largest RMS change over the mean when light and surface turn by 90 degrees, with all budget.
        budget: the option that buys accuracy, and values to try; None where there is none. Claims and plots compare
            methods at equal budgets, whatever their options are called.
        slope: largest fitted slope of log RMS over log samples; None where no convergence is claimed.
        options: under which furnace and slope hold, where the defaults cut off what no budget brings back.
        quick: options of all checks where the defaults take minutes.
    """

    furnace: float = 0.02
    linear: bool = True
    turns: float = 1e-5  # measured 2e-6 where only rounding is left
    budget: tuple[str, tuple[int, ...]] | None = None
    slope: float | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    quick: Mapping[str, Any] = field(default_factory=dict)


class Method(Options):
    """A way to shade glossy surfaces under an environment map.

    Subclasses state options as annotated attributes, stages with `@stage`, and
    shade(self, points, material, <stages by name>) -> radiance (P, 3), float32.

    Attributes:
        equation: what shade computes, in typst's notation of mathematics, for reports to set; the docstring begins with
            the same in plain letters.
    """

    equation: ClassVar[str] = ""
    contract: ClassVar[Contract] = Contract()

    @property
    def is_random(self) -> bool:
        """Whether its option `seed` moves what it shows; by default where it has one."""
        return "seed" in option_names(type(self))

    def supports(self, material: Material, scene: Any) -> str | None:
        """Why this method cannot show this material on this scene; None when it can."""
        return None

    def n_samples(self, material: Material) -> int:
        """Light samples that a pixel takes: by default the budget, 1 where there is none; a pattern may not meet it."""
        value = getattr(self, budget_of(type(self)), 1)
        return value if isinstance(value, int) else 1

    def half_vectors(self, material: Material) -> Tensor | None:
        """The half vectors (N, 2), theta and phi, that every pixel uses for the first lobe; None if there are none."""
        return None

    shade: ClassVar[Callable[..., Tensor]]
    # pictures(self, <stages by name>) -> {name: (H, W, 3)}: what of its state is worth looking at, for reports.
    pictures: ClassVar[Callable[..., Mapping[str, Tensor]] | None] = None


def budget_of(method: type[Method]) -> str:
    """Name of the option that is a method's budget, as its contract says; empty where there is none."""
    option = method.contract.budget[0] if method.contract.budget else ""
    return option if option in option_names(method) else ""


METHODS: Registry[Method] = Registry("method", "glossbench.methods", "glossbench.methods", kind_in_catalog)


def stated_stages(method: type[Method]) -> dict[str, Stage[Any]]:
    """The stages of a method in the order of its source."""
    members = {name: value for cls in reversed(method.__mro__) for name, value in vars(cls).items()}
    return {name: value for name, value in members.items() if isinstance(value, Stage)}


def stages_of(method: type[Method]) -> dict[str, Stage[Any]]:
    """The stages of a method in the order in which they must run; InputError for a parameter that nothing provides."""
    pending = stated_stages(method)
    if not hasattr(method, "shade"):
        raise InputError(f"{method.__name__} has no shade(self, points, material, ...)")
    known = set(INPUTS) | set(pending)
    users = [*pending.items(), ("shade", Stage(method.shade))]
    for name, user in users:
        for needed in user.needs:
            if needed not in known | ({"points"} if name == "shade" else set()):
                raise InputError(f"{method.__name__}.{name} asks for {needed!r}: no input and no stage has that name")
    order: dict[str, Stage[Any]] = {}
    while pending:
        ready = [name for name, value in pending.items() if all(n in order or n in INPUTS for n in value.needs)]
        if not ready:
            raise InputError(f"{method.__name__}: the stages {', '.join(pending)} wait for each other")
        for name in ready:
            order[name] = pending.pop(name)
    return order


def dependencies(stages: Mapping[str, Stage[Any]]) -> dict[str, frozenset[str]]:
    """The inputs that each stage depends on, itself or through earlier stages."""
    found: dict[str, frozenset[str]] = {}
    for name, value in stages.items():
        found[name] = frozenset().union(*(found.get(n, frozenset({n})) for n in value.needs))
    return found


@dataclass(frozen=True)
class Image:
    """What a method shows.

    Attributes:
        radiance: (H, W, 3), float32, zero outside the mask.
        mask: (H, W), true where the surface is seen.
        costs: seconds and bytes.
        pictures: of the method's state, (H, W, 3) by name.
    """

    radiance: Tensor
    mask: Tensor
    costs: Costs = field(default_factory=Costs)
    pictures: Mapping[str, Tensor] = field(default_factory=dict)


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
        cache: stages of earlier calls, to be shared; by default none.
        time_it: run shade again, so that its time is a warm one.

    Raises:
        InputError: the method does not support the combination.
        MethodError: the method returned the wrong shape, dtype or device, or radiance that is not finite, or wrote
            into a tensor that it was given; or what else it returned is not what it must be.
    """
    check_call(
        "shade", method=(method, Method), light=(light, CubeMap), material=(material, Material), view=(view, View)
    )
    reason = reason_of(method.name, method.supports(material, view.scene()))
    if reason:
        raise InputError(f"{method.name} cannot show this: {reason}")
    cache = StageCache() if cache is None else cache
    device = str(light.faces.device)
    inputs = {"light": light, "material": material, "scene": view.scene(), "view": view}
    patience = 0.2 if time_it else 0.0
    prepared = prepare(method, inputs, cache, patience)
    points = view.points().to(device)
    known = inputs | {"points": points} | {name: p.value for name, p in prepared.items()}
    state = {n: known[n] for n in inspect.signature(method.shade).parameters}
    with unwritten(f"{method.name}.shade", state):
        values, timing = timed(lambda: method.shade(**state), device, patience)
    mask = view.mask()
    depends = dependencies(stages_of(type(method)))
    costs = Costs(
        stage_seconds={name: p.seconds for name, p in prepared.items()},
        update_seconds={
            change: sum(p.seconds for name, p in prepared.items() if source in depends[name])
            for change, source in CHANGES.items()
        },
        shade=timing,
        state_bytes=sum(p.n_bytes for p in prepared.values()),
        n_samples=count_of(method.name, method.n_samples(material)),
    )
    pictures: Mapping[str, Tensor] = {}
    if method.pictures is not None and time_it:
        needed = inspect.signature(method.pictures).parameters
        pictures = pictures_of(method.name, method.pictures(**{n: known[n] for n in needed}))
    return Image(image_of(mask, _checked(method, points, values)), mask, costs, pictures)


def prepare(method: Method, inputs: Mapping[str, Any], cache: StageCache, patience: float = 0.0) -> dict[str, Prepared]:
    """The stages of a method, those that the cache has taken from there, the others computed.

    Args:
        inputs: light, material, scene and view.
        patience: seconds for which a stage is run again to be timed.
    """
    light = inputs["light"]
    device = str(light.faces.device)
    cache.begin()
    keys: dict[str, Any] = {**inputs, "light": (light.key, light.resolution, device)}
    prepared: dict[str, Prepared] = {}
    for name, current in stages_of(type(method)).items():
        values = {n: inputs[n] if n in INPUTS else prepared[n].value for n in current.needs}
        names = tuple(keys[n] for n in current.needs)
        prepared[name] = cache.get(current.function, method, values, names, device, patience)
        keys[name] = prepared[name].key
    return prepared


def _checked(method: Method, points: ShadingPoints, values: Any) -> Tensor:
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
