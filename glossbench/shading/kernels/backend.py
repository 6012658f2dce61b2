"""The one place that chooses how a kernel runs: eagerly, or compiled.

A compiled kernel is a shared library in the user's cache folder (artefacts.py). It serves all numbers of points,
samples, texels and levels, and is loaded in a millisecond. By default a kernel runs compiled if it is in the cache, or
if the call is so much work that compiling it pays. A run of a study chooses by its plan (glossbench/run), and a
function that measures or tests can force either.
"""

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor

from glossbench.directions import Vec3
from glossbench.shading.kernels import artefacts
from glossbench.shading.kernels.arguments import NotFlat, flatten, has_scene, scene_in
from glossbench.shading.kernels.artefacts import Artefact
from glossbench.shading.kernels.build import Call, build, compile_seconds, failed, has_compiler
from glossbench.shading.kernels.kernel import Kernel
from glossbench.shading.kernels.programs import Part, program
from glossbench.shading.visibility import Question, answer

EAGER, COMPILED = "eager", "compiled"
EAGER_RATE = 8e6  # pairs per second, measured on two cores

_log = logging.getLogger("glossbench")

Choose = Callable[[Call], bool]  # whether a call runs compiled
Run = Callable[[Sequence[Tensor]], Any]  # a program; its value is None for tensors of sizes that it does not take


def ready(kernel: Kernel, arguments: Sequence[Any], pairs: int) -> Callable[..., Any]:
    """The function that runs a kernel for arguments of these types: the kernel itself, or a compiled one.

    Args:
        arguments: example of the arguments; the function takes them with other numbers of points.
        pairs: number of points times samples of all calls of the function.
    """
    # A small call of a kernel that was never compiled is known to be eager without its key.
    is_eager = _choose is _by_default and pairs <= EAGER_RATE and kernel.name not in artefacts.names()
    calls = [] if is_eager else _calls(kernel, arguments, pairs)
    runs = [compiled(call) for call in calls] if calls and all([_choose(call) for call in calls]) else [None]
    is_compiled = None not in runs
    if _used is not None:
        was_eager = _used.get(kernel.name) == EAGER  # a kernel may run several times, with other arguments
        _used[kernel.name] = COMPILED if is_compiled and not was_eager else EAGER
    return _joined(kernel, [run for run in runs if run]) if is_compiled else kernel.function


def _calls(kernel: Kernel, arguments: Sequence[Any], pairs: int) -> list[Call]:
    """The programs of a kernel; none if it cannot be compiled, for example because of an object without tensors."""
    try:
        form, tensors = flatten(arguments)
    except NotFlat:
        return []
    parts: list[Part] = ["before rays", "after rays"] if has_scene(form) else ["whole"]
    keys = [artefacts.key_of(kernel, form, tensors, part) for part in parts]
    return [Call(kernel, form, tensors, pairs, key, part) for part, key in zip(parts, keys, strict=True) if key]


def _joined(kernel: Kernel, runs: Sequence[Run]) -> Callable[..., Any]:
    """The function that runs the programs of a kernel, with rays between them."""

    def run(*arguments: Any) -> Any:
        _, tensors = flatten(arguments)
        value = runs[0](tensors)
        if len(runs) == 2 and value is not None:
            question = Question(value[0], Vec3(*value[1:]))
            occluder = scene_in(arguments)
            assert occluder is not None
            value = runs[1]([*tensors, answer(question, arguments[0], occluder)])
        return kernel.function(*arguments) if value is None else value

    return run


@contextmanager
def choosing(choose: Choose) -> Iterator[None]:
    """Within the block, this function chooses."""
    global _choose
    before, _choose = _choose, choose
    try:
        yield
    finally:
        _choose = before


@contextmanager
def recording() -> Iterator[list[Call]]:
    """Within the block, everything runs eagerly; the list gets the calls."""
    calls: list[Call] = []

    def record(call: Call) -> bool:
        calls.append(call)
        return False

    with choosing(record):
        yield calls


@contextmanager
def noting() -> Iterator[dict[str, str]]:
    """The mapping gets the name of each kernel that the block runs, and how it ran."""
    global _used
    before, _used = _used, {}
    try:
        yield _used
    finally:
        _used = before


def always(call: Call) -> bool:
    """Choose compiled, and compile what is missing."""
    return True


def never(call: Call) -> bool:
    """Choose eager."""
    return False


def is_ready(call: Call) -> bool:
    """Whether a call runs compiled at once, without compiling."""
    return load(call) is not None


def pays(call: Call) -> bool:
    """Whether compiling a call takes less time than running it eagerly."""
    rate = EAGER_RATE if call.is_on_cpu else 100 * EAGER_RATE  # the second is a guess
    seconds = call.pairs / rate
    return seconds > 1 and seconds > compile_seconds() and has_compiler()  # no compilation takes less than a second


def _by_default(call: Call) -> bool:
    return is_ready(call) or pays(call)


_choose: Choose = _by_default
_used: dict[str, str] | None = None
loaded: dict[str, list[tuple[Artefact | None, Run]]] = {}  # by key


def compiled(call: Call) -> Run | None:
    """The compiled program of a call, from the cache or compiled now; None if that is not possible."""
    if not call.is_on_cpu:
        return _traced(call)
    run = load(call)
    if run is None and has_compiler() and call.key not in failed:
        build(call)
        run = load(call)
    return run


def load(call: Call) -> Run | None:
    """The compiled program of a call, from the cache; None if it is not there."""
    if not call.is_on_cpu:
        return None
    for artefact, run in loaded.get(call.key, ()):
        if artefact is not None and artefact.takes(call.tensors):
            return run
    found = artefacts.find(call.key, call.tensors)
    if found is None:
        return None
    from torch._C._aoti import AOTIModelContainerRunnerCpu  # the class of torch's package would import the compiler

    run = _function(found, AOTIModelContainerRunnerCpu(str(artefacts.library_of(found)), 1))
    loaded.setdefault(call.key, []).append((found, run))
    return run


def _traced(call: Call) -> Run:
    """The program of a call on another device, which torch compiles at its first run, in each process again.

    If that fails, the program runs eagerly, and a warning of one line says so.
    """
    found = loaded.setdefault(call.key, [])
    if not found:
        eager = program(call.kernel.function, call.form, call.part)
        run = torch.compile(eager, dynamic=True)

        def guarded(tensors: Sequence[Tensor]) -> Any:
            nonlocal run
            try:
                return run(tensors)
            except RuntimeError as error:  # those of the compiler are
                if run is eager:
                    raise
                why = str(error).strip().splitlines()[0]
                _log.warning("%s is not compiled and runs eagerly: %s", call.kernel.name, why)
                run = eager
                return eager(tensors)

        found.append((None, guarded))
    return found[0][1]


def _function(artefact: Artefact, runner: Any) -> Run:
    n = len(artefact.sizes)

    def run(tensors: Sequence[Tensor]) -> Any:
        if not artefact.takes(tensors[:n]):  # such as a last chunk of one point
            return None
        outputs = runner.run([t.contiguous() for t in tensors])
        return outputs[0] if artefact.n_outputs is None else tuple(outputs)

    return run
