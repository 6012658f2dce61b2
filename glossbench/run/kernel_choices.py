"""How each kernel of a run works, eagerly or compiled: chosen once, written into the store of the results, and kept.

A compiled kernel may differ from the eager one by the rounding of its last digits. So a resumed run makes the choices
of the run that it resumes, and ends with the same bytes.

Several processes of a run may choose at the same time, and each writes the whole file. So a choice that was not planned
has a mark of its own besides, until the end of the run: it is not lost if another process writes the file without it.
"""

from collections.abc import Callable, Sequence

from glossbench.errors import InputError
from glossbench.run.attempts import FOLDER
from glossbench.run.store import Store
from glossbench.shading.kernels.backend import COMPILED, EAGER, is_ready, pays
from glossbench.shading.kernels.build import Call, build_all
from glossbench.strict_json import dumps, loads

NAME = "kernels.json"
MARK = f"{FOLDER}/kernel_"
Choices = dict[str, list[str]]  # by key of a kernel, its name and how it runs


class KernelChoices:
    """The choices of one run: by key of a kernel, its name and how it runs.

    Args:
        store: where the results of the run lie.
        again: forget the choices of earlier runs.
    """

    def __init__(self, store: Store, again: bool = False) -> None:
        self._store = store
        if again:
            for name in (NAME, *store.list(MARK)):
                store.remove(name)
        self._choices = _read(store)

    def choose(self, call: Call) -> bool:
        """Whether a call runs compiled. If that has not been chosen, it does if it can at once.

        On another device nothing is ready, and the choice is whether compiling pays for this call.
        """
        if call.key not in self._choices:
            self._choices = _read(self._store) | self._choices  # what other processes of this run chose
        if call.key not in self._choices:
            chosen = _describe([(call, is_ready(call) if call.is_on_cpu else pays(call))])
            self._store.put(f"{MARK}{call.key}.json", dumps(chosen).encode())
            self._write(chosen)
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
        self._write(_describe([(call, is_ready(call)) for call in new]))

    def gather(self) -> None:
        """Write the choices of all processes of the run into the file, at the end of the run."""
        if marks := self._store.list(MARK):
            self._write(_read(self._store))
            for name in marks:
                self._store.remove(name)

    def _write(self, choices: Choices) -> None:
        self._choices |= choices
        self._store.put(NAME, dumps(dict(sorted(self._choices.items())), indent=1).encode())


def _describe(choices: Sequence[tuple[Call, bool]]) -> Choices:
    return {call.key: [call.kernel.name, COMPILED if ready else EAGER] for call, ready in choices}


def _read(store: Store) -> Choices:
    """The choices in a store; none of a file that is missing or damaged."""
    found: Choices = {}
    for name in (NAME, *store.list(MARK)):
        found |= _read_file(store, name)
    return found


def _read_file(store: Store, name: str) -> Choices:
    try:
        read = loads(store.get(name))
        return {key: [str(name), str(how)] for key, (name, how) in read.items()}
    except InputError:
        raise
    except (OSError, ValueError, AttributeError, TypeError):
        return {}
