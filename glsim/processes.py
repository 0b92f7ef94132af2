"""Worker processes, each with a socket of its own to its parent.

They are started as ``python -c``, not through multiprocessing: they get single-threaded libraries
by their environment (read before NumPy is loaded, and the parent's stays as it is), a script needs
no ``if __name__ == "__main__"``, and a Ctrl-C in the terminal reaches the parent only. Which work
goes to whom is decided by those who start them: ``glsim.dataset.pool``, ``glsim.eval.workers``.
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

from glsim.errors import GlsimError

#: The environment of workers: one thread each, as there is a process a core already. The first is
#: for Mesa's llvmpipe (0 = none besides the caller's), the last for OpenCV.
SINGLE_THREADED = {
    "LP_NUM_THREADS": "0",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "OPENCV_FOR_THREADS_NUM": "1",
}
_START = (
    "import sys; module, descriptor, *sys.path = sys.argv[1:];"
    "from glsim.processes import serve; serve(module, int(descriptor))"
)


@dataclass(frozen=True)
class Failed:
    """A worker cannot go on. An error that glsim does not raise on purpose has its trace noted."""

    error: GlsimError


class Process:
    """The parent's side. ``connection`` brings what the worker sends, Failed among it."""

    def __init__(self, module: str) -> None:
        """module: its function ``work(connection)`` is what the process does."""
        self.connection: Connection[object, object]
        self.connection, theirs = Pipe()
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-c", _START, module, str(theirs.fileno()), *sys.path],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=2,  # what libraries print is no part of the parent's output
                env=os.environ | SINGLE_THREADED,
                process_group=0,
            )

    def send(self, message: object) -> None:
        """To the worker."""
        with suppress(ConnectionError):  # it died: the next recv() says so
            self.connection.send(message)

    def stop(self) -> int:
        """End it, if need be by force; the exit status."""
        self.connection.close()
        self.process.kill()
        return self.process.wait()


def serve(module: str, descriptor: int) -> None:
    """The worker's side: works until it is done, fails, or the parent has gone.

    descriptor: this end of the socket.
    """
    connection: Connection[object, object] = Connection(descriptor)
    try:
        try:
            work: Callable[[Connection[object, object]], None] = import_module(module).work
            work(connection)
        except GlsimError as error:
            connection.send(Failed(error))
        except (EOFError, ConnectionError):
            raise
        except Exception as error:
            failure = GlsimError(f"{type(error).__name__} in a worker: {error}")
            failure.add_note(traceback.format_exc())
            connection.send(Failed(failure))
    except (EOFError, ConnectionError):
        sys.exit(1)  # nobody to tell
