"""Frames of faces that perform FACS sequences: the part every generated source shares."""

from __future__ import annotations

from glsim.errors import ConfigError
from glsim.faces.base import FaceKey
from glsim.faces.performance import performance_for, sequence_name, sequence_number


def performed_frames(
    seed: int, subject: str, count: int | None, frames_per_sequence: int
) -> list[FaceKey]:
    """The first ``count`` frames of a subject, sequence by sequence.

    A sequence runs from neutral to neutral with the peak among its frames; the last one does so
    too, with as many frames as are left. Raises ConfigError for None: there is no last frame.
    """
    if count is None:
        raise ConfigError("these faces never end: give a number of frames a subject")
    keys: list[FaceKey] = []
    number = 0
    while len(keys) < count:
        length = min(frames_per_sequence, count - len(keys))
        performance = performance_for(seed, subject, number)
        name = sequence_name(number, performance)
        times = performance.frame_times(length)
        keys += [FaceKey(subject, name, frame, float(time)) for frame, time in enumerate(times)]
        number += 1
    return keys


def performed_expression(seed: int, key: FaceKey) -> dict[str, float]:
    """Action unit -> intensity of a frame, zeros left out. Raises ConfigError: a foreign key."""
    try:
        number = sequence_number(key.sequence)
    except ValueError as error:
        raise ConfigError(f"{key.subject}: {error}") from None
    return performance_for(seed, key.subject, number).at(key.time_s)
