"""Motion of the head in sequences of generated faces: sway, nods and turns.

A pure function of (seed of the sequence, time), smooth and band-limited: each of the six numbers
of a pose is a sum of sinusoids between 0.1 and 1.5 Hz whose frequencies have no common period. At
time 0 the motion is zero, so the first frame has the pose that was asked for. Motion restarts with
each sequence.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from glsim.core.pose import pose_matrix
from glsim.core.products import product
from glsim.core.seeds import rng_for
from glsim.faces.neck import Neck, pivot_mm

#: Components: number of the pose, largest amplitude, band in Hz. Sway of the head is slow (0.34 to
#: 0.39 Hz, 20 standing adults, "Head movement recording and significance"); 3 to 4 mm near 0.36 Hz
#: give the path of 37 cm a minute that this study measured, more of it forwards than sideways.
#: Angles are chosen: slow drifts of gaze and posture, turns of up to 6 and nods of up to 3 degrees.
#: Slower drifts and quick nods of speakers (U. Hadar et al., Human Movement Science 2, 1983) are
#: left out. Amplitudes are drawn between a third and the whole: some people keep still.
WAVES: Final = (
    ("x_mm", 3.0, 0.25, 0.5),
    ("x_mm", 1.0, 0.5, 1.1),
    ("y_mm", 0.8, 0.2, 0.6),
    ("distance_mm", 4.0, 0.22, 0.45),
    ("distance_mm", 1.2, 0.5, 1.0),
    ("yaw_deg", 6.0, 0.1, 0.35),
    ("yaw_deg", 1.5, 0.4, 1.0),
    ("pitch_deg", 2.5, 0.1, 0.35),
    ("pitch_deg", 3.0, 0.7, 1.5),
    ("roll_deg", 2.0, 0.1, 0.4),
    ("roll_deg", 0.6, 0.5, 1.2),
)
_LEAST_SHARE: Final = 1 / 3


def head_motion(seed: int, time_s: float) -> dict[str, float]:
    """Return offsets of the pose: yaw_deg, pitch_deg, roll_deg, x_mm, y_mm, distance_mm.

    Args:
        seed: of the sequence.
        time_s: seconds since its start; all offsets are 0 at time 0.
    """
    rng = rng_for(seed, "head motion")
    share = rng.uniform(_LEAST_SHARE, 1.0, len(WAVES))
    place = rng.uniform(0.0, 1.0, len(WAVES))
    phase = rng.uniform(0.0, 2 * np.pi, len(WAVES))
    offsets = {name: 0.0 for name, *_ in WAVES}
    for (name, most, low_hz, high_hz), s, p, start in zip(WAVES, share, place, phase, strict=True):
        turn = 2 * np.pi * (low_hz + p * (high_hz - low_hz)) * time_s
        offsets[name] += float(most * s * (np.sin(turn + start) - np.sin(start)))
    return offsets


def move_pose(
    pose: Mapping[str, float], offsets: Mapping[str, float], neck: Neck | None = None
) -> dict[str, float]:
    """Return the pose after a motion; angles turn the head about the middle of its neck.

    Args:
        pose: as in ``pose_matrix``, of the mesh's origin.
        offsets: as from ``head_motion``.
        neck: of the face; by default that of a head whose face is at the origin.
    """
    turned = {
        name: value + (offsets.get(name, 0.0) if name.endswith("_deg") else 0.0)
        for name, value in pose.items()
    }
    pivot = np.append(pivot_mm(neck), 1.0)
    moved = (pose_matrix(pose) - pose_matrix(turned)).astype(np.float64)
    drift_mm = product(1000.0 * moved, pivot)
    for name, drift in zip(("x_mm", "y_mm", "distance_mm"), drift_mm, strict=False):
        turned[name] += float(drift) + offsets.get(name, 0.0)
    return turned
