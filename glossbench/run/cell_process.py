"""A process that runs batches for another one, and that may be killed or end itself at any time.

The time limit of a cell interrupts the main thread and, if that fails, ends the process; plug-ins are free to do
anything to it. So cells do not run in a worker of Dask, whose threads wait for messages, but in a process beside it.
Messages are pickled: batches on its standard input; on its standard output ("doing", text), ("note", text),
("row", place, row), ("spent", numbers), and last ("end",) or ("error", exception). It ends when its input ends.
"""

import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from queue import SimpleQueue
from typing import IO, Any, NamedTuple

from glossbench.errors import InputError, MethodError
from glossbench.run.travel import Plugins

PATIENCE = 5.0  # seconds in which a process must end when it is asked
OWN_END = 1  # exit code of a process that ended itself, after it had written the row of its cell


class Order(NamedTuple):
    """A batch to be run.

    Attributes:
        batch: it is pickled, because it can be read only when its plug-ins are imported.
        done: places of its tasks that are done already.
        is_written: the process ended itself in the first of the others, whose row it had written before.
    """

    plugins: Plugins
    batch: bytes
    store: Any
    done: frozenset[int] = frozenset()
    is_written: bool = False


class CellProcess:
    """The process, seen from the one that started it."""

    def __init__(self) -> None:
        # A session of its own: Ctrl-C reaches the run alone, which then closes this process.
        self._process = subprocess.Popen(
            [sys.executable, "-m", "glossbench.run.cell_process"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            start_new_session=True,
        )  # fmt: skip

    def run(self, order: Order, tell: Callable[..., None]) -> None:
        """Run a batch; `tell` gets the messages.

        Raises:
            ProcessEnded: the process ended during the batch.
            Exception: what ended the run of the batch.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            pickle.dump(order, self._process.stdin)
            self._process.stdin.flush()
            while True:
                kind, *values = pickle.load(self._process.stdout)
                if kind == "end":
                    return
                if kind == "error":
                    raise values[0]
                tell(kind, *values)
        except (EOFError, OSError, pickle.UnpicklingError):
            self.close()
            raise ProcessEnded(self._process.returncode) from None

    def close(self) -> None:
        """End the process: it is asked first, so that the cell in which it is does not take the blame."""
        self._process.terminate()
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                with suppress(OSError):
                    stream.close()
        self._process.wait()


class ProcessEnded(Exception):
    """The process ended during a batch; its exit code is `args[0]`, negative for a signal."""


def serve() -> None:
    """Run the batches that arrive on standard input."""
    orders, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    # Whatever plug-ins read and print, they do not read orders or write answers.
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    waiting: SimpleQueue[Order] = SimpleQueue()
    threading.Thread(target=_receive, args=(orders, waiting), daemon=True).start()
    kept: dict[str, Any] = {}
    with suppress(KeyboardInterrupt, BrokenPipeError):
        while True:
            _answer(waiting.get(), answers, kept)


def _receive(orders: IO[bytes], waiting: "SimpleQueue[Order]") -> None:
    try:
        while True:
            waiting.put(pickle.load(orders))
    except BaseException:  # the other process has ended, so nobody waits for an answer
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(PATIENCE)
        os._exit(0)


def _answer(order: Order, answers: IO[bytes], kept: dict[str, Any]) -> None:
    from glossbench.run.batches import Row, Task, execute
    from glossbench.run.progress import Progress

    def send(*message: Any) -> None:
        pickle.dump(message, answers)
        answers.flush()

    def tell(task: Task, row: Row) -> None:
        send("row", task.place, row)

    try:
        order.plugins.load()
        batch = pickle.loads(order.batch)
        tasks = [task for task in batch.tasks if task.place not in order.done]
        if order.is_written:
            tasks[:1] = [replace(task, rerun_failed=False) for task in tasks[:1]]
        progress = Progress(
            doing=lambda text: send("doing", text),
            note=lambda text: send("note", text),
            spent=lambda spent: send("spent", tuple(spent)),
        )
        execute(replace(batch, tasks=tuple(tasks)), order.store, progress, tell, kept)
        send("end")
    except BaseException as error:
        send("error", _portable(error))


def _portable(error: BaseException) -> Exception:
    """The exception, or its text if it cannot be sent to another process."""
    try:
        if isinstance(pickle.loads(pickle.dumps(error)), type(error)) and isinstance(error, Exception):
            return error
    except Exception:
        pass
    if isinstance(error, InputError):
        return InputError(str(error))
    return MethodError("".join(traceback.format_exception_only(error)).strip())


if __name__ == "__main__":
    serve()
