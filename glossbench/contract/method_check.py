"""Measure whether a method keeps the contract, as `glossbench check-method` does for any plug-in."""

from collections.abc import Callable
from dataclasses import replace

from glossbench.contract.checks import (
    Outcome,
    check_chunks,
    check_converges,
    check_finite,
    check_furnace,
    check_linear,
    check_one_by_one,
    check_pure,
    check_shape,
    check_supports,
    check_turns,
)
from glossbench.errors import InputError, suggest_nearest
from glossbench.plugin_errors import summarize_error
from glossbench.plugins import NoSuchModule, import_plugin
from glossbench.process.state import ProcessRestorer, guarded
from glossbench.process.surroundings import settled
from glossbench.shading.method import METHODS, Method
from glossbench.shading.stage_cache import StageCache

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


@settled()
def check_contract(name: str, tell: Callable[[str], None] = lambda text: None) -> list[Outcome]:
    """All checks of a registered method, or of each method that an importable module registers.

    Args:
        tell: called with the name of each check before it runs.

    Raises:
        InputError: the method or module does not exist, the module registers no method, or an option has no default.
    """
    methods = _make_methods(name)
    outcomes = []
    for method in methods:
        prefix, kept = f"{method.name}: " if len(methods) > 1 else "", StageCache()
        for check in CHECKS:
            tell(f"{method.name}: {check.__name__.removeprefix('check_').replace('_', ' ')}")
            with guarded(type(method)):
                outcome = check(method, kept)
            outcomes.append(replace(outcome, check=prefix + outcome.check))
    return outcomes


def as_checked(name: str) -> Method:
    """A registered method with the options that its contract states for the checks."""
    return METHODS.create(name, METHODS.get(name).contract.quick)


def _make_methods(name: str) -> list[Method]:
    if name in METHODS.names():
        return [as_checked(name)]
    try:
        with ProcessRestorer(f"plugin {name!r}"):
            import_plugin(name)
    except NoSuchModule as error:
        hint = suggest_nearest(name, METHODS.names())
        where = hint if "did you mean" in hint else f": {error}"
        raise InputError(f"{name!r} is neither a method nor a module{where}") from None
    except (Exception, SystemExit) as error:  # a plug-in may raise anything
        told = str(error) if isinstance(error, InputError) else summarize_error(error)
        raise InputError(f"module {name!r}: {told}") from error
    classes = [METHODS.get(n) for n in METHODS.names()]
    own = [as_checked(cls.name) for cls in classes if cls.__module__ == name]
    if not own:
        raise InputError(f"module {name!r} registers no method")
    return own
