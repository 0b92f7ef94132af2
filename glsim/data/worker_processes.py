"""Worker processes, each connected to the parent by its own socket, and their number.

They are started with ``python -c``: their environment makes libraries single-threaded (before NumPy
is loaded, and without a change of the parent's), a script needs no ``if __name__ == "__main__"``,
and a Ctrl-C in the terminal reaches the parent only. concurrent.futures and loky give up all tasks
when a worker is killed, and do not name the fatal task; their tasks are single calls, where a
simulator reads the next chunk ahead and reports its progress.
"""

from __future__ import annotations

import logging
import math
import os
import platform
import signal
import subprocess
import sys
import time
import traceback
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from itertools import islice
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, Literal, Protocol, TypeVar

from glsim.core.errors import ConfigError, DatasetError, GlsimError

log = logging.getLogger(__name__)
_Task = TypeVar("_Task")
_Result = TypeVar("_Result")
_Given = TypeVar("_Given", contravariant=True)
_Made = TypeVar("_Made", covariant=True)

#: A number of worker processes; "auto" is one per available core.
Workers = int | Literal["auto"]

#: Environment of workers: one thread each, since every core has a process. LP: Mesa's llvmpipe (0).
SINGLE_THREADED = {
    "LP_NUM_THREADS": "0",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "OPENCV_FOR_THREADS_NUM": "1",
}
#: Width of llvmpipe's vectors, bits, as on processors with AVX2; its code depends on the width.
_VECTORS = {"LP_NATIVE_VECTOR_WIDTH": "256"}
#: NumPy's names of processor features after Haswell; X86_V4 is the name since NumPy 2.4.
_AFTER_HASWELL = ("AVX512", "X86_V4")


def portable_environment() -> dict[str, str]:
    """Return the variables that make workers compute alike on x86-64 processors since 2013.

    Without them NumPy and llvmpipe choose code by the processor. Empty if unneeded, and elsewhere.
    """
    if platform.machine() not in ("x86_64", "AMD64"):
        return {}
    # The tables of numpy.show_runtime(): NumPy warns of features that it or the processor lacks.
    tables = import_module("numpy._core._multiarray_umath")
    here: Mapping[str, bool] = tables.__cpu_features__
    chosen: Sequence[str] = tables.__cpu_dispatch__
    disabled = [name for name in chosen if name.startswith(_AFTER_HASWELL) and here.get(name)]
    return {**_VECTORS, "NPY_DISABLE_CPU_FEATURES": " ".join(disabled)} if disabled else {}


_START = (
    "import sys; descriptor, *sys.path = sys.argv[1:];"
    f"from {__name__} import serve; serve(int(descriptor))"
)
#: Number of attempts at a task whose worker dies.
_ATTEMPTS = 2
#: Seconds between two interim results of a worker.
_REPORT_EVERY_S = 0.2


def _quota_cores(file: str = "/sys/fs/cgroup/cpu.max") -> int:
    """Return the cores that a container's quota pays for, rounded up; many without a quota."""
    try:
        quota, period = Path(file).read_text().split()
        return max(1, math.ceil(int(quota) / int(period)))
    except (OSError, ValueError):  # "max", another system, or cgroups of version 1
        return 1 << 16


def available_workers(workers: Workers = "auto") -> int:
    """Return the number of worker processes ("auto": of usable cores); ConfigError below 1."""
    if workers == "auto":
        # Some systems (macOS) do not know the usable cores of a process: take all.
        if not hasattr(os, "fork"):
            return 1
        affinity = getattr(os, "sched_getaffinity", None)
        cores = len(affinity(0)) if affinity is not None else os.cpu_count() or 1
        return min(cores, _quota_cores())
    if workers < 1:
        raise ConfigError(f"workers = {workers}: at least one is needed")
    return workers


def worker_count(text: str) -> int:
    """Parse the option ``--workers``, an integer of at least 1 or "auto". Raises ConfigError."""
    if text == "auto":
        return available_workers()
    if not (text.isascii() and text.isdigit()) or int(text) < 1:
        raise ConfigError(f"--workers {text}: give a number of at least 1, or auto")
    return int(text)


class Job(Protocol[_Given, _Made]):
    """The protocol of a worker process's work, pickled and sent to each worker once."""

    def run(self, tasks: Iterator[_Given], /) -> Iterator[_Made]:
        """Yield results in order, each after its ``Interim``; it may request tasks in advance."""
        ...

    def doing(self, task: _Given, /) -> str:
        """Describe a task in work, for the message that reports its worker's death."""
        ...


class Interim:
    """The base class of intermediate results of a task, some of which may be dropped."""


@dataclass(frozen=True)
class WorkerFailure:
    """The message that a worker cannot continue, with its error."""

    error: GlsimError


def failure_of(error: Exception, where: str = "in a worker") -> WorkerFailure:
    """Convert an exception to a WorkerFailure; errors of other libraries name the place."""
    if isinstance(error, GlsimError):
        return WorkerFailure(error)
    failure = GlsimError(f"{type(error).__name__} {where}: {error}")
    failure.add_note(traceback.format_exc())
    return WorkerFailure(failure)


