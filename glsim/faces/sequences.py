"""Frames of FACS performances, shared by all generated sources."""

from __future__ import annotations

from glsim.errors import ConfigError
from glsim.faces.base import FaceKey
from glsim.faces.performance import performance_for, sequence_name, sequence_number


def performance_frames(
    seed: int, subject: str, count: int | None, frames_per_sequence: int
) -> list[FaceKey]:
    """Return the keys of the first ``count`` frames of a subject, sequence by sequence.

    Each sequence, also a shorter last one, runs from neutral to neutral and includes the peak.
    Raises ConfigError for None: there is no last frame.
    """
    if count is None:
        raise ConfigError("these faces never end: give a number of frames per subject")
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


def performance_expression(seed: int, key: FaceKey) -> dict[str, float]:
    """Return action unit -> intensity of a frame, without zeros.

    Raises ConfigError for a key of another source.
    """
    try:
        number = sequence_number(key.sequence)
    except ValueError as error:
        raise ConfigError(f"{key.subject}: {error}") from None
    return performance_for(seed, key.subject, number).at(key.time_s)
