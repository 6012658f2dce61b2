"""`glossbench compile`: compile the kernels of studies before they run, and list or remove what is compiled."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from glossbench.commands import completion
from glossbench.commands.printing import Pulse, err, say
from glossbench.errors import InputError

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

    from glossbench.shading.kernels.build import Call


def compile_kernels(
    study: Annotated[
        str | None, typer.Argument(help="A study: its name or its file.", autocompletion=completion.studies)
    ] = None,
    every: Annotated[bool, typer.Option("--all", help="All installed studies.")] = False,
    check: Annotated[bool, typer.Option("--check", help="Compare each compiled kernel with the eager one.")] = False,
    clear: Annotated[bool, typer.Option("--clear", help="Remove all compiled kernels first.")] = False,
) -> None:
    """Compile the kernels of a study, so that runs use them at once."""
    from rich.progress import Progress as Bar

    from glossbench.shading.kernels import artefacts
    from glossbench.shading.kernels.build import build_all, has_compiler
    from glossbench.shading.kernels.check import difference
    from glossbench.study.study_files import find_study_files

    if study is None and not every and not clear:
        raise InputError("compile: name a study, or --all")
    if clear:
        say(f"{artefacts.clear()} compiled kernels removed from {artefacts.folder()}")
    if study is None and not every:
        return
    if not has_compiler():
        raise InputError("compile: there is no C++ compiler; install g++ or clang++")
    calls: list[Call] = []
    names = [*([study] if study is not None else []), *(find_study_files() if every else [])]
    with Bar(console=err, transient=True, disable=not err.is_terminal) as bar:
        compiling, pulse = bar.add_task("compiling kernels", total=0), Pulse(bar, "kernels")

        def find_missing() -> "Iterator[Call]":
            n_missing = 0
            for call in _find_calls(names, bar, skip=every):
                calls.append(call)
                if artefacts.find(call.key, call.tensors) is None:
                    n_missing += 1
                    bar.update(compiling, total=n_missing)
                    yield call

        def advance(call: "Call") -> None:
            bar.advance(compiling)
            pulse()

        made = build_all(find_missing(), advance)
    failed = made.count(None)
    say(f"{len(calls)} kernels: {len(calls) - len(made)} were there, {len(made) - failed} compiled, {failed} failed")
    wrong = 0
    for call in calls if check else []:
        found = difference(call)
        wrong += found is not None and not found <= 1e-5
        what = "not compiled" if found is None else f"{found:.1e} of the maximum"
        say(f"{call.kernel.name} {call.key[:8]}: {what}")
    if failed or wrong:
        raise typer.Exit(1)


def _find_calls(names: list[str], bar: "Bar", skip: bool) -> "Iterator[Call]":
    """The kernel calls of studies, each once, as they are found; `skip` leaves out a study that cannot be read."""
    from glossbench.run.kernel_calls import CallFinder
    from glossbench.study.study import load_study

    reading = bar.add_task("reading studies", total=len(names))
    name, found = "", set()
    finder = CallFinder(tell=lambda text: bar.update(reading, description=f"{name}: {text}"))
    for name in names:
        try:
            loaded = load_study(name)
        except InputError as error:
            if not skip:
                raise
            err.print(f"{name} is left out: {error}", soft_wrap=True)
            continue
        for call in finder.find(loaded.cells(), loaded.reference):
            if call.key not in found:
                found.add(call.key)
                yield call
        bar.advance(reading)
    bar.remove_task(reading)
