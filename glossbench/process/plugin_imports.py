"""Imports and constructors of plug-ins while a study is read, under its time limit."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from glossbench.process.state import ProcessRestorer
from glossbench.process.time_limit import time_limit


@contextmanager
def loading(what: str, seconds: float) -> Iterator[None]:
    """Raise TimeoutError in the block after `seconds`; after the block the process is as it was before.

    Args:
        what: name of what is loaded, for the line that is printed if it cannot be interrupted and this process ends.
    """

    def give_up() -> None:
        text = f"{what} took more than the time limit of {seconds:g} s, and could not be interrupted"
        print(f"error: {text}", file=sys.__stderr__)

    # The purpose of a module may be to watch or replace calls of the system, so its changes to os stay.
    with ProcessRestorer(what, but=("os",)), time_limit(seconds, give_up):
        yield
