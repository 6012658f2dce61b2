"""Run batches on workers of Dask: processes of this machine, or a cluster that runs already.

Dask carries batches and messages, and gives the batch of a worker that is gone to another one. What is done is in the
store, where a batch that begins again finds it.
"""

import logging
import pickle
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from math import ceil
from threading import Lock
from typing import Any

from glossbench.errors import InputError
from glossbench.run.batches import Batch, Row, Settings, Task
from glossbench.run.cell_process import Order
from glossbench.run.progress import Progress
from glossbench.run.rates import Spent
from glossbench.run.store import Store
from glossbench.run.travel import Plugins

MOST_SHOWN = 4  # workers whose work is shown
FORGIVEN = 10  # times that Dask gives up a batch which lost its workers: a cell that ends them has failed before


def check_address(address: str) -> int:
    """The number of processes of local:N; 0 for the address of a scheduler. InputError for anything else."""
    kind, _, n = address.partition(":")
    if kind == "local":
        if not (n.isascii() and n.isdigit() and 1 <= int(n) <= 1024):
            raise InputError(f"--dask local:N needs a number of processes from 1 to 1024, got {address!r}")
        return int(n)
    if "://" not in address:
        raise InputError(f"--dask must be local:N, or an address such as tcp://host:8786, got {address!r}")
    return 0


def run_on_dask(
    address: str, groups: Sequence[Sequence[Task]], settings: Settings, plugins: Plugins, store: Store,
    progress: Progress,
) -> dict[int, Row]:  # fmt: skip
    """Run the cells of all groups; the rows by their place in the study.

    The first cells of a group run alone, until one is done and the reference is there. The others stay together, as
    long as there are groups for all workers.

    Raises:
        InputError: there is no such scheduler, or it is gone; cells that are done are kept.
    """
    rows: dict[int, Row] = {}
    board = Board(progress)
    with _connected(address) as client:
        from distributed import KilledWorker, as_completed

        from glossbench.run.dask_worker import Processes, run_order

        topic = f"glossbench {settings.run}"  # other runs may use the same workers
        client.register_plugin(Processes(topic))
        client.subscribe_topic(topic, board.hear)
        waiting: dict[str, Batch] = {}
        n_given_up: Counter[int] = Counter()
        running = as_completed()

        def submit(tasks: Sequence[Task], **flags: bool) -> None:
            batch = Batch(settings, tuple(tasks), **flags)
            order = Order(plugins, pickle.dumps(batch), store)
            # What has begun goes first, so that the workers stay at one light.
            future = client.submit(run_order, order, topic, pure=False, priority=-batch.is_first, retries=0)
            waiting[future.key] = batch
            running.add(future)

        try:
            for group in groups:
                submit(group, is_first=True)
            n_first = len(groups)
            for future in running:
                batch = waiting.pop(future.key)
                try:
                    done = future.result()
                except KilledWorker:
                    first = batch.tasks[0].place
                    n_given_up[first] += 1
                    if n_given_up[first] > FORGIVEN:
                        raise
                    submit(batch.tasks, is_first=batch.is_first, has_reference=batch.has_reference)
                    continue
                rows |= done
                board.count(done)
                left = [task for task in batch.tasks if task.place not in rows]
                n_first -= batch.is_first
                if left:
                    n_workers = max(1, len(client.nthreads()))
                    size = len(left) if n_first >= n_workers else ceil(len(left) / n_workers)
                    for i in range(0, len(left), size):
                        submit(left[i : i + size], has_reference=True)
        finally:
            if client.status == "running":  # a scheduler that is gone would be waited for
                with suppress(Exception):
                    client.unregister_worker_plugin(topic)
    return rows


@contextmanager
def _connected(address: str) -> Iterator[Any]:
    """A client of the scheduler, which is started and ended here for local:N."""
    n_local = check_address(address)
    try:
        from distributed import CancelledError, Client, KilledWorker, LocalCluster
        from distributed.comm.core import CommClosedError
    except ImportError:
        raise InputError("--dask needs Dask: pip install 'glossbench[distributed]'") from None
    # Workers come and go here on purpose; what ends the run is one line of this program.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        cluster = (
            LocalCluster(
                n_workers=n_local, threads_per_worker=1, processes=True, memory_limit=0,
                dashboard_address=None, silence_logs=logging.CRITICAL,
            )
            if n_local
            else None
        )  # fmt: skip
        client = Client(cluster or address)
    except (OSError, ValueError) as error:
        raise InputError(f"no scheduler of Dask answers at {address}: {error}") from None
    try:
        yield client
    except (CancelledError, KilledWorker, OSError) as error:
        if client.status == "running" and not isinstance(error, CancelledError | KilledWorker | CommClosedError):
            raise
        raise InputError(
            f"{address}: the scheduler or its workers are gone ({type(error).__name__}); cells that are done are kept, "
            "the same command goes on from there"
        ) from None
    finally:
        for each in (client, cluster):
            if each is not None:
                with suppress(Exception):
                    each.close(timeout=10)


class Board:
    """The progress of all workers in one line; each cell is counted once."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._lock = Lock()
        self._doing: dict[str, str] = {}
        self._counted: set[int] = set()

    def hear(self, event: tuple[Any, Any]) -> None:
        """A message of a worker; the thread of the client calls this."""
        worker, kind, pickled = event[1]
        values = pickle.loads(pickled)
        if kind == "row":
            self.count({values[0]: values[1]})
        elif kind == "note":
            self._progress.note(values[0])
        elif kind == "spent":
            self._progress.spent(Spent(*values[0]))
        else:
            with self._lock:
                self._doing[worker] = values[0]
                shown = [f"{name}: {text}" for name, text in sorted(self._doing.items())]
            more = f" and {len(shown) - MOST_SHOWN} more" if len(shown) > MOST_SHOWN else ""
            self._progress.doing(" | ".join(shown[:MOST_SHOWN]) + more)

    def count(self, rows: dict[int, Row]) -> None:
        """Count cells that are done, unless they are counted already."""
        with self._lock:
            new = [place for place in rows if place not in self._counted]
            self._counted.update(new)
        for place in new:
            self._progress.cell(rows[place])
