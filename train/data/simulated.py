"""Pairs that are rendered while the network trains: no disk, no end, no face twice the same."""

from __future__ import annotations

import logging
import zlib
from collections import deque
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import DataLoader, IterableDataset, get_worker_info

from glsim.config import Settings, load_settings
from glsim.errors import ConfigError, MeshError
from glsim.frame import Frame, Skipped, to_mm
from glsim.pipeline import open_sources, simulate
from glsim.plan import Task
from glsim.sensor import sensor_of

from .stream import LANES, Place, Stream, people_of

log = logging.getLogger(__name__)

#: kinect-v2 at any distance, pose and set of sensor parameters that a user may have.
RANDOMISED = Path(__file__).parent / "randomised.toml"

#: Batches that a worker may be ahead: blocks are rendered in steps, a training is fed evenly.
_PREFETCH = 8


def randomised(
    assignments: Iterable[str] = (), overrides: Mapping[str, Any] | None = None
) -> Settings:
    """The training distribution for a denoiser of a Kinect V2, see randomised.toml.

    assignments and overrides: changes, as in ``glsim.load_settings``. Its stages are those of
    kinect-v2: another sensor needs settings of its own. Raises ConfigError.
    """
    return load_settings(RANDOMISED, assignments, overrides)


class SimulatedPairs(IterableDataset[tuple[Tensor, Tensor]]):
    """Batches (noisy_mm, clean_mm), each (batch, 1, H, W) float32 millimetres, 0 = no return.

    ``loader`` makes the DataLoader for it. One of your own must have ``batch_size=None`` (batches
    are made here) and, as OpenGL does not survive a fork, a ``multiprocessing_context`` of
    "forkserver" or "spawn". The sequence of batches is a function of (settings, batch, reuse,
    split, seed), whatever the number of workers; each iteration begins at batch ``start``.
    """

    def __init__(
        self,
        settings: Settings,
        *,
        batch: int = 4,
        seed: int = 0,
        split: str = "train",
        reuse: int = 1,
        start: int = 0,
        length: int | None = None,
        backend: str | None = None,
    ) -> None:
        """settings: of the faces, the poses, the sensor and the crop; its seed says who the people
        are, and ``seed`` which of their frames come in which order with what noise.

        reuse: how often a pair is given before it is dropped. 1 renders each anew; with more, the
        rendering costs that much less a batch, and the network sees less that is new. A pair's
        uses are some hundred batches apart at most (a block of a lane, see ``stream``).
        start: number of the first batch, to resume. length: batches of an iteration; without end
        if left out. backend: as in ``glsim.simulate``.

        A face that cannot be rendered is replaced by another of its block. Raises ConfigError;
        while iterating also MeshError (a whole block of bad faces, or one if settings.strict) and
        DeviceError.
        """
        for name, value, least in (("batch", batch, 1), ("reuse", reuse, 1), ("start", start, 0)):
            if value < least:
                raise ConfigError(f"{name} is {value}: give {least} or more")
        if length is not None and length < 0:
            raise ConfigError(f"length is {length}: give 0 or more")
        sensor_of(settings)  # its parameters are checked here, not later in a worker
        sources = open_sources(settings)
        people = people_of(settings, sources, split)
        self.stream = Stream(settings, sources, people, split, batch, reuse, seed)
        self._start, self._length, self._backend = start, length, backend

    def __len__(self) -> int:
        """Batches of an iteration. TypeError, as the loader expects, if it has no end."""
        if self._length is None:
            raise TypeError("SimulatedPairs without a length never ends")
        return self._length

    def fingerprint(self) -> dict[str, Any]:
        """What a checkpoint says of the data it has seen; equal for equal sequences of batches."""
        settings = self.stream.settings
        text = settings.model_dump_json(exclude={"source": {"__all__": {"root"}}})
        return {
            "simulated": f"{zlib.crc32(text.encode()):08x}",
            "sensor": settings.sensor,
            "sources": [source.kind for source in settings.source],
            "seed": self.stream.seed,
            "split": self.stream.split,
            "batch": self.stream.batch,
            "reuse": self.stream.reuse,
        }

    def loader(self, workers: int = 1) -> DataLoader[tuple[Tensor, Tensor]]:
        """Batches in order, rendered by so many processes (0: by this one). Raises ConfigError.

        A script that uses workers needs ``if __name__ == "__main__":``.
        """
        _check_workers(workers)
        apart = {"multiprocessing_context": "forkserver", "prefetch_factor": _PREFETCH}
        return DataLoader(
            self,
            batch_size=None,
            num_workers=workers,
            pin_memory=torch.cuda.is_available(),
            generator=torch.Generator(),  # of its own: the global one is the training's
            **(apart if workers else {}),
        )

    def __iter__(self) -> Iterator[tuple[Tensor, Tensor]]:
        """The batches, or in a worker of a DataLoader those of its lanes."""
        info = get_worker_info()
        worker, workers = (0, 1) if info is None else (info.id, info.num_workers)
        _check_workers(workers)
        # The loader asks its workers in turn, from worker 0, whatever the first batch is.
        numbers: Iterable[int] = count(self._start + worker, workers)
        if self._length is not None:
            numbers = range(self._start + worker, self._start + self._length, workers)
        places = (self.stream.place(number) for number in numbers)
        lanes = [
            (self._start + worker + step * workers) % LANES for step in range(LANES // workers)
        ]
        first = {
            place.lane: place.block
            for place in map(self.stream.place, range(self._start, self._start + LANES))
        }
        blocks = _Blocks(self.stream, [(lane, first[lane]) for lane in lanes], self._backend)
        try:
            for place in places:
                yield blocks.batch(place)
        finally:
            blocks.close()


def _check_workers(workers: int) -> None:
    if workers < 0 or (workers and LANES % workers):
        fit = ", ".join(str(n) for n in range(LANES + 1) if n == 0 or LANES % n == 0)
        raise ConfigError(f"{workers} workers cannot share {LANES} lanes: take one of {fit}")


class _Blocks:
    """The blocks of some lanes, rendered a little ahead of their use.

    lanes: numbers, with the first block of each, in the order in which they are asked for.
    """

    def __init__(self, stream: Stream, lanes: list[tuple[int, int]], backend: str | None) -> None:
        self._stream, self._lanes = stream, lanes
        self._planned: deque[tuple[int, int]] = deque()  # lane and block of the frames to come
        self._made: dict[tuple[int, int], list[Frame | Skipped]] = {}
        self._pairs: dict[tuple[int, int], list[NDArray[np.float32]]] = {}
        self._owed = 0.0
        frames = simulate(
            stream.settings,
            self._tasks(),
            sources=stream.sources,
            backend=backend,
            layers=("clean", "noisy"),
        )
        self._frames = cast("Generator[Frame | Skipped]", frames)

    def _tasks(self) -> Iterator[Task]:
        for further in count():
            for lane, first in self._lanes:
                for task in self._stream.tasks(lane, first + further):
                    self._planned.append((lane, first + further))
                    yield task

    def batch(self, place: Place) -> tuple[Tensor, Tensor]:
        """A batch, and the rendering that is due by it."""
        block = (place.lane, place.block)
        self._pairs.pop((place.lane, place.block - 1), None)
        while block not in self._pairs:
            self._render()
        self._owed += self._stream.batch / self._stream.reuse
        while self._owed >= 1:
            self._owed -= 1
            self._render()
        pairs = self._pairs[block]
        both = torch.from_numpy(np.stack([pairs[number] for number in place.pairs], axis=1))
        return both[0][:, None], both[1][:, None]

    def _render(self) -> None:
        """One frame more."""
        result = next(self._frames)
        block = self._planned.popleft()
        made = self._made.setdefault(block, [])
        made.append(result)
        if len(made) == self._stream.block_pairs:
            frames = without_gaps(self._made.pop(block))
            self._pairs[block] = [_pair_mm(frame) for frame in frames]

    def close(self) -> None:
        """Release the OpenGL context."""
        self._frames.close()


def without_gaps(made: Sequence[Frame | Skipped]) -> list[Frame]:
    """Each skipped frame replaced by the next good one. Raises MeshError if none is good."""
    good = [place for place, result in enumerate(made) if isinstance(result, Frame)]
    bad = [result for result in made if isinstance(result, Skipped)]
    if not good:
        raise MeshError(
            f"none of {len(made)} faces can be rendered, e.g. {bad[0].key}: {bad[0].why}"
        )
    for result in bad:
        log.warning("%s: left out, another takes its place: %s", result.key.subject, result.why)
    filled = []
    for place in range(len(made)):
        taken = made[min((other for other in good if other >= place), default=good[0])]
        assert isinstance(taken, Frame)
        filled.append(taken)
    return filled


def _pair_mm(frame: Frame) -> NDArray[np.float32]:
    """(2, H, W): noisy, clean, rounded as in files."""
    return to_mm(np.stack([frame.noisy, frame.clean]), frame.depth_unit_mm, frame.depth_offset_mm)
