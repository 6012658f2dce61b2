"""Values of stages of precomputation, computed once for all that ask for the same, and timed."""

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from glossbench.costs import n_bytes, tensors_in, timed
from glossbench.errors import MethodError
from glossbench.options import Options


@dataclass(frozen=True)
class Prepared:
    """The value of one stage with what it cost."""

    value: Any
    seconds: float
    n_bytes: int
    warm: bool


class StageCache:
    """Values of stages that were computed, for whoever asks for the same again.

    Same means: the same stage, with equal values of the options that it read, of equal inputs. So one pyramid serves
    every method, material and budget.
    """

    def __init__(self, tell: Callable[[str], None] = lambda text: None) -> None:
        self._entries: dict[tuple[Any, ...], list[tuple[dict[str, Any], Prepared]]] = {}
        self._tell = tell  # which stage is under way

    def get(
        self,
        stage: Callable[..., Any],
        method: Options,
        inputs: dict[str, Any],
        keys: tuple[Any, ...],
        device: str,
        patience: float,
    ) -> Prepared:
        """The stage's value, computed (and timed, see `timed`) where no equal one is known."""
        entries = self._entries.setdefault((stage, keys), [])
        for entry in entries:
            read, prepared = entry
            if all(getattr(method, option, None) == value for option, value in read.items()):
                if prepared.warm or patience == 0:
                    return prepared
                entries.remove(entry)  # made while tuning, its time that of a cold run
                break
        recorder = Recorder(method)
        self._tell(f"{method.name}: {stage.__name__}")
        with unwritten(f"{method.name}.{stage.__name__}", inputs):
            value, seconds = timed(lambda: stage(recorder, **inputs), device, patience)
        prepared = Prepared(value, seconds, n_bytes(value), patience > 0)
        entries.append((recorder.read, prepared))
        return prepared


class Recorder:
    """Stands for a method while a stage runs, and notes the options that it reads."""

    def __init__(self, method: Options) -> None:
        self._method = method
        self.read: dict[str, Any] = {}

    def __getattr__(self, name: str) -> Any:
        if not hasattr(self._method, name):
            self.read[name] = None  # the stage may go by that: a method that has the option must not get its value
            raise AttributeError(f"{type(self._method).__name__} has no option {name!r}")
        value = getattr(self._method, name)
        if callable(value):  # a helper may read any option, and another class may have another helper
            self.read["__class__"] = type(self._method)
            self.read |= {f.name: getattr(self._method, f.name) for f in dataclasses.fields(self._method)}  # type: ignore[arg-type]
        else:
            self.read[name] = value
        return value


@contextmanager
def unwritten(by: str, inputs: Mapping[str, Any]) -> Iterator[None]:
    """MethodError if a tensor inside the inputs is written to meanwhile: what shares it would be wrong."""
    tensors = [(name, t) for name, value in inputs.items() for t in tensors_in(value) if not t.is_inference()]
    versions = [t._version for _, t in tensors]
    yield
    for (name, tensor), version in zip(tensors, versions, strict=True):
        if tensor._version != version:
            raise MethodError(f"{by} writes into {name!r}, which others read")
