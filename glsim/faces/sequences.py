"""Frames of FACS performances, shared by all generated sources."""

from __future__ import annotations

import numpy as np

from glsim.errors import ConfigError
from glsim.faces.base import ComputedKeys, FaceKey
from glsim.faces.performance import performance_for, sequence_name, sequence_number
from glsim.settings.seeds import rng_for


class PerformanceKeys(ComputedKeys):
    """The keys that ``performance_frames`` describes."""

    def __init__(
        self,
        seed: int,
        subject: str,
        count: int,
        frames_per_sequence: int,
        frames_per_second: float | None,
    ) -> None:
        self._seed, self._subject, self._count = seed, subject, count
        self._length, self._rate = frames_per_sequence, frames_per_second
        self._last: tuple[int, list[FaceKey]] = -1, []

    @property
    def words(self) -> tuple[object, ...]:
        """The arguments."""
        return self._seed, self._subject, self._count, self._length, self._rate

    def __len__(self) -> int:
        return self._count

    def _key(self, number: int) -> FaceKey:
        sequence, frame = divmod(number, self._length)
        if self._last[0] != sequence:  # neighbours are mostly asked for one after another
            self._last = sequence, self._sequence(sequence)
        return self._last[1][frame]

    def _sequence(self, number: int) -> list[FaceKey]:
        """Return the keys of one sequence."""
        length = min(self._length, self._count - number * self._length)
        performance = performance_for(self._seed, self._subject, number)
        name = sequence_name(number, performance)
        times = performance.frame_times(length)
        if self._rate is not None:
            free_s = max(0.0, performance.duration_s - (self._length - 1) / self._rate)
            start_s = free_s * rng_for(self._seed, "clip", self._subject, number).random()
            times = start_s + np.arange(length) / self._rate
        return [FaceKey(self._subject, name, frame, float(t)) for frame, t in enumerate(times)]


def performance_frames(
    seed: int,
    subject: str,
    count: int | None,
    frames_per_sequence: int,
    frames_per_second: float | None = None,
) -> PerformanceKeys:
    """Return the keys of the first ``count`` frames of a subject, sequence by sequence.

    Each sequence, also a shorter last one, runs from neutral to neutral and includes the peak. With
    ``frames_per_second`` it is a part of that performance instead, at a time drawn for the
    sequence; one that is longer than the performance starts with it and ends with a neutral face.
    Raises ConfigError for None: there is no last frame.
    """
    if count is None:
        raise ConfigError("these faces never end: give a number of frames per subject")
    return PerformanceKeys(seed, subject, count, frames_per_sequence, frames_per_second)


def performance_expression(seed: int, key: FaceKey) -> dict[str, float]:
    """Return action unit -> intensity of a frame, without zeros.

    Raises ConfigError for a key of another source.
    """
    try:
        number = sequence_number(key.sequence)
    except ValueError as error:
        raise ConfigError(f"{key.subject}: {error}") from None
    return performance_for(seed, key.subject, number).at(key.time_s)
