"""Worker processes for tasks of any kind: each gets the next task when it has done one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from multiprocessing.connection import Connection, wait
from typing import Any, Protocol

from glsim.errors import GlsimError
from glsim.processes import Failed, Process


class Setup(Protocol):
    """What is sent to each worker once: it makes the function that is called with each task."""

    def start(self) -> Callable[[Any], Any]:
        """In the worker."""
        ...


def run_tasks(setup: Setup, tasks: Iterable[Any], processes: int) -> Iterator[Any]:
    """Results as they come, in any order; with one process, here and in order.

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
                        "memory?): what is complete is kept; run the same command again"
                    ) from None
                if isinstance(result, Failed):
                    raise result.error
                if not worker.give(waiting):
                    del busy[worker.connection]
                yield result
    finally:
        for worker in workers:
            worker.stop()


class _Worker(Process):
    def __init__(self, setup: Setup) -> None:
        super().__init__("glsim.eval.workers")
        self.send(setup)

    def give(self, tasks: Iterator[Any]) -> bool:
        """The next task; False if there is none."""
        for task in tasks:
            self.send(task)
            return True
        return False


def work(connection: Connection[Any, Any]) -> None:
    """The worker's side, until its parent hangs up."""
    function = connection.recv().start()
    while True:
        connection.send(function(connection.recv()))
