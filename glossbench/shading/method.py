"""The shade interface: a method is options, stages of precomputation, and shade.

A stage is a function of a method whose parameter names say what it needs: `light` (CubeMap), `material`, `scene`,
`view`, or an earlier stage. From the names the framework derives the order of the stages, what is shared between
methods and budgets, and what must be redone when the light, the material, the geometry or the view changes.
"""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic, TypeVar

from jaxtyping import Float
from torch import Tensor

from glossbench.brdf.material import Material
from glossbench.catalog.naming import kind_in_catalog
from glossbench.errors import InputError
from glossbench.options import Options, option_names
from glossbench.registry import Registry
from glossbench.shapes import Radiance

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

    def half_vectors(self, material: Material) -> Float[Tensor, "samples 2"] | None:
        """The half vectors, theta and phi, that every pixel uses for the first lobe; None if there are none."""
        return None

    shade: ClassVar[Callable[..., Radiance]]
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
