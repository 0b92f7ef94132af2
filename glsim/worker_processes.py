"""Worker processes, each with its own socket to the parent, and their number.

They are started with ``python -c``, not through multiprocessing. Their environment makes libraries
single-threaded (it is read before NumPy is loaded, and the parent's is unchanged), a script needs
no ``if __name__ == "__main__"``, and a Ctrl-C in the terminal reaches the parent only.
``glsim.dataset.worker_pool`` and ``glsim.eval.scoring.workers`` distribute the work.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
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
#: The environment in which all x86-64 processors since Haswell (2013) compute alike: OpenBLAS and
#: llvmpipe choose their code by the processor, unless these say otherwise. Vectors of 256 bits are
#: llvmpipe's own choice on processors with AVX2.
_HASWELL = {"OPENBLAS_CORETYPE": "Haswell", "LP_NATIVE_VECTOR_WIDTH": "256"}
#: NumPy's names of what came after Haswell: single features, and the level x86-64-v4 in NumPy 2.4.
_AFTER_HASWELL = ("AVX512", "X86_V4")


def portable_environment() -> dict[str, str]:
    """Return the environment that makes worker processes compute alike on mixed processors.

    Empty on a machine that is no x86-64: it computes in its own way.
    """
    if platform.machine() not in ("x86_64", "AMD64"):
        return {}
    # The same tables as numpy.show_runtime() prints. NumPy warns of a feature that it does not
    # know, or that the processor lacks.
    tables = import_module("numpy._core._multiarray_umath")
    here: Mapping[str, bool] = tables.__cpu_features__
    chosen: Sequence[str] = tables.__cpu_dispatch__
    disabled = [name for name in chosen if name.startswith(_AFTER_HASWELL) and here.get(name)]
    features = {"NPY_DISABLE_CPU_FEATURES": " ".join(disabled)} if disabled else {}
    return _HASWELL | features


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

    def __init__(
        self,
        work: Callable[[Connection[Any, Any]], None],
        environment: Mapping[str, str] | None = None,
    ) -> None:
        """Start a process that calls ``work``, a module-level function, with its connection.

        environment: variables besides this process's and SINGLE_THREADED.
        """
        self.connection: Connection[object, object]
        self.connection, theirs = Pipe()
        with theirs:
            arguments = [work.__module__, work.__name__, str(theirs.fileno()), *sys.path]
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-c", _START, *arguments],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=2,  # keep what libraries print out of the parent's output
                env=os.environ | SINGLE_THREADED | dict(environment or {}),
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
