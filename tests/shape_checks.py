"""The shapes that signatures state, checked while tests run: which modules, and by what.

jaxtyping's import hook wraps every function of the modules; beartype compares what it is given and returns with its
annotations. Only annotations that name an array are compared: of the others mypy knows, and what a user may get wrong
the functions themselves refuse with an InputError, which tests want to see.
"""

import inspect
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any, get_args, get_origin

from beartype import beartype
from jaxtyping import AbstractArray, config, install_import_hook

MODULES = (
    "glossbench.brdf",
    "glossbench.channels",
    "glossbench.envmap.cubemap",
    "glossbench.envmap.pyramid",
    "glossbench.methods",
    "glossbench.metrics",
    "glossbench.scene.points",
    "glossbench.shading.kernels",
    "glossbench.shading.image",
    "glossbench.shading.visibility",
)


def install() -> None:
    """Check the modules from now on: those that are not yet imported."""
    install_import_hook(MODULES, f"{__name__}.arrays")


@contextmanager
def off() -> Iterator[None]:
    """No checks meanwhile."""
    before = config.jaxtyping_disable
    config.update("jaxtyping_disable", True)
    try:
        yield
    finally:
        config.update("jaxtyping_disable", before)


def arrays(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, checked where its annotations name an array.

    jaxtyping has two made of a signature: one for before the call, which returns Any, and one for after it, which would
    compare the arguments a second time.
    """
    hints = dict(function.__annotations__)
    result = hints.get("return", Any)
    compared = hints if result is Any else {"return": result}
    function.__annotations__ = {name: hint for name, hint in compared.items() if _is_compared(hint)}
    return beartype(function) if function.__annotations__ else function


def _is_compared(hint: Any) -> bool:
    """Whether a hint names an array, and no list of them: of a list beartype picks one by Python's random numbers."""
    return _names_an_array(hint) and not _has_list(hint)


def _names_an_array(hint: Any) -> bool:
    if inspect.isclass(hint) and issubclass(hint, AbstractArray):
        return True
    return any(_names_an_array(part) for part in get_args(hint))


def _has_list(hint: Any) -> bool:
    origin = get_origin(hint)
    is_list = inspect.isclass(origin) and issubclass(origin, Collection)
    return (is_list and not (origin is tuple and ... not in get_args(hint))) or any(map(_has_list, get_args(hint)))
