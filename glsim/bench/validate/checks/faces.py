"""Checks 24, 30 and A3 on isolated faces: masks, normals and holes."""

from __future__ import annotations

import numpy as np

from glsim.bench.measures import stacks as measure
from glsim.bench.validate import scenes
from glsim.bench.validate.captures import Captures
from glsim.bench.validate.report import Measurement, validation_check
from glsim.core.depth_frame import Frames

_PEOPLE = 6
_FRAMES_EACH = 4


def portraits(captures: Captures) -> list[Frames]:
    """Capture a few frames of a few people at 0.9 m, without background, with skin albedo."""
    return [
        captures.camera.capture(mesh, _FRAMES_EACH, 160, scene=f"face {number}")
        for number, mesh in enumerate(scenes.faces(_PEOPLE, 900, captures.camera.seed))
    ]


@validation_check("kinect-v2")
def isolated_faces(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 24 and 30, and anti-check A3: masks, normals and shadows of faces."""
    invalid = inside = kept = surface = grown = rim = 0
    angles, holes = [], []
    for capture in portraits(captures):
        clean = np.isfinite(capture.truth_mm)
        valid = np.isfinite(capture.whole_mm)
        interior = measure.eroded(clean, 3) & (measure.steps_mm(capture.truth_mm) <= 100)
        invalid += int((~valid & interior).sum())
        inside += int(interior.sum()) * len(valid)
        kept += int((valid & clean).sum())
        surface += int(clean.sum()) * len(valid)
        grown += int((valid & ~clean).sum())
        rim += int((clean & ~measure.eroded(clean, 1)).sum()) * len(valid)
        clean_normals = measure.normals(capture.truth_mm, capture[0].rays)
        # On slanted surfaces and at steps the error of normals is not due to noise alone.
        clean_normals[~interior | (clean_normals[..., 2] > -0.5)] = np.nan
        angles += [
            measure.angular_error_deg(measure.normals(frame, capture[0].rays), clean_normals)
            for frame in capture.whole_mm
        ]
        holes += [measure.longest_run(~v & measure.eroded(clean, 1)) for v in valid]
    note = f"{_PEOPLE} procedural heads, {inside // (_PEOPLE * _FRAMES_EACH)} px inside each"
    return {
        "24": Measurement(
            {
                "invalid": 100.0 * invalid / max(inside, 1),
                "kept": 100.0 * kept / max(surface, 1),
                "growth": grown / max(rim, 1),
            },
            note,
        ),
        "30": Measurement({"angle": float(np.mean(angles))}, "within 60 deg of the axis"),
        "A3": Measurement({"hole": float(max(holes))}),
    }
