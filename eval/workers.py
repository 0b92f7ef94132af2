"""A pool of worker processes for tasks of any kind, each process single-threaded.

As in ``glsim.dataset.pool``: started as ``python -c``, so that scripts need no
``if __name__ == "__main__"``, and out of reach of a Ctrl-C in the terminal.
"""

from __future__ import annotations

import os
import subprocess
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from typing import Any, Protocol

from glsim.dataset.pool import SINGLE_THREADED
from glsim.errors import GlsimError

_START = (
    "import sys; descriptor, *sys.path = sys.argv[1:];"
    "from glsim.eval.workers import serve; serve(int(descriptor))"
)


class Setup(Protocol):
    """What is sent to each worker once: it makes the function that is called with each task."""

    def start(self) -> Callable[[Any], Any]:
        """In the worker."""
        ...


@dataclass(frozen=True)
class _Failed:
    error: GlsimError


def run_tasks(setup: Setup, tasks: Iterable[Any], processes: int) -> Iterator[Any]:
    """Results as they come, in any order; with one process, here and in order.

    Raises what a task raises, and GlsimError if a worker dies.
    """
    if processes == 1:
        yield from map(setup.start(), tasks)
        return
    waiting = iter(tasks)
    workers = [_Worker(setup) for _ in range(processes)]
    try:
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
                if isinstance(result, _Failed):
                    raise result.error
                if not worker.give(waiting):
                    del busy[worker.connection]
                yield result
    finally:
        for worker in workers:
            worker.stop()


class _Worker:
    def __init__(self, setup: Setup) -> None:
        self.connection: Connection[Any, Any]
        self.connection, theirs = Pipe()
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-c", _START, str(theirs.fileno()), *sys.path],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=2,  # what denoisers print is no part of the parent's output
                env=os.environ | SINGLE_THREADED,
                process_group=0,
            )
        self._send(setup)

    def give(self, tasks: Iterator[Any]) -> bool:
        """The next task; False if there is none."""
        for task in tasks:
            self._send(task)
            return True
        return False

    def _send(self, message: object) -> None:
        with suppress(ConnectionError):  # it died: the next recv() says so
            self.connection.send(message)

    def stop(self) -> None:
        self.connection.close()
        self.process.kill()
        self.process.wait()


def serve(descriptor: int) -> None:
    """The worker's side, until its parent hangs up."""
    connection: Connection[Any, Any] = Connection(descriptor)
    with suppress(EOFError, ConnectionError):
        try:
            function = connection.recv().start()
            while True:
                connection.send(function(connection.recv()))
        except GlsimError as error:
            connection.send(_Failed(error))
        except (EOFError, ConnectionError):
            raise
        except Exception as error:
            failure = GlsimError(f"{type(error).__name__} in a worker: {error}")
            failure.add_note(traceback.format_exc())
            connection.send(_Failed(failure))
