"""Worker processes for any kind of task: a worker gets the next task when it finishes one."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from multiprocessing.connection import Connection, wait
from typing import Any, Protocol

from glsim.errors import GlsimError
from glsim.worker_processes import WorkerFailure, WorkerProcess


class WorkerSetup(Protocol):
    """An object sent to each worker once; it makes the function that runs the tasks."""

    def start(self) -> Callable[[Any], Any]:
        """Return the function of one task; called in the worker."""
        ...


def run_tasks(setup: WorkerSetup, tasks: Iterable[Any], processes: int) -> Iterator[Any]:
    """Yield results as they come, in any order; in task order, here, if ``processes`` is 1.

    Raises what a task raises, and GlsimError if a worker dies.
    """
    if processes == 1:
        yield from map(setup.start(), tasks)
        return
    waiting = iter(tasks)
    workers: list[_Worker] = []
    try:
        workers += (_Worker(setup) for _ in range(processes))
        busy = {worker.connection: worker for worker in workers if worker.give(waiting)}
        while busy:
            for ready in wait(list(busy)):
                worker = busy[ready]  # type: ignore[index]
                try:
                    result = worker.connection.recv()
                except (EOFError, ConnectionError):
                    raise GlsimError(
                        f"a worker process ended with status {worker.process.wait()} (out of "
                        "memory?): finished work is kept; run the same command again"
                    ) from None
                if isinstance(result, WorkerFailure):
                    raise result.error
                if not worker.give(waiting):
                    del busy[worker.connection]
                yield result
    finally:
        for worker in workers:
            worker.stop()


class _Worker(WorkerProcess):
    def __init__(self, setup: WorkerSetup) -> None:
        super().__init__(work)
        self.send(setup)

    def give(self, tasks: Iterator[Any]) -> bool:
        """Send the next task; return False if there is none."""
        for task in tasks:
            self.send(task)
            return True
        return False


def work(connection: Connection[Any, Any]) -> None:
    """Run tasks in the worker until its parent closes the connection."""
    # No warnings here: the parent loads the same denoisers and logs their warnings once.
    logging.getLogger("glsim.denoise").setLevel(logging.ERROR)
    function = connection.recv().start()
    while True:
        connection.send(function(connection.recv()))
