"""A worker process: asks for chunks over a socket, renders and writes them, reports.

Each worker has a socket of its own, so that one that is killed can spoil nothing that others share.
"""

from __future__ import annotations

import os
import sys
import time
import traceback
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


@dataclass(frozen=True)
class Failed:
    """A worker cannot go on; trace is empty for errors that glsim raises on purpose."""

    error: GlsimError
    trace: str = ""


def main(descriptor: int) -> None:
    """Work until there are no more chunks. ``descriptor``: this end of the socket."""
    parent = os.getppid()
    connection: Connection[object, object] = Connection(descriptor)
    try:
        try:
            _work(connection, parent)
        except GlsimError as error:
            connection.send(Failed(error))
        except (EOFError, ConnectionError):
            raise
        except Exception as error:
            message = GlsimError(f"{type(error).__name__} in a worker: {error}")
            connection.send(Failed(message, traceback.format_exc()))
    except (EOFError, ConnectionError):
        sys.exit(1)  # the parent is gone: nobody to tell


def _work(connection: Connection[object, object], parent: int) -> None:
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
