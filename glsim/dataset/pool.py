"""The parent's side of the worker processes: who renders which chunk, and what if one dies."""

from __future__ import annotations

import logging
import signal
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from multiprocessing.connection import wait
from types import TracebackType

from glsim.dataset.layout import Chunk
from glsim.dataset.record import ChunkSummary
from glsim.dataset.work import Event, Job, Started
from glsim.dataset.worker import Ask
from glsim.errors import DatasetError
from glsim.processes import Failed, Process

log = logging.getLogger(__name__)

#: A chunk that was in work when a worker died is tried this often in all.
_ATTEMPTS = 2


class _Worker(Process):
    def __init__(self, job: Job) -> None:
        super().__init__("glsim.dataset.worker")
        self.chunks: list[Chunk] = []  # in work, the oldest first
        self.dismissed = False  # it was told that there are no more
        self.send(job)


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
