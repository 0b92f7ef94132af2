"""Pairs rendered during the training, as an endless PyTorch data set of batches."""

from __future__ import annotations

import logging
import zlib
from collections import deque
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from itertools import count
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import DataLoader, IterableDataset, get_worker_info

from glsim.core.depth_protocol import DepthProtocol, stored_protocol
from glsim.core.errors import ConfigError
from glsim.networks.inputs import DEPTH_ALONE, NetworkInputs
from glsim.sensors.sensor import sensor_of
from glsim.settings.schema import Settings, load_settings
from glsim.simulation.frame import Frame, Skipped
from glsim.simulation.pipeline import open_sources, simulate
from glsim.simulation.plan.tasks import Task
from glsim.train.data.checks import Target, entries_of
from glsim.train.data.stream import LANES, BatchPlace, BatchStream, split_people

log = logging.getLogger(__name__)

#: Number of batches that a worker renders in advance; blocks then cause no waits.
_PREFETCH = 8


def randomised(
    assignments: Iterable[str] = (), overrides: Mapping[str, Any] | None = None
) -> Settings:
    """Load the preset "randomised": settings to train a denoiser of a Kinect V2.

    ``assignments`` and ``overrides`` change it, as in ``glsim.load_settings``. Its stages belong to
    kinect-v2: another sensor needs other settings. Raises ConfigError.
    """
    return load_settings(None, assignments, overrides, preset="randomised")


class SimulatedPairs(IterableDataset[tuple[Tensor, Tensor]]):
    """Batches (noisy_mm, target_mm), each (batch, 1, H, W) float32 millimetres, 0 = no return.

    With further ``inputs``, noisy_mm is the stack of all inputs, (batch, C, H, W). ``loader`` makes
    the DataLoader; another DataLoader needs ``batch_size=None`` (the data set makes batches) and a
    ``multiprocessing_context`` of "forkserver" or "spawn" (OpenGL does not survive a fork). The
    sequence of batches is a function of (settings, batch, reuse, split, seed) for any number of
    workers; each iteration begins at batch ``start``.
    """

    def __init__(
        self,
        settings: Settings,
        *,
        batch: int = 4,
        seed: int = 0,
        split: str = "train",
        inputs: NetworkInputs = DEPTH_ALONE,
        vary_inputs: bool = False,
        reuse: int = 1,
        start: int = 0,
        length: int | None = None,
        backend: str | None = None,
        target: Target = "clean",
        protocol: DepthProtocol | None = None,
    ) -> None:
        """Open the face sources and plan the stream of batches.

        A face that cannot be rendered is replaced by another face of its block. Raises ConfigError.
        The iteration may raise MeshError (all faces of a block are bad, or one face if
        settings.strict) and DeviceError.

        Args:
            settings: faces, poses, sensor and crop; ``settings.seed`` determines the people, and
                ``seed`` the choice and order of their frames and the noise.
            inputs: inputs of the network besides depth. Neighbours in time are frames of one
                sequence, whose settings should not change (``redraw = "sequence"``), at the frame
                rate of the camera (``source.frames_per_second``).
            vary_inputs: see ``Augmentation``.
            reuse: number of uses of each pair, within its block of batches (see ``stream``). It
                divides the rendering time per batch, and the number of different pairs.
            start: number of the first batch, to resume.
            length: batches per iteration; default: endless.
            backend: as in ``glsim.simulate``.
            target, protocol: see ``StoredPairs``. Default protocol: of ``settings.output``.
        """
        limits = {"batch": (batch, 1), "reuse": (reuse, 1), "start": (start, 0)}
        for name, (value, least) in (limits | {"length": (length or 0, 0)}).items():
            if value < least:
                raise ConfigError(f"{name} is {value}: give {least} or more")
        sensor_of(settings)  # checks its parameters now, not later in a worker
        sources = open_sources(settings)
        people = split_people(settings, sources, split)
        self.protocol: DepthProtocol = protocol or stored_protocol(settings.output.nearest_to_mm)
        self.stream = BatchStream(
            settings, sources, people, split, batch, reuse, seed, inputs, vary_inputs, target,
            self.protocol, backend,
        )  # fmt: skip
        self._start, self._length = start, length

    def __len__(self) -> int:
        """Number of batches per iteration. Raises TypeError (for DataLoader) if endless."""
        if self._length is None:
            raise TypeError("SimulatedPairs without a length never ends")
        return self._length

    def fingerprint(self) -> dict[str, Any]:
        """Return the identity of the data for checkpoints: equal for equal sequences of batches."""
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
            **entries_of(target=self.stream.target, protocol=self.protocol),
        } | ({"inputs": list(inputs)} if (inputs := self.stream.inputs) != DEPTH_ALONE else {})

    def loader(self, workers: int = 1) -> DataLoader[tuple[Tensor, Tensor]]:
        """Create a DataLoader that yields the batches in order. Raises ConfigError.

        Args:
            workers: processes that render; 0: this one. A script that uses workers needs
                ``if __name__ == "__main__":``.
        """
        _check_workers(workers)
        return DataLoader(
            self,
            batch_size=None,
            num_workers=workers,
            pin_memory=torch.cuda.is_available(),
            generator=torch.Generator(),  # not the global one, whose state checkpoints hold
            multiprocessing_context="forkserver" if workers else None,
            prefetch_factor=_PREFETCH if workers else None,
        )

    def __iter__(self) -> Iterator[tuple[Tensor, Tensor]]:
        """Yield the batches; a worker process of a DataLoader yields the batches of its lanes."""
        info = get_worker_info()
        worker, workers = (0, 1) if info is None else (info.id, info.num_workers)
        _check_workers(workers)
        # The loader asks its workers in turn, starting with worker 0 for any first batch.
        start = self._start + worker
        numbers: Iterable[int] = count(start, workers)
        if self._length is not None:
            numbers = range(start, self._start + self._length, workers)
        firsts = map(self.stream.place, range(start, start + LANES, workers))
        order = [(place.lane, place.block) for place in firsts]
        with closing(_BlockRenderer(self.stream, order)) as blocks:
            for place in map(self.stream.place, numbers):
                pairs = blocks.pairs(place)
                images = torch.from_numpy(np.stack([pairs[number] for number in place.pairs]))
                yield images[:, :-1], images[:, -1:]


