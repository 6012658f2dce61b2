"""Values of stages of precomputation: each is computed once, timed, and shared by all that need it."""

import dataclasses
import time
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from glossbench.digests import compute_digest
from glossbench.errors import MethodError
from glossbench.options import Options
from glossbench.shading.costs import count_bytes, find_tensors, time_work
from glossbench.shading.method import Method, find_stages

LIMIT = 2 << 30  # bytes that all values may take; those in use are never dropped
Keys = tuple[Hashable, ...]  # of the inputs of a stage
Origin = list[tuple[Callable[..., Any], "StageOptions"]]  # a stage and those of its inputs, with what they read
MUCH = 1 << 28  # above so many bytes, values that no later method takes are dropped before another one is computed


@dataclass(eq=False)
class PreparedStage:
    """The value of one stage, and its costs.

    Attributes:
        key: the origin of the value: the stage, the keys of its inputs, the options that it read.
        warm: whether its time is that of a warm run; runs for tuning are cold.
        used: the turn of the cache in which it was last requested.
    """

    value: Any
    key: Hashable
    seconds: float
    n_bytes: int
    warm: bool
    digest: int
    used: int = 0


class StageCache:
    """Values of stages that were computed, for use by later calls.

    A value is used again for the same stage, equal values of the options that the stage read, and inputs with the same
    keys. So one pyramid serves every method, material and budget. A value whose bytes have changed since it was
    computed is computed again.

    Args:
        tell: called with the names of the method and the stage when a stage begins.
        limit: bytes that all values may take. Above it, the values that were not used for the longest time are dropped,
            but never those of the current turn.
        later: gives the methods of this turn and of all later ones; None if they are not known.

    Attributes:
        seconds: that stages have taken so far, with all their timed runs.
    """

    def __init__(
        self,
        tell: Callable[[str], None] = lambda text: None,
        limit: int = LIMIT,
        later: Callable[[], Sequence[Method] | None] = lambda: None,
    ) -> None:
        self._entries: dict[tuple[Callable[..., Any], Keys], list[tuple[StageOptions, PreparedStage]]] = {}
        self._tell = tell
        self._limit = limit
        self._later = later
        self._turn = 0
        self.seconds = 0.0
        self._trusted: dict[int, PreparedStage] = {}  # by id, values whose bytes were compared since the last check

    def begin(self) -> None:
        """Begin a new turn: all values that are requested during one turn are used together and kept."""
        self._turn += 1

    def get(
        self,
        stage: Callable[..., Any],
        method: Options,
        inputs: dict[str, Any],
        keys: tuple[Any, ...],
        device: str,
        patience: float,
    ) -> PreparedStage:
        """The value of a stage. It is computed and timed (see `time_work`) if the cache does not have an equal one.

        Args:
            keys: keys of the inputs; the key of another stage is its `PreparedStage.key`.
        """
        known = (stage, tuple(map(_make_hashable, keys)))
        entries = self._entries.setdefault(known, [])
        found = next((entry for entry in entries if entry[0].agrees(method)), None)
        if found is not None and not self._is_intact(found[1]):
            entries.remove(found)
            found = None
        if found is not None and (found[1].warm or patience == 0):
            found[1].used = self._turn
            return found[1]
        read = StageOptions()
        self._tell(f"{method.name}: {stage.__name__}")
        if found is not None:
            found[1].used = self._turn
        self._make_room()
        began = time.perf_counter()
        with forbid_writes(f"{method.name}.{stage.__name__}", inputs):
            value, timing = time_work(lambda: stage(Recorder(method, read), **inputs), device, patience)
        self.seconds += time.perf_counter() - began
        if found is not None:  # computed during tuning: its value stays, because other values may depend on it
            prepared = found[1]
            prepared.seconds, prepared.warm = timing.median, True
        else:
            prepared = PreparedStage(
                value, (*known, read.key()), timing.median, count_bytes(value), patience > 0, compute_digest(value)
            )
            entries.append((read, prepared))
            self._trusted[id(prepared)] = prepared
        prepared.used = self._turn
        self._drop()
        return prepared

    def check(self, by: str) -> None:
        """Raise MethodError if a value that was returned since the last check was written to; that value is dropped."""
        handed_out, self._trusted = self._trusted, {}
        written = [p for p in handed_out.values() if compute_digest(p.value) != p.digest]
        for entries in self._entries.values():
            entries[:] = [entry for entry in entries if entry[1] not in written]
        if written:
            stage: Any = written[0].key
            raise MethodError(f"{by} writes into the memory of {stage[0].__name__!r}, which is also used elsewhere")

    def _is_intact(self, prepared: PreparedStage) -> bool:
        if id(prepared) not in self._trusted:
            if compute_digest(prepared.value) != prepared.digest:
                return False
            self._trusted[id(prepared)] = prepared
        return True

    def _count_bytes(self) -> int:
        return sum(prepared.n_bytes for entries in self._entries.values() for _, prepared in entries)

    def _make_room(self) -> None:
        """If all values take much memory, drop those that no later method takes.

        Materials and views are not compared, so a value may be kept that is not needed.
        """
        methods = self._later() if self._count_bytes() > MUCH else None
        if methods is None:
            return
        functions = {cls: {each.function for each in find_stages(cls).values()} for cls in {type(m) for m in methods}}

        def takes(method: Method, origin: Origin) -> bool:
            return all(stage in functions[type(method)] and read.agrees(method) for stage, read in origin)

        origins = self._find_origins()
        for entries in self._entries.values():
            for read, prepared in list(entries):
                if prepared.used < self._turn and not any(takes(method, origins[prepared.key]) for method in methods):
                    entries.remove((read, prepared))
                    self._trusted.pop(id(prepared), None)

    def _find_origins(self) -> dict[Hashable, "Origin"]:
        """The origin of each value, by its key."""
        known = {p.key: (stage, read, keys) for (stage, keys), each in self._entries.items() for read, p in each}

        def trace(key: Hashable) -> Origin:
            if key not in known:  # an input of the method, such as the light
                return []
            stage, read, keys = known[key]
            return [(stage, read), *(step for each in keys for step in trace(each))]

        return {key: trace(key) for key in known}

    def _drop(self) -> None:
        """Drop the values that were not used for the longest time, until the rest is within the limit."""
        total = self._count_bytes()
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
    """Stands in a key for a value that cannot be hashed. It is equal only to the same object.

    It keeps the object alive, so that no other object gets its id.
    """

    def __init__(self, value: Any) -> None:
        self.value = value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Itself) and other.value is self.value

    def __hash__(self) -> int:
        return id(self.value)


