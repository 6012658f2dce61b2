"""The part of a run that a worker of Dask does: it hands batches to processes of its own and passes on what they say.

It does not import torch: the processes that compute do.
"""

import pickle
from typing import Any, cast

from distributed import Worker, WorkerPlugin, get_worker

from glossbench.errors import InputError
from glossbench.run.cell_process import OWN_END, CellProcess, Order, ProcessEnded

MOST_ENDS = 6  # of processes, one after another, that do not say a word: they cannot start on this machine


class Processes(WorkerPlugin):
    """The processes of a worker for one run: one for each thread that asks.

    Args:
        name: the topic of the messages to the run.
    """

    def __init__(self, name: str) -> None:
        self.name = name

    def setup(self, worker: Worker) -> None:
        self.free: list[CellProcess] = []
        self.all: list[CellProcess] = []
        self.is_closed = False

    def teardown(self, worker: Worker) -> None:
        self.is_closed = True
        for process in list(self.all):
            process.close()

    def take(self) -> CellProcess:
        """A process that nobody else uses now."""
        if self.is_closed:
            raise InputError("the run has ended")
        if not self.free:
            self.free.append(CellProcess())
            self.all.append(self.free[-1])
        return self.free.pop()


def run_order(order: Order, topic: str) -> dict[int, Any]:
    """Run a batch; the rows of its cells by their place. A process that ends is replaced by a new one."""
    worker = get_worker()
    processes = cast("Processes", worker.plugins[topic])
    rows: dict[int, Any] = {}
    n_silent = 0

    def tell(kind: str, *values: Any) -> None:
        nonlocal n_silent
        n_silent = 0
        if kind == "row":
            rows[values[0]] = values[1]
        worker.log_event(topic, [str(worker.name), kind, pickle.dumps(values)])

    while True:
        process = processes.take()
        try:
            process.run(order, tell)
        except ProcessEnded as ended:
            n_silent += 1
            processes.all.remove(process)
            if n_silent > MOST_ENDS:
                raise InputError(f"worker {worker.name} cannot run cells: its processes end at once") from None
            order = order._replace(done=frozenset(rows), is_written=ended.args[0] == OWN_END)
            continue
        except BaseException:
            process.close()
            processes.all.remove(process)
            raise
        processes.free.append(process)
        return rows
