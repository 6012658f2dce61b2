"""Plug-ins while a study is read: their imports and constructors, under its time limit."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from glossbench.process.state import Restored
from glossbench.process.time_limit import time_limit


@contextmanager
def loading(what: str, seconds: float) -> Iterator[None]:
    """TimeoutError in the block once it has lasted `seconds`; afterwards the process is as it was.

    Args:
        what: is loaded, for the line that is printed where it cannot be interrupted and this process ends.
    """

    def give_up() -> None:
        text = f"{what} took more than the time limit of {seconds:g} s, and could not be interrupted"
        print(f"error: {text}", file=sys.__stderr__)

    # What a module is for may be to watch or replace the calls of the system: those of os stay as it leaves them.
    with Restored(what, but=("os",)), time_limit(seconds, give_up):
        yield
