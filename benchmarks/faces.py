"""Shared faces and settings of the benchmarks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from glsim.faces.base import FaceSource
from glsim.settings.schema import Settings, load_settings

SENSOR = "kinect-v2-paper"
_FRAMES_PER_SUBJECT = 60


def source_for(ict_root: Path | None) -> FaceSource:
    """Open ICT-FaceKit with a new person every frame, or the embedded procedural heads."""
    if ict_root is not None:
        from glsim.faces.ict_facekit import IctFaceKit

        return IctFaceKit(ict_root, 0, new_identity_every_frame=True)
    from glsim.faces.procedural.source import ProceduralFaces

    return ProceduralFaces(0)


def settings_for(ict_root: Path | None, frames: int, sensor: str = SENSOR) -> Settings:
    """Settings of a data set of about ``frames`` frames of these faces."""
    source: dict[str, Any] = {
        "subjects": max(1, frames // _FRAMES_PER_SUBJECT),
        "frames_per_subject": min(frames, _FRAMES_PER_SUBJECT),
    }
    if ict_root is not None:
        source |= {"kind": "ict-facekit", "root": ict_root}
    return load_settings(overrides={"sensor": sensor}, source=source)
