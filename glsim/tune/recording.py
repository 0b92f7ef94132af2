"""Figures of a real recording and of tuned frames, both as ``glsim compare`` measures them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from glsim.frame import Frame
from glsim.measures.frame import FrameSet, frame_set
from glsim.measures.silhouettes import measure_silhouettes
from glsim.measures.spatial import measure_spatial
from glsim.measures.validity import measure_invalid
from glsim.recordings.recording import read_frame_set

#: Frames of the recording that are measured; chosen, since the page waits for them.
FRAMES = 16


def recording_figures(folder: Path) -> dict[str, Any]:
    """Measure a recording. Raises ConfigError or DatasetError if it cannot be read."""
    return _figures(read_frame_set(folder, most=FRAMES))


def tuned_figures(frames: Sequence[Frame]) -> dict[str, Any]:
    """Measure tuned frames of one size."""
    return _figures(
        frame_set(
            "tuned",
            [frame.noisy * frame.depth_unit_mm for frame in frames],
            [frame.infrared for frame in frames],
            frames[0].intrinsics,
            frames[0].depth_unit_mm,
        )
    )


def _figures(frames: FrameSet) -> dict[str, Any]:
    """Return the figures of a set as JSON values; None where it has too few pixels."""
    spatial = measure_spatial(frames.frames)
    sides = measure_silhouettes(frames.frames)
    invalid = measure_invalid(frames.frames)
    rough = spatial.rough_mm
    rows: list[tuple[str, str, float]] = [
        ("residual in 7x7 px, 10th percentile", "mm", rough[0]),
        ("residual in 7x7 px, median", "mm", rough[1]),
        ("residual in 7x7 px, 90th percentile", "mm", rough[2]),
        ("correlation to the next pixel", "", spatial.correlation[0]),
        ("silhouette width, left", "px", sides.left.width_px),
        ("silhouette width, right", "px", sides.right.width_px),
        ("without depth beside it, left", "px", sides.left.invalid_px),
        ("without depth beside it, right", "px", sides.right.invalid_px),
        ("without depth, image centre", "%", 100 * invalid[0][2]),
    ]
    return {
        "title": frames.title,
        "frames": len(frames.frames),
        "rows": [[name, unit, _number(value)] for name, unit, value in rows],
    }


def _number(value: float) -> float | None:
    return round(float(value), 3) if math.isfinite(value) else None