def _make_hashable(value: Any) -> Hashable:
    try:
        hash(value)
    except TypeError:
        return _Itself(value)
    known: Hashable = value
    return known


@dataclass
class StageOptions:
    """The options that a stage read, by name.

    Attributes:
        values: the values that the stage read; None if the method does not have the option.
        defaults: the values that the stage uses if a method does not have the option, see `read_option`.
    """

    values: dict[str, Any] = field(default_factory=dict)
    defaults: dict[str, Any] = field(default_factory=dict)

    def agrees(self, method: Options) -> bool:
        """Whether the stage would read the same values from this method."""
        found = {option: getattr(method, option, self.defaults.get(option)) for option in self.values}
        return all(type(found[option]) is type(v) and found[option] == v for option, v in self.values.items())

    def key(self) -> tuple[Hashable, ...]:
        """The names, types and values of the options, as a key."""
        return tuple((name, type(value), _make_hashable(value)) for name, value in sorted(self.values.items()))


def read_option(method: Any, option: str, default: Any) -> Any:
    """An option of the method that a stage runs for, or a default if the method does not have this option.

    So methods whose option has the default share the value of the stage with methods that do not have the option.
    """
    if isinstance(method, Recorder):
        method._read.defaults[option] = default
    return getattr(method, option, default)


class Recorder:
    """Stands for a method while a stage runs, and records the options that the stage reads."""

    def __init__(self, method: Options, read: StageOptions) -> None:
        self._method, self._read = method, read

    def __getattr__(self, name: str) -> Any:
        values = self._read.values
        if not hasattr(self._method, name):
            values[name] = self._read.defaults.get(name)  # a method with another value must not share this result
            raise AttributeError(f"{type(self._method).__name__} has no option {name!r}")
        value = getattr(self._method, name)
        if callable(value):  # a function of the method may read any option, and may differ in another class
            values["__class__"] = type(self._method)
            values |= {f.name: getattr(self._method, f.name) for f in dataclasses.fields(self._method)}  # type: ignore[arg-type]
        else:
            values[name] = value
        return value


@contextmanager
def forbid_writes(by: str, inputs: Mapping[str, Any]) -> Iterator[None]:
    """Raise MethodError if the block writes to a tensor inside the inputs: other values that use it would be wrong."""
    tensors = [(name, t) for name, value in inputs.items() for t in find_tensors(value) if not t.is_inference()]
    versions = [t._version for _, t in tensors]
    yield
    for (name, tensor), version in zip(tensors, versions, strict=True):
        if tensor._version != version:
            raise MethodError(f"{by} writes into {name!r}, which is also used elsewhere")
