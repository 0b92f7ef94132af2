"""Frames of depth maps for denoisers, and their neighbours in time."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from glsim.denoise.protocol import Depth
from glsim.errors import DatasetError
from glsim.geometry.camera import Intrinsics

#: A frame with a smaller median depth, mm, is in metres or another unit: no depth camera measures
#: nearer.
_NEAREST_MM = 50.0


class Key(NamedTuple):
    """Identifies a frame. Statistics are over subjects; a sequence is ordered in time."""

    subject: str
    sequence: str
    frame: int

    def __str__(self) -> str:
        return f"{self.subject}/{self.sequence}_{self.frame:05d}"


@dataclass(frozen=True, eq=False)
class Sample:
    """A pair of depth maps, (H, W) millimetres, 0 = no depth, with their camera.

    regions: (H, W) numbers of face regions (see ``Frames.regions``), if the set has them.
    """

    clean_mm: Depth
    noisy_mm: Depth
    intrinsics: Intrinsics
    regions: NDArray[np.uint8] | None = None


class Frames(Protocol):
    """Frames by number. Those of a sequence are consecutive, in the order of time."""

    #: A text that changes whenever the frames may have changed.
    identity: str
    #: Labelled face regions: name -> number. Empty without labels.
    regions: Mapping[str, int]

    def __len__(self) -> int:
        """Return the number of frames."""
        ...

    def key(self, number: int) -> Key:
        """Return the key of a frame."""
        ...

    def load(self, number: int) -> Sample:
        """Read a frame. Raises DatasetError if it is missing, damaged, or no depth-map pair."""
        ...

    def infrared(self, number: int) -> NDArray[Any]:
        """Read a frame's infrared, (H, W) counts. Raises DatasetError if there is none."""
        ...


def check_millimetres(depth: Depth, where: str) -> None:
    """Raise DatasetError if half of the depths are nearer than any camera measures (metres)."""
    values = depth[depth > 0]
    if values.size and (middle := float(np.median(values))) < _NEAREST_MM:
        raise DatasetError(
            f"{where}: its middle depth is {middle:g} mm: is it in metres instead of millimetres?"
        )


class Stacks:
    """Reads frames with their neighbours in time; if read in order, each file is read once."""

    def __init__(self, frames: Frames, before: int, after: int) -> None:
        self._frames, self._before, self._after = frames, before, after
        self._cache: OrderedDict[int, Sample | DatasetError] = OrderedDict()

    def sample(self, number: int) -> Sample:
        """Read one frame. Raises DatasetError, also for a frame that failed before."""
        if number not in self._cache:
            try:
                self._cache[number] = self._frames.load(number)
            except DatasetError as error:
                self._cache[number] = error
            while len(self._cache) > self._before + self._after + 1:
                self._cache.popitem(last=False)
        cached = self._cache[number]
        if isinstance(cached, DatasetError):
            raise cached
        return cached

    def around(self, number: int, before: int, after: int) -> tuple[Depth, int]:
        """Return the (T, H, W) noisy frames around a frame, millimetres, and its index among them.

        Neighbours have the same sequence and size; unreadable ones are left out. Raises
        DatasetError if the frame itself cannot be read.
        """
        sample = self.sample(number)
        key = self._frames.key(number)
        stack: list[Depth] = []
        now = 0
        first, last = max(0, number - before), min(len(self._frames) - 1, number + after)
        for other in range(first, last + 1):
            if other == number:
                now = len(stack)
                stack.append(sample.noisy_mm)
            elif self._frames.key(other)[:2] == key[:2]:
                try:
                    neighbour = self.sample(other).noisy_mm
                except DatasetError:
                    continue
                if neighbour.shape == sample.noisy_mm.shape:
                    stack.append(neighbour)
        return np.stack(stack), now
