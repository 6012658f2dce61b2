"""The shade interface: a method is options, stages of precomputation, and shade.

A stage is a function of a method whose parameter names say what it needs: `light` (CubeMap), `material`, `scene`,
`view`, or an earlier stage. From these names the framework derives the order of the stages, the values that methods and
budgets share, and the stages to compute again when the light, the material, the geometry or the view changes.
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic, TypeVar

from jaxtyping import Float
from torch import Tensor

from glossbench.brdf.material import Material
from glossbench.catalog.naming import explain_catalog_name
from glossbench.errors import InputError
from glossbench.options import Options, list_options
from glossbench.registry import Registry
from glossbench.scene.points import View
from glossbench.shading.costs import Costs
from glossbench.shapes import Radiance

INPUTS = ("light", "material", "scene", "view")
# A change by an artist or a game -> the input that it replaces. A change of the view does not change the geometry.
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
    """The properties that a method promises. `glossbench check-method` tests them.

    Attributes:
        furnace: largest ratio of RMS error to mean under constant light, at the largest budget, for any material.
        linear: whether the image of a sum of lights is the sum of their images.
        turns: largest ratio of RMS change to mean when light and surface turn by 90 degrees, at the largest budget.
        budget: the option that increases accuracy, and values to try; None if there is no such option. Claims and plots
            compare methods at equal budgets, whatever the names of the options are.
        slope: largest fitted slope of log RMS over log samples; None if the method does not claim to converge.
        options: options under which furnace and slope hold, if the defaults cause an error that a larger budget does
            not reduce.
        quick: options for all checks, if the defaults take minutes.
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
        equation: the formula that shade computes, in the mathematical notation of typst, for reports; the docstring
            begins with the same formula in plain text.
    """

    equation: ClassVar[str] = ""
    contract: ClassVar[Contract] = Contract()

    @property
    def is_random(self) -> bool:
        """Whether the option `seed` changes the image; by default true if the method has this option."""
        return "seed" in list_options(type(self))

    def supports(self, material: Material, scene: Any) -> str | None:
        """The reason why this method cannot show this material on this scene; None if it can."""
        return None

    def n_samples(self, material: Material) -> int:
        """Light samples per pixel: by default the budget, or 1 without one; a fixed pattern may use another number."""
        value = getattr(self, find_budget_option(type(self)), 1)
        return value if isinstance(value, int) else 1

    def half_vectors(self, material: Material) -> Float[Tensor, "samples 2"] | None:
        """The half vectors, theta and phi, that every pixel uses for the first lobe; None if the method has none."""
        return None

    def check_views(self, views: Sequence[View]) -> None:
        """Raise InputError if it cannot make the images of these views, one for each of its cells.

        A run calls it before it begins.
        """

    def stated_costs(self) -> Costs | None:
        """The costs of an image that is not computed here, as its author states them; None to measure them."""
        return None

    shade: ClassVar[Callable[..., Radiance]]
    # pictures(self, <stages by name>) -> {name: (H, W, 3)}: images of its state for reports, such as filtered maps.
    pictures: ClassVar[Callable[..., Mapping[str, Tensor]] | None] = None


def find_budget_option(method: type[Method]) -> str:
    """Name of the option that is a method's budget, according to its contract; empty if there is none."""
    option = method.contract.budget[0] if method.contract.budget else ""
    return option if option in list_options(method) else ""


METHODS: Registry[Method] = Registry("method", "glossbench.methods", "glossbench.methods", explain_catalog_name)


def find_stages(method: type[Method]) -> dict[str, Stage[Any]]:
    """The stages of a method in the order of its source."""
    members = {name: value for cls in reversed(method.__mro__) for name, value in vars(cls).items()}
    return {name: value for name, value in members.items() if isinstance(value, Stage)}


def order_stages(method: type[Method]) -> dict[str, Stage[Any]]:
    """The stages of a method in the order in which they must run.

    Raises:
        InputError: a parameter is neither an input nor a stage, or stages need each other in a circle.
    """
    pending = find_stages(method)
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


def find_dependencies(stages: Mapping[str, Stage[Any]]) -> dict[str, frozenset[str]]:
    """The inputs that each stage depends on, directly or through earlier stages."""
    found: dict[str, frozenset[str]] = {}
    for name, value in stages.items():
        found[name] = frozenset().union(*(found.get(n, frozenset({n})) for n in value.needs))
    return found