def _check_workers(workers: int) -> None:
    if workers < 0 or (workers and LANES % workers):
        allowed = ", ".join(str(n) for n in range(LANES + 1) if n == 0 or LANES % n == 0)
        raise ConfigError(f"{workers} workers cannot share {LANES} lanes: take one of {allowed}")


class _BlockRenderer:
    """Renderer of the blocks of some lanes, in the order and a little ahead of their use."""

    def __init__(self, stream: BatchStream, lanes: list[tuple[int, int]]) -> None:
        self._stream, self._lanes = stream, lanes
        self._planned: deque[tuple[int, int]] = deque()  # (lane, block) of each frame to come
        self._rendered: dict[tuple[int, int], list[Frame | Skipped]] = {}  # unfinished blocks
        self._pairs: dict[tuple[int, int], list[NDArray[np.float32]]] = {}
        self._frames_due = 0.0
        frames = simulate(
            self._stream.settings, self._tasks(), sources=self._stream.sources,
            backend=stream.backend, layers=("noisy", stream.target),
        )  # fmt: skip
        self._frames = cast("Generator[Frame | Skipped]", frames)

    def _tasks(self) -> Iterator[Task]:
        for later in count():
            for lane, first in self._lanes:
                for task in self._stream.tasks(lane, first + later):
                    self._planned.append((lane, first + later))
                    yield task

    def pairs(self, place: BatchPlace) -> Sequence[NDArray[np.float32]]:
        """Return all pairs of a batch's block; also render batch / reuse frames of later blocks."""
        block = (place.lane, place.block)
        self._pairs.pop((place.lane, place.block - 1), None)
        while block not in self._pairs:
            self._render_frame()
        self._frames_due += self._stream.batch / self._stream.reuse
        while self._frames_due >= 1:
            self._frames_due -= 1
            self._render_frame()
        return self._pairs[block]

    def _render_frame(self) -> None:
        """Render the next frame; after the last frame of a block, store the block's pairs."""
        result = next(self._frames)
        block = self._planned.popleft()
        rendered = self._rendered.setdefault(block, [])
        rendered.append(result)
        if len(rendered) == self._stream.block_pairs:
            self._pairs[block] = self._stream.images(self._rendered.pop(block), *block)

    def close(self) -> None:
        """Release the OpenGL context."""
        self._frames.close()
