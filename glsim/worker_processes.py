"""Worker processes, each with its own socket to the parent, and their number.

They are started with ``python -c``, not through multiprocessing. Their environment makes libraries
single-threaded (it is read before NumPy is loaded, and the parent's is unchanged), a script needs
no ``if __name__ == "__main__"``, and a Ctrl-C in the terminal reaches the parent only.
``glsim.dataset.worker_pool`` and ``glsim.eval.scoring.workers`` distribute the work.
"""

from __future__ import annotations

import os
import subprocess
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any, Literal

from glsim.errors import ConfigError, GlsimError

#: A number of worker processes; "auto" is one per available core.
Workers = int | Literal["auto"]

#: The environment of workers: one thread each, because every core already has a process. The first
#: is for Mesa's llvmpipe (0 = no thread besides the caller's), the last for OpenCV.
SINGLE_THREADED = {
    "LP_NUM_THREADS": "0",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "OPENCV_FOR_THREADS_NUM": "1",
}
_START = (
    "import sys; module, function, descriptor, *sys.path = sys.argv[1:];"
    f"from {__name__} import serve; serve(module, function, int(descriptor))"
)


def available_workers(workers: Workers = "auto") -> int:
    """Return the number of worker processes; "auto" counts the cores this process may use.

    Raises ConfigError for a number below 1.
    """
    if workers == "auto":
        # Some systems (macOS) cannot say which cores this process may use: take all.
        affinity = getattr(os, "sched_getaffinity", None)
        return len(affinity(0)) if affinity is not None else os.cpu_count() or 1
    if workers < 1:
        raise ConfigError(f"workers = {workers}: at least one is needed")
    return workers


def worker_count(text: str) -> int:
    """Parse the option ``--workers``: a number of at least 1, or "auto". Raises ConfigError."""
    if text == "auto":
        return available_workers()
    if not text.isdigit() or int(text) < 1:
        raise ConfigError(f"--workers {text}: give a number of at least 1, or auto")
    return int(text)


@dataclass(frozen=True)
class WorkerFailure:
    """The message of a worker that cannot continue; unexpected errors carry their traceback."""

    error: GlsimError


class WorkerProcess:
    """The parent's side of a worker; ``connection`` receives its messages and WorkerFailure."""

    def __init__(self, work: Callable[[Connection[Any, Any]], None]) -> None:
        """Start a process that calls ``work``, a module-level function, with its connection."""
        self.connection: Connection[object, object]
        self.connection, theirs = Pipe()
        with theirs:
            arguments = [work.__module__, work.__name__, str(theirs.fileno()), *sys.path]
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-c", _START, *arguments],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=2,  # keep what libraries print out of the parent's output
                env=os.environ | SINGLE_THREADED,
                process_group=0,
            )

    def send(self, message: object) -> None:
        """Send a message to the worker."""
        with suppress(ConnectionError):  # the worker died: the next recv() reports it
            self.connection.send(message)

    def stop(self) -> int:
        """Kill the process if it still runs; return its exit status."""
        self.connection.close()
        self.process.kill()
        return self.process.wait()


def serve(module: str, function: str, descriptor: int) -> None:
    """Call a module's function with the connection, in the worker, and report its errors.

    descriptor: the file descriptor of this end of the socket.
    """
    connection: Connection[object, object] = Connection(descriptor)
    try:
        try:
            work: Callable[[Connection[Any, Any]], None]
            work = getattr(import_module(module), function)
            work(connection)
        except GlsimError as error:
            connection.send(WorkerFailure(error))
        except (EOFError, ConnectionError):
            raise
        except Exception as error:
            failure = GlsimError(f"{type(error).__name__} in a worker: {error}")
            failure.add_note(traceback.format_exc())
            connection.send(WorkerFailure(failure))
    except (EOFError, ConnectionError):
        sys.exit(1)  # nobody listens any more
