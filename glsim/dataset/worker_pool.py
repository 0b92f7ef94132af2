"""The pool of worker processes: distributes chunks and replaces workers that die."""

from __future__ import annotations

import logging
import signal
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping
from multiprocessing.connection import wait
from types import TracebackType

from glsim.dataset.chunk_writer import ChunkEvent, ChunkProgress, RenderJob
from glsim.dataset.chunks import Chunk
from glsim.dataset.records import ChunkSummary
from glsim.dataset.worker_process import ChunkRequest, work
from glsim.errors import DatasetError
from glsim.worker_processes import WorkerFailure, WorkerProcess

log = logging.getLogger(__name__)

#: Attempts per chunk, if workers die while they render it.
_ATTEMPTS = 2


class _Worker(WorkerProcess):
    def __init__(self, job: RenderJob, environment: Mapping[str, str]) -> None:
        super().__init__(work, environment)
        self.chunks: list[Chunk] = []  # being rendered, the oldest first
        self.dismissed = False  # whether it has been told that there are no more chunks
        self.send(job)


class WorkerPool:
    """Worker processes that render chunks. A context manager: its exit ends all of them.

    environment: variables for the workers, such as ``portable_environment()``.
    """

    def __init__(
        self, job: RenderJob, count: int, environment: Mapping[str, str] | None = None
    ) -> None:
        self._job = job
        self._count = count
        self._environment = environment or {}
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

    def render_chunks(self, chunks: Iterable[Chunk]) -> Iterator[ChunkEvent]:
        """Yield the workers' events as they arrive; the order of the chunks is not kept.

        A worker that dies is replaced, once per chunk. Raises the errors of workers, and
        DatasetError if workers die at their start or twice at the same chunk.
        """
        waiting = deque[Chunk]()
        source = iter(chunks)
        deaths: Counter[int] = Counter()
        for _ in range(self._count):
            self._workers.append(_Worker(self._job, self._environment))
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
                        _report_death(worker, status, deaths)
                        waiting.extend(worker.chunks)
                        self._workers.append(_Worker(self._job, self._environment))
                    continue
                if isinstance(message, ChunkRequest):
                    chunk = waiting.popleft() if waiting else next(source, None)
                    if chunk is None:
                        worker.dismissed = True
                    else:
                        worker.chunks.append(chunk)
                    worker.send(chunk)
                elif isinstance(message, WorkerFailure):
                    raise message.error
                elif isinstance(message, ChunkSummary | ChunkProgress):
                    if isinstance(message, ChunkSummary):
                        worker.chunks = [c for c in worker.chunks if c.number != message.chunk]
                    yield message


def _report_death(worker: _Worker, status: int, deaths: Counter[int]) -> None:
    """Log a warning, or raise DatasetError if the chunk has used up its attempts."""
    if status == 0:
        how = "ended early"
    elif status > 0:
        how = f"ended with status {status}"
    else:
        how = f"was killed by {signal.Signals(-status).name}"
        if -status == signal.SIGKILL:
            how += " (out of memory?)"
    chunk = worker.chunks[0] if worker.chunks else None
    doing = f" while rendering {chunk.tasks[0].stem} and the next frames" if chunk else ""
    problem = f"worker process {worker.process.pid} {how}{doing}"
    number = chunk.number if chunk else -1
    deaths[number] += 1
    if deaths[number] >= _ATTEMPTS:
        raise DatasetError(
            f"{problem}, for the second time: what is complete is kept; run the same command again "
            "to continue, with fewer workers if memory is short"
        )
    log.warning("%s: another one takes over", problem)
