"""How each kernel of a run works, eagerly or compiled: chosen once, written into the folder of results, and kept.

A compiled kernel may differ from the eager one by the rounding of its last digits. So a resumed run makes the choices
of the run that it resumes, and ends with the same bytes.
"""

from collections.abc import Callable, Sequence

from glossbench.run.folder import Folder
from glossbench.shading.kernels.backend import COMPILED, EAGER, is_ready, pays
from glossbench.shading.kernels.build import Call, build_all
from glossbench.strict_json import dumps, loads

NAME = "kernels.json"


class KernelChoices:
    """The choices of one folder of results: by key of a kernel, its name and how it runs.

    Args:
        folder: the folder of results.
        again: forget the choices of earlier runs.
    """

    def __init__(self, folder: Folder, again: bool = False) -> None:
        self._folder = folder
        self._choices: dict[str, list[str]] = {} if again else _read(folder)

    def choose(self, call: Call) -> bool:
        """Whether a call runs compiled. If that has not been chosen, it does if it can at once.

        On another device nothing is ready, and the choice is whether compiling pays for this call.
        """
        if call.key not in self._choices:
            self._set([(call, is_ready(call) if call.is_on_cpu else pays(call))])
        return self._choices[call.key][1] == COMPILED

    def plan(self, calls: Sequence[Call], doing: Callable[[str], None]) -> None:
        """Choose for all calls that are not chosen yet, and compile those whose compilation pays, several at once.

        Args:
            calls: the calls of the cells that are still to be run.
            doing: called with the present work.
        """
        new = [call for call in calls if call.key not in self._choices]
        missing = [call for call in new if not is_ready(call) and pays(call)]
        left = len(missing)

        def tell(call: Call) -> None:
            nonlocal left
            left -= 1
            doing(f"compiling kernels: {left} left")

        if missing:
            doing(f"compiling kernels: {left} left")
            build_all(missing, tell)
        self._set([(call, is_ready(call)) for call in new])

    def _set(self, choices: Sequence[tuple[Call, bool]]) -> None:
        self._choices |= {call.key: [call.kernel.name, COMPILED if ready else EAGER] for call, ready in choices}
        self._folder.write(NAME, dumps(dict(sorted(self._choices.items())), indent=1))


def _read(folder: Folder) -> dict[str, list[str]]:
    """The choices in a folder; none if the file is missing or damaged."""
    try:
        read = loads(folder.path(NAME).read_bytes())
        return {key: [str(name), str(how)] for key, (name, how) in read.items()}
    except (OSError, ValueError, AttributeError, TypeError):
        return {}
