"""Progress and results of a run."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from glsim.data.chunks import Part
from glsim.data.records import ChunkSummary

#: Seconds between two calls of ``progress``.
_PROGRESS_EVERY_S = 0.1


@dataclass(frozen=True)
class FrameProgress:
    """The progress of a run: ``done`` of ``total`` frames, including skipped and reused frames.

    ``reused`` frames were completed by an earlier run; ``bytes`` is the size of all images.
    """

    done: int
    total: int
    skipped: int
    reused: int = 0
    bytes: int = 0


Progress = Callable[[FrameProgress], None]


@dataclass(frozen=True)
class GenerateSummary:
    """The results of a run, and the counts of the whole data set.

    Attributes:
        frames, subjects: split -> number.
        skipped: reason -> number of frames.
        rendered, reused: frames of this run and of earlier runs, skipped frames included.
        cpu_seconds: CPU time of this process, its workers and the nodes of its cluster.
        notes: assumptions about the input, in lines for the user.
    """

    frames: Mapping[str, int]
    subjects: Mapping[str, int]
    skipped: Mapping[str, int]
    rendered: int
    reused: int
    bytes: int
    seconds: float
    cpu_seconds: float
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class PartSummary:
    """The results of a run that made one part.

    Attributes:
        missing: the parts that are not complete yet, as in "parts 3, 7 of 64".
        dataset: the whole, if all parts are complete.
    """

    part: Part
    frames: int
    skipped: int
    rendered: int
    reused: int
    seconds: float
    missing: str
    dataset: GenerateSummary | None = None


@dataclass
class RunCounts:
    """Counters of frames, bytes and time of a run, which report to ``callback``."""

    total: int
    callback: Progress | None = None
    frames: int = 0
    skipped: int = 0
    reused: int = 0
    bytes: int = 0
    in_progress: dict[int, int] = field(default_factory=dict)  # chunk number -> frames done
    nodes_cpu_s: float = 0.0
    reported_s: float = 0.0
    started_s: float = field(default_factory=time.monotonic)
    cpu_started_s: float = field(default_factory=lambda: _cpu_seconds())

    def complete(self, summary: ChunkSummary, *, reused: bool = False) -> None:
        """Add the frames and bytes of a complete chunk."""
        self.in_progress.pop(summary.chunk, None)
        self.frames += summary.frames
        self.skipped += summary.skipped
        self.reused += summary.total if reused else 0
        self.bytes += summary.bytes
        self.report()

    def report(self, *, last: bool = False) -> None:
        """Call ``callback`` with the progress, unless its last call was very recent."""
        now = time.monotonic()
        if self.callback is None or (not last and now - self.reported_s < _PROGRESS_EVERY_S):
            return
        self.reported_s = now
        done = self.frames + self.skipped + sum(self.in_progress.values())
        self.callback(FrameProgress(done, self.total, self.skipped, self.reused, self.bytes))

    @property
    def rendered(self) -> int:
        """Number of frames that this run made or skipped, without reused frames."""
        return self.frames + self.skipped - self.reused

    @property
    def seconds(self) -> float:
        """Wall time since the start, seconds."""
        return time.monotonic() - self.started_s

    @property
    def cpu_seconds(self) -> float:
        """CPU time since the start, seconds, of this machine and of the nodes of a cluster."""
        return _cpu_seconds() - self.cpu_started_s + self.nodes_cpu_s


def _cpu_seconds() -> float:
    """Return the CPU seconds of this process and of its ended children."""
    return time.process_time() + sum(os.times()[2:4])
