"""The constants of a run on many workers, and what they say of N cells on W workers: what saturates first, and when.

PYTHONPATH=tests python tests/oracles/growth.py [--cells 10000] [--workers 100]

Times are of the processor, so that other work on the machine does not count. A worker and the scheduler run in this
process, so the time of a message includes both and the client; in a cluster the scheduler has a part of it only.
"""

import argparse
import asyncio
import logging
import pickle
import tempfile
import time
from collections import Counter
from pathlib import Path

from distributed import Client, Scheduler, Worker, get_worker

from glossbench.commands.printing import say
from glossbench.envmap.lights.file_light import make_light
from glossbench.run.batches import Batch, Settings, Task
from glossbench.run.cell_keys import Identity
from glossbench.run.on_dask import Board
from glossbench.run.remote import RemoteStore
from glossbench.run.runner import Progress, run_study
from oracles.flat_studies import registered, study_in

N_MESSAGES, N_CELLS = 2000, 40
OPERATIONS = ("has", "get", "put", "remove", "list")


def count_operations(folder: Path) -> tuple[Counter[str], float, float, dict[str, list]]:
    """Calls of a store per cell, bytes written per cell, calls per cell before the first one, and messages by kind."""
    count: Counter[str] = Counter()
    told: dict[str, list] = {"doing": [], "row": []}
    study = study_in(
        folder, methods=f"{{importance_sampling: {{samples: [{', '.join(str(i + 1) for i in range(N_CELLS))}]}}}}"
    )

    class Counted(RemoteStore):
        pass

    for name in OPERATIONS:

        def call(self, *arguments, _name=name, **options):
            count[_name] += 1
            count["bytes"] += len(arguments[1]) if _name == "put" else 0
            return getattr(RemoteStore, _name)(self, *arguments, **options)

        setattr(Counted, name, call)
    before: list[Counter[str]] = []

    def begin(n: int) -> None:
        before.append(count.copy())

    def cell(row: dict) -> None:
        told["row"].append(row)
        before.append(count.copy())

    progress = Progress(begin=begin, cell=cell, doing=told["doing"].append)
    run_study(study, Counted("memory://growth"), progress=progress)
    # From the second cell to the last one: the first makes the reference.
    cells = Counter({name: (before[-1][name] - before[1][name]) / (N_CELLS - 1) for name in before[-1]})
    first = sum(before[0][name] for name in OPERATIONS) / N_CELLS
    return cells, cells.pop("bytes"), first, told


async def time_of_a_message(row: dict) -> float:
    """Seconds of the processor from a worker to the board of the run, for the row of a cell."""
    board = Board(Progress())
    async with (
        Scheduler(host="127.0.0.1", port=0, dashboard=False) as scheduler,
        Worker(scheduler.address, host="127.0.0.1", nthreads=1, dashboard=False),
        Client(scheduler.address, asynchronous=True) as client,
    ):
        heard = asyncio.Event()

        def hear(event):
            if event[1] == "end":
                heard.set()
            else:
                board.hear(event)

        client.subscribe_topic("growth", hear)

        def send(n, end):
            for i in range(n):
                get_worker().log_event("growth", ["w", "row", pickle.dumps((i, row))])
            if end:
                get_worker().log_event("growth", "end")

        await client.submit(send, 10, False, pure=False)
        began = time.process_time()
        await client.submit(send, N_MESSAGES, True, pure=False)
        await heard.wait()
        return (time.process_time() - began) / N_MESSAGES


def size_of_a_task(folder: Path) -> int:
    """Bytes that each cell adds to the order of its batch."""
    study = study_in(folder, methods="{flat: {samples: [1, 2, 3]}}")
    known = [Identity(*(f"{i}{k}" * 10 for k in range(4)), (f"{i}4" * 40, "m" * 80, "v" * 80)) for i in range(3)]
    settings = Settings.of("run", study, "code", True, False)
    tasks = [Task(i, *each) for i, each in enumerate(zip(study.cells(), known, strict=True))]
    sizes = [len(pickle.dumps(Batch(settings, tuple(tasks[:n])))) for n in (1, 3)]
    return (sizes[1] - sizes[0]) // 2


def main() -> None:
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, default=10_000)
    parser.add_argument("--workers", type=int, default=100)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name, registered():
        folder = Path(name)
        operations, n_bytes, first, told = count_operations(folder)
        n_trips = sum(operations.values())
        stated = ", ".join(f"{value:.1f} {name}" for name, value in sorted(operations.items()))
        say(f"store: {n_trips:.1f} round trips per cell ({stated}), {n_bytes / 1000:.1f} kB written")
        n_messages = 1 + 1 + len(told["doing"]) / N_CELLS  # its row, its cost, and what it is doing
        each = asyncio.run(time_of_a_message(told["row"][-1]))
        say(f"messages: {n_messages:.1f} per cell, {1e3 * each:.2f} ms each for the row of a cell")
        say(f"order of a batch: {size_of_a_task(folder)} bytes per cell")
    began = time.process_time()
    light = make_light("grace_cross", {"resolution": 256}).cubemap()
    say(
        f"light: {light.faces.numel() * 4 / 1e6:.1f} MB for a cube of 256, "
        f"{time.process_time() - began:.1f} s to read and make it"
    )
    least = given.workers * n_messages * each
    say(f"messages saturate one core when cells on {given.workers} workers take less than {least:.2f} s each")
    # Not measured here; what a shared folder and one prefix of S3 are often said to bear.
    for what, rate in (("a shared folder", 1000), ("an object store", 3500)):
        say(
            f"{what} of {rate} operations per second is saturated by cells below {given.workers * n_trips / rate:.2f} s"
        )
    say(f"before the first cell: {first:.1f} round trips per cell; of 20 ms each {0.02 * first * given.cells:.0f} s")


if __name__ == "__main__":
    main()
