"""The worker process: asks the parent for chunks, renders and writes them, reports progress."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection

from glsim.dataset.chunk_writer import ChunkProgress, RenderJob, render_chunks
from glsim.dataset.chunks import Chunk
from glsim.dataset.records import ChunkSummary
from glsim.errors import GlsimError

#: Seconds between two reports within a chunk.
_REPORT_EVERY_S = 0.2


@dataclass(frozen=True)
class ChunkRequest:
    """The message that asks for a chunk; the answer is a Chunk, or None if there are no more."""


def work(connection: Connection[object, object]) -> None:
    """Render chunks until there are no more. The first message received is the RenderJob."""
    parent = os.getppid()

    def chunks() -> Iterator[Chunk]:
        while True:
            connection.send(ChunkRequest())
            chunk = connection.recv()
            if not isinstance(chunk, Chunk):
                return
            yield chunk

    job = connection.recv()
    if not isinstance(job, RenderJob):
        raise GlsimError("a worker process received no job")
    reported = time.monotonic()
    for event in render_chunks(job, chunks()):
        now = time.monotonic()
        if isinstance(event, ChunkSummary) or now - reported > _REPORT_EVERY_S:
            connection.send(event)
            reported = now
        if isinstance(event, ChunkProgress) and os.getppid() != parent:
            sys.exit(1)  # the parent was killed: free the folder for the next run at once
