"""Kernels: functions of tensors with a name, which may be compiled."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, eq=False)
class Kernel:
    """A pure function of tensors, numbers and None, alone or in tuples and dataclasses. It may be compiled.

    A call runs the function eagerly; `over_points` and `backend.ready` choose how to run it.

    Attributes:
        name: its name in records of runs.
        function: it returns a tensor or a tuple of tensors. It must not read tensors that may change, or draw random
            numbers.
    """

    name: str
    function: Callable[..., Any]

    def __call__(self, *arguments: Any) -> Any:
        return self.function(*arguments)

    @property
    def place(self) -> tuple[str, str] | None:
        """The module that defines the kernel, and its name there; None if another process cannot find it by these."""
        module, name = self.function.__module__, self.function.__qualname__
        found = getattr(sys.modules.get(module), name, None)
        is_known = isinstance(found, Kernel) and found.function is self.function and module != "__main__"
        return (module, name) if is_known else None


def kernel(name: str) -> Callable[[Callable[..., Any]], Kernel]:
    """Decorator: the function is a kernel with this name."""
    return lambda function: Kernel(name, function)
