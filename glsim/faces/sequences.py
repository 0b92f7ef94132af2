"""Frames of FACS performances, shared by all generated sources."""

from __future__ import annotations

import numpy as np

from glsim.errors import ConfigError
from glsim.faces.base import FaceKey
from glsim.faces.performance import performance_for, rng_for, sequence_name, sequence_number


def performance_frames(
    seed: int,
    subject: str,
    count: int | None,
    frames_per_sequence: int,
    frames_per_second: float | None = None,
) -> list[FaceKey]:
    """Return the keys of the first ``count`` frames of a subject, sequence by sequence.

    Each sequence, also a shorter last one, runs from neutral to neutral and includes the peak. With
    ``frames_per_second`` it is a part of that performance instead, at a time drawn for the
    sequence; one that is longer than the performance starts with it and ends with a neutral face.
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
        if frames_per_second is not None:
            free_s = max(
                0.0, performance.duration_s - (frames_per_sequence - 1) / frames_per_second
            )
            start_s = free_s * rng_for(seed, "clip", subject, number).random()
            times = start_s + np.arange(length) / frames_per_second
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
