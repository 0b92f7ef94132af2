"""A worker process: asks for chunks over its socket, renders and writes them, reports."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection

from glsim.dataset.layout import Chunk
from glsim.dataset.record import ChunkSummary
from glsim.dataset.work import Job, Started, render
from glsim.errors import GlsimError

#: Seconds between two reports within a chunk.
_REPORT_EVERY_S = 0.2


@dataclass(frozen=True)
class Ask:
    """A worker wants a chunk; the answer is a Chunk, or None if there are no more."""


def work(connection: Connection[object, object]) -> None:
    """Until there are no more chunks; the first message is the Job."""
    parent = os.getppid()

    def chunks() -> Iterator[Chunk]:
        while True:
            connection.send(Ask())
            chunk = connection.recv()
            if not isinstance(chunk, Chunk):
                return
            yield chunk

    job = connection.recv()
    if not isinstance(job, Job):
        raise GlsimError("a worker was not told what to do")
    reported = time.monotonic()
    for event in render(job, chunks()):
        now = time.monotonic()
        if isinstance(event, ChunkSummary) or now - reported > _REPORT_EVERY_S:
            connection.send(event)
            reported = now
        if isinstance(event, Started) and os.getppid() != parent:
            sys.exit(1)  # the parent was killed: free the folder for the next run at once
