"""Load the faces of tasks in batches, one batch ahead of the drawing."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor

from glsim.faces.base import BadFace, Face
from glsim.simulation.plan.tasks import Task

#: Faces per batch: a matrix product of this many rows keeps a core busy, and the vertices of a
#: batch take tens of megabytes.
_FACE_BATCH = 32

Loaded = list[tuple[Task, Face | BadFace]]


def load_ahead(
    tasks: Iterable[Task], load: Callable[[list[Task]], Loaded]
) -> Iterator[tuple[Task, Face | BadFace]]:
    """Yield tasks with their faces, in order.

    A thread loads the next batch while one is drawn, so that drawing does not wait for disks.

    Args:
        load: loads the faces of tasks that share a source.
    """
    with ThreadPoolExecutor(1, "faces") as reader:
        ahead: deque[Future[Loaded]] = deque()
        for batch in _batches(tasks):
            ahead.append(reader.submit(load, batch))
            if len(ahead) == 2:
                yield from ahead.popleft().result()
        while ahead:
            yield from ahead.popleft().result()


def _batches(tasks: Iterable[Task]) -> Iterator[list[Task]]:
    """Split tasks, in their order, into batches of one source each."""
    for _, run in itertools.groupby(tasks, key=lambda task: task.source):
        while batch := list(itertools.islice(run, _FACE_BATCH)):
            yield batch
