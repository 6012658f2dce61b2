"""`glossbench compile`: compile the kernels of studies before they run, and list or remove what is compiled."""

from typing import TYPE_CHECKING, Annotated

import typer

from glossbench.commands import completion
from glossbench.commands.printing import err, say
from glossbench.errors import InputError

if TYPE_CHECKING:
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

    if study is None and not every and not clear:
        raise InputError("compile: name a study, or --all")
    if clear:
        say(f"{artefacts.clear()} compiled kernels removed from {artefacts.folder()}")
    if study is None and not every:
        return
    if not has_compiler():
        raise InputError("compile: there is no C++ compiler; install g++ or clang++")
    calls = _calls([study] if study is not None else [], every)
    missing = [call for call in calls if artefacts.find(call.key, call.tensors) is None]
    with Bar(console=err, transient=True, disable=not err.is_terminal) as bar:
        task = bar.add_task("compiling kernels", total=len(missing))
        made = build_all(missing, lambda call: bar.advance(task))
    failed = made.count(None)
    say(f"{len(calls)} kernels: {len(calls) - len(missing)} were there, {len(made) - failed} compiled, {failed} failed")
    wrong = 0
    for call in calls if check else []:
        found = difference(call)
        wrong += found is not None and not found <= 1e-5
        what = "not compiled" if found is None else f"{found:.1e} of the maximum"
        say(f"{call.kernel.name} {call.key[:8]}: {what}")
    if failed or wrong:
        raise typer.Exit(1)


def _calls(names: list[str], every: bool) -> "list[Call]":
    """The kernel calls of studies, each once."""
    from glossbench.run.kernel_calls import calls_of
    from glossbench.study.study import load_study
    from glossbench.study.study_files import find_study_files

    found: dict[str, Call] = {}
    for name in [*names, *(find_study_files() if every else [])]:
        try:
            loaded = load_study(name)
        except InputError as error:
            if not every:
                raise
            err.print(f"{name} is left out: {error}", soft_wrap=True)
            continue
        with err.status(f"{name} ...") as status:
            tell = lambda text, name=name: status.update(f"{name}: {text}")  # noqa: E731
            calls = calls_of(loaded.cells(), loaded.reference, tell=tell)
        found |= {call.key: call for call in calls if call.key not in found}
    return list(found.values())