@dataclass(frozen=True)
class _TaskRequest:
    """The message by which a worker asks for a task; the answer is a list of one task or none."""


class WorkerProcess:
    """The parent's handle of a worker process; ``connection`` receives its messages."""

    def __init__(self, job: Job[Any, Any], environment: Mapping[str, str] | None = None) -> None:
        """Start a process that runs ``job`` with SINGLE_THREADED and ``environment``."""
        self.connection: Connection[object, object]
        self.connection, theirs = Pipe()
        self.tasks: deque[Any] = deque()  # in work, the oldest first
        self.dismissed = False  # whether it knows that no task is left
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-c", _START, str(theirs.fileno()), *sys.path],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=2,  # libraries must not print to the parent's output
                env=os.environ | SINGLE_THREADED | dict(environment or {}),
                process_group=0,
            )
        self.send(job)

    def send(self, message: object) -> None:
        """Send a message to the worker."""
        with suppress(ConnectionError):  # the worker died: the next recv() reports it
            self.connection.send(message)

    def give(self, tasks: list[Any]) -> None:
        """Send a list with the next task; an empty list means that no task is left."""
        self.tasks.extend(tasks)
        self.dismissed = not tasks
        self.send(tasks)

    def stop(self) -> int:
        """Kill the process if it still runs, and return its exit status."""
        self.connection.close()
        self.process.kill()
        return self.process.wait()


def run_tasks(
    job: Job[_Task, _Result],
    tasks: Iterable[_Task],
    processes: int,
    environment: Mapping[str, str] | None = None,
) -> Iterator[_Result]:
    """Yield the results of worker processes as they arrive; closing the iterator stops the workers.

    A worker that dies is replaced, once per task. Raises DatasetError: workers die at their start,
    or twice at a task; and the errors of ``job.run``.

    Args:
        processes: number of workers; a single worker runs here, in the order of the tasks. So do
            all on Windows, where a process inherits no socket.
        environment: variables for the workers. With any, a single worker is a process, too: NumPy
            and OpenBLAS read variables at import.
    """
    if (processes == 1 and not environment) or not hasattr(os, "fork"):
        yield from job.run(iter(tasks))
        return
    again: deque[_Task] = deque()
    source = iter(tasks)
    deaths: Counter[str] = Counter()
    workers: list[WorkerProcess] = []
    try:
        workers += (WorkerProcess(job, environment) for _ in range(processes))
        while workers:
            by_connection = {worker.connection: worker for worker in workers}
            for ready in wait(list(by_connection)):
                worker = by_connection[ready]  # type: ignore[index]
                try:
                    message: Any = worker.connection.recv()
                except (EOFError, ConnectionError):
                    workers.remove(worker)
                    if worker.tasks or not worker.dismissed:
                        _report_death(job, worker, deaths)
                        again.extend(worker.tasks)
                        workers.append(WorkerProcess(job, environment))
                    worker.stop()
                    continue
                if isinstance(message, _TaskRequest):
                    worker.give([again.popleft()] if again else list(islice(source, 1)))
                elif isinstance(message, WorkerFailure):
                    raise message.error
                else:
                    if not isinstance(message, Interim):
                        worker.tasks.popleft()
                    yield message
    finally:
        for worker in workers:
            worker.stop()


def _report_death(job: Job[_Task, Any], worker: WorkerProcess, deaths: Counter[str]) -> None:
    """Log the death of a worker, or raise DatasetError if its task has no attempts left."""
    status = worker.process.wait()
    if status == 0:
        how = "ended early"
    elif status > 0:
        how = f"ended with status {status}"
    else:
        how = f"was killed by {signal.Signals(-status).name}"
        if -status == signal.SIGKILL:
            how += " (out of memory?)"
    doing = f" while {job.doing(worker.tasks[0])}" if worker.tasks else ""
    problem = f"worker process {worker.process.pid} {how}{doing}"
    deaths[doing] += 1
    if deaths[doing] >= _ATTEMPTS:
        raise DatasetError(
            f"{problem}, for the second time: what is complete is kept; run the same command again "
            "to continue, with fewer workers if memory is short"
        )
    log.warning("%s: another one takes over", problem)


def serve(descriptor: int) -> None:
    """Run the first job received from a socket's ``descriptor``; send its results and errors."""
    connection: Connection[Any, Any] = Connection(descriptor)
    parent, reported_s = os.getppid(), time.monotonic()
    try:
        try:
            for result in connection.recv().run(_tasks(connection)):
                now_s = time.monotonic()
                if not isinstance(result, Interim) or now_s - reported_s > _REPORT_EVERY_S:
                    connection.send(result)
                    reported_s = now_s
                if os.getppid() != parent:
                    sys.exit(1)  # the parent was killed: free its locks for the next run at once
        except (EOFError, ConnectionError):
            raise
        except Exception as error:
            connection.send(failure_of(error))
    except (EOFError, ConnectionError):
        sys.exit(1)  # nobody listens any more


def _tasks(connection: Connection[Any, Any]) -> Iterator[Any]:
    while True:
        connection.send(_TaskRequest())
        answer = connection.recv()
        if not answer:
            return
        yield from answer
