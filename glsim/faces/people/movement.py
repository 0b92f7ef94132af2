"""Movements of the body in time: breathing, sway, and nods of the head against the torso.

The head's own rigid motion is added by the pipeline for all generated faces; in front of a camera
on the face only what the torso does under the head is left here. Quiet standing sways by 0.5 to 1
degree below 1 Hz (D. A. Winter, Gait and Posture 3, 1995); breathing at rest is 12 to 20 a minute
and lifts the chest by 4 to 12 mm (Sherwood, Human Physiology). All functions are pure functions of
(seed, subject, sequence, time).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.pose import rotation
from glsim.core.seeds import rng_for

_Array = NDArray[np.float64]

_BREATHS_HZ: Final = (0.20, 0.33)
_CHEST_DEG: Final = (0.5, 1.0)  # of the upper spine; 5 to 9 mm at the breast bone
_SHOULDER_DEG: Final = (0.8, 1.8)  # of the collar bones
_SWAY_DEG: Final = (0.3, 0.9)
_SWAY_HZ: Final = (0.1, 0.6)
_ARM_DEG: Final = (0.4, 1.6)
#: Largest turns of the head against the torso, degrees: in view of bust or body, and of the face.
_HEAD_DEG: Final = {"face": 0.8, "bust": 4.0, "body": 5.0}
_HEAD_HZ: Final = (0.1, 1.5)
_NOD_SHARE: Final = 0.4  # of the sequences in which somebody nods
_WAVES: Final = 3


def movement(
    seed: int, subject: str, sequence: str, framing: str, time_s: float
) -> Mapping[str, _Array]:
    """Return bone -> (3, 3) further rotation at a time; the torso's is added at its bones."""
    rng = rng_for(seed, "movement", subject, sequence)
    breath = np.sin(2 * np.pi * (rng.uniform(*_BREATHS_HZ) * time_s + rng.uniform()))
    chest, shoulder = rng.uniform(*_CHEST_DEG), rng.uniform(*_SHOULDER_DEG)
    sway = [rng.uniform(*_SWAY_DEG) * _wave(rng, *_SWAY_HZ, time_s) for _ in range(3)]
    most = _HEAD_DEG[framing]
    head = [scale * most * _wave(rng, *_HEAD_HZ, time_s) for scale in (1.0, 0.6, 0.4)]
    if rng.random() < _NOD_SHARE and framing != "face":
        start, length = rng.uniform(0.1, 1.0), rng.uniform(0.4, 0.8)
        inside = np.clip((time_s - start) / length, 0.0, 1.0)
        head[1] -= rng.uniform(3.0, 8.0) * np.sin(np.pi * inside) ** 2
    # The neck undoes the breath, so that the head does not nod with it.
    turns = {
        "spine05": rotation(*(0.5 * angle for angle in sway)),
        "spine02": rotation(0.0, chest * breath, 0.0),
        "neck01": rotation(0.0, -chest * breath, 0.0),
        "clavicle.L": rotation(0.0, 0.0, -shoulder * breath),
        "clavicle.R": rotation(0.0, 0.0, shoulder * breath),
        "neck03": rotation(*head),
    }
    for side in "LR":
        swing = rng.uniform(*_ARM_DEG)
        turns[f"upperarm01.{side}"] = rotation(
            0.0, swing * _wave(rng, 0.1, 0.5, time_s), swing * _wave(rng, 0.1, 0.5, time_s)
        )
    return turns


def _wave(rng: np.random.Generator, low_hz: float, high_hz: float, time_s: float) -> float:
    """A smooth random curve in [-1, 1]; slower waves are larger."""
    hz = np.sort(rng.uniform(low_hz, high_hz, _WAVES))
    phase = rng.uniform(0.0, 1.0, _WAVES)
    size = 1.0 / np.arange(1, _WAVES + 1)
    return float((size * np.sin(2 * np.pi * (hz * time_s + phase))).sum() / size.sum())
