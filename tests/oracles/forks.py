"""Other processes that start at once: forked from one that has imported glossbench, which takes seconds."""

import multiprocessing
import os
import sys
from collections.abc import Mapping
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import NamedTuple

SERVER = multiprocessing.get_context("forkserver")
SERVER.set_forkserver_preload(["glossbench.commands.cli", "glossbench.run.runner"])


class Ended(NamedTuple):
    """How a process ended, and what it printed."""

    returncode: int
    stdout: str
    stderr: str


def started(code: str, *arguments: object, log: Path | None = None, **variables: str) -> BaseProcess:
    """A process that runs Python code with these arguments and, beside those of this process, these variables.

    Args:
        log: path without an ending of the files for standard output and error; both stay those of this process if None.
    """
    environment = dict(os.environ) | variables
    given = (code, [str(each) for each in arguments], environment, os.getcwd(), log)
    process = SERVER.Process(target=_run, args=given)
    process.start()
    return process


def ran(code: str, *arguments: object, log: Path, seconds: float = 120, **variables: str) -> Ended:
    """Such a process, which must end within this time."""
    process = started(code, *arguments, log=log, **variables)
    process.join(seconds)
    if process.exitcode is None:
        process.kill()
        raise TimeoutError(f"the process did not end in {seconds:g} seconds")
    return Ended(process.exitcode, *(log.with_suffix(ending).read_text() for ending in (".out", ".err")))


def _run(code: str, arguments: list[str], environment: Mapping[str, str], folder: str, log: Path | None) -> None:
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(folder)
    sys.path[:0] = [path for path in environment.get("PYTHONPATH", "").split(os.pathsep) if path]
    sys.dont_write_bytecode = bool(environment.get("PYTHONDONTWRITEBYTECODE"))
    sys.argv = ["-c", *arguments]
    for number, ending in ((1, ".out"), (2, ".err")) if log else ():
        opened = os.open(log.with_suffix(ending), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(opened, number)
        os.close(opened)
    exec(code, {"__name__": "__main__"})
