"""The parent's side of the worker processes.

Workers are started as ``python -c``, not through multiprocessing: they get single-threaded
libraries by their environment (read before NumPy is loaded, and the parent's stays as it is), a
script needs no ``if __name__ == "__main__"``, and a Ctrl-C in the terminal reaches the parent only.
"""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from types import TracebackType

from glsim.dataset.layout import Chunk
from glsim.dataset.record import ChunkSummary
from glsim.dataset.work import Event, Job, Started
from glsim.dataset.worker import Ask, Failed
from glsim.errors import DatasetError

log = logging.getLogger(__name__)

#: The environment of workers: one thread each, as there is a process a core already. The first is
#: for Mesa's llvmpipe (0 = none besides the caller's), the last for OpenCV.
SINGLE_THREADED = {
    "LP_NUM_THREADS": "0",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "OPENCV_FOR_THREADS_NUM": "1",
}
_START = (
    "import sys; descriptor, *sys.path = sys.argv[1:];"
    "from glsim.dataset.worker import main; main(int(descriptor))"
)
#: A chunk that was in work when a worker died is tried this often in all.
_ATTEMPTS = 2


class _Worker:
    def __init__(self, job: Job) -> None:
        self.connection: Connection[object, object]
        self.chunks: list[Chunk] = []  # in work, the oldest first
        self.dismissed = False  # it was told that there are no more
        self.connection, theirs = Pipe()
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-c", _START, str(theirs.fileno()), *sys.path],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=2,  # what libraries print is no part of the parent's output
                env=os.environ | SINGLE_THREADED,
                process_group=0,
            )
        self.send(job)

    def send(self, message: object) -> None:
        with suppress(ConnectionError):  # it died: the next wait() says so
            self.connection.send(message)

    def stop(self) -> int:
        """End it, if need be by force; what it had not recorded is done again later."""
        self.connection.close()
        self.process.kill()
        return self.process.wait()


class WorkerPool:
    """Worker processes that render chunks. A context manager: leaving it ends them all."""

    def __init__(self, job: Job, count: int) -> None:
        self._job = job
        self._count = count
        self._workers: list[_Worker] = []

    def __enter__(self) -> WorkerPool:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for worker in self._workers:
            worker.stop()

    def render(self, chunks: Iterable[Chunk]) -> Iterator[Event]:
        """What the workers report, as it comes. The order of chunks is not kept.

        A worker that dies is replaced, once for any chunk. Raises what a worker raises, and
        DatasetError if workers die at their start or again at the same chunk.
        """
        waiting = deque[Chunk]()
        source = iter(chunks)
        deaths: Counter[int] = Counter()
        for _ in range(self._count):
            self._workers.append(_Worker(self._job))
        while self._workers:
            by_connection = {worker.connection: worker for worker in self._workers}
            for ready in wait(list(by_connection)):
                worker = by_connection[ready]  # type: ignore[index]
                try:
                    message = worker.connection.recv()
                except (EOFError, ConnectionError):
                    self._workers.remove(worker)
                    status = worker.process.wait()
                    worker.connection.close()
                    if worker.chunks or not worker.dismissed:
                        _explain_death(worker, status, deaths)
                        waiting.extend(worker.chunks)
                        self._workers.append(_Worker(self._job))
                    continue
                if isinstance(message, Ask):
                    chunk = waiting.popleft() if waiting else next(source, None)
                    if chunk is None:
                        worker.dismissed = True
                    else:
                        worker.chunks.append(chunk)
                    worker.send(chunk)
                elif isinstance(message, Failed):
                    if message.trace:
                        message.error.add_note(message.trace)
                    raise message.error
                elif isinstance(message, ChunkSummary | Started):
                    if isinstance(message, ChunkSummary):
                        worker.chunks = [c for c in worker.chunks if c.number != message.chunk]
                    yield message


def _explain_death(worker: _Worker, status: int, deaths: Counter[int]) -> None:
    """Warn, or raise DatasetError if it makes no sense to go on."""
    if status == 0:
        how = "ended early"
    elif status > 0:
        how = f"ended with status {status}"
    else:
        how = f"was killed by {signal.Signals(-status).name}"
        if -status == signal.SIGKILL:
            how += " (out of memory?)"
    blamed = worker.chunks[0] if worker.chunks else None
    doing = f" while rendering {blamed.tasks[0].stem} and the next frames" if blamed else ""
    what = f"worker process {worker.process.pid} {how}{doing}"
    number = blamed.number if blamed else -1
    deaths[number] += 1
    if deaths[number] >= _ATTEMPTS:
        raise DatasetError(
            f"{what}, for the second time: what is complete is kept; run the same command again "
            "to continue, with fewer workers if memory is short"
        )
    log.warning("%s: another one takes over", what)
