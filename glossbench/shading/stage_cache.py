"""Values of stages of precomputation, computed once for all that ask for the same, and timed."""

import dataclasses
from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from glossbench.digests import digest_of
from glossbench.errors import MethodError
from glossbench.options import Options
from glossbench.shading.costs import n_bytes, tensors_in, timed

LIMIT = 2 << 30  # bytes that values may take which no method uses at the time


@dataclass(eq=False)
class Prepared:
    """The value of one stage with what it cost.

    Attributes:
        key: what made it: the stage, the keys of its inputs, the options that it read.
        warm: its time is that of a warm run; those of tuning are cold.
        used: the turn of the cache in which it was last asked for.
    """

    value: Any
    key: Hashable
    seconds: float
    n_bytes: int
    warm: bool
    digest: int
    used: int = 0


class StageCache:
    """Values of stages that were computed, for whoever asks for the same again.

    Same means: the same stage, with equal values of the options that it read, of inputs of the same keys. So one
    pyramid serves every method, material and budget. A value whose bytes have changed since it was made is made again.

    Args:
        limit: bytes that all values may take; beyond it the one goes that was not asked for the longest, but none of
            those of one turn.
    """

    def __init__(self, tell: Callable[[str], None] = lambda text: None, limit: int = LIMIT) -> None:
        self._entries: dict[Hashable, list[tuple[dict[str, Any], Prepared]]] = {}
        self._tell = tell  # which stage is under way
        self._limit = limit
        self._turn = 0
        self._trusted: dict[int, Prepared] = {}  # by id, those whose bytes were compared since the last check

    def begin(self) -> None:
        """A new turn: what is asked for until the next one is used together, and kept together."""
        self._turn += 1

    def get(
        self,
        stage: Callable[..., Any],
        method: Options,
        inputs: dict[str, Any],
        keys: tuple[Any, ...],
        device: str,
        patience: float,
    ) -> Prepared:
        """The stage's value, computed (and timed, see `timed`) where no equal one is known.

        Args:
            keys: of the inputs; that of another stage is its `Prepared.key`.
        """
        known = (stage, tuple(map(_hashable, keys)))
        entries = self._entries.setdefault(known, [])
        found = next((entry for entry in entries if _agrees(entry[0], method)), None)
        if found is not None and not self._is_intact(found[1]):
            entries.remove(found)
            found = None
        if found is not None and (found[1].warm or patience == 0):
            found[1].used = self._turn
            return found[1]
        recorder = Recorder(method)
        self._tell(f"{method.name}: {stage.__name__}")
        with unwritten(f"{method.name}.{stage.__name__}", inputs):
            value, timing = timed(lambda: stage(recorder, **inputs), device, patience)
        if found is not None:  # made while tuning: its value stays, which others may be made of
            prepared = found[1]
            prepared.seconds, prepared.warm = timing.median, True
        else:
            read = tuple((name, type(v), _hashable(v)) for name, v in sorted(recorder.read.items()))
            key = (*known, read)
            prepared = Prepared(value, key, timing.median, n_bytes(value), patience > 0, digest_of(value))
            entries.append((recorder.read, prepared))
            self._trusted[id(prepared)] = prepared
        prepared.used = self._turn
        self._drop()
        return prepared

    def check(self, by: str) -> None:
        """MethodError if a value that was handed out since the last check was written to, which then is dropped."""
        handed_out, self._trusted = self._trusted, {}
        written = [p for p in handed_out.values() if digest_of(p.value) != p.digest]
        for entries in self._entries.values():
            entries[:] = [entry for entry in entries if entry[1] not in written]
        if written:
            stage: Any = written[0].key
            raise MethodError(f"{by} writes into the memory of {stage[0].__name__!r}, which others read")

    def _is_intact(self, prepared: Prepared) -> bool:
        if id(prepared) not in self._trusted:
            if digest_of(prepared.value) != prepared.digest:
                return False
            self._trusted[id(prepared)] = prepared
        return True

    def _drop(self) -> None:
        """Let go of what was used the longest ago until the rest is within the limit."""
        total = sum(prepared.n_bytes for entries in self._entries.values() for _, prepared in entries)
        while total > self._limit:
            idle = [(p.used, known, i) for known, entries in self._entries.items()
                    for i, (_, p) in enumerate(entries) if p.used < self._turn]  # fmt: skip
            if not idle:
                return
            _, known, i = min(idle, key=lambda each: each[0])
            _, prepared = self._entries[known].pop(i)
            self._trusted.pop(id(prepared), None)
            total -= prepared.n_bytes


class _Itself:
    """Stands in a key for a value that cannot be hashed: equal to itself alone, and kept, so that its id stays its."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Itself) and other.value is self.value

    def __hash__(self) -> int:
        return id(self.value)


def _hashable(value: Any) -> Hashable:
    try:
        hash(value)
    except TypeError:
        return _Itself(value)
    known: Hashable = value
    return known


def _agrees(read: Mapping[str, Any], method: Options) -> bool:
    """Whether a method has the values of options that a stage read."""
    values = {option: getattr(method, option, None) for option in read}
    return all(type(values[option]) is type(value) and values[option] == value for option, value in read.items())


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
