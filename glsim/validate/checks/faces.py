"""Checks 24, 30 and A3 on isolated faces: masks, normals and holes."""

from __future__ import annotations

import numpy as np

from glsim.measures import stacks as measure
from glsim.validate import scenes
from glsim.validate.captures import Captures
from glsim.validate.report import Band, Check, Measurement, validation_check
from glsim.validate.sources import OWN, STRUCTURED_LIGHT
from glsim.validate.virtual_camera import Capture

_PEOPLE = 6
_FRAMES_EACH = 4


def portraits(captures: Captures) -> list[Capture]:
    """Capture a few frames of each of a few people at 0.9 m without background, skin albedo."""
    return [
        captures.camera.capture(mesh, _FRAMES_EACH, 160, at_mm=(0, 0, 900), scene=f"face {number}")
        for number, mesh in enumerate(scenes.faces(_PEOPLE, 900, captures.camera.seed))
    ]


@validation_check(
    "kinect-v2",
    Check("24", "isolated face, 0.9 m: invalid inside; clean mask kept; growth per rim pixel",
          (Band("invalid", 0.0, 0.2, "%"), Band("kept", 99.5, 100.0, "%"),
           Band("growth", 0.3, 2.3, "px")), OWN, "derived"),
    Check("30", "normals of a noisy face: mean angle to the clean ones",
          (Band("angle", 12.0, 24.0, "deg"),), OWN, "derived"),
    Check("A3", "no sharp shadow of 20 to 50 px on a face at 0.9 m: longest hole in a row",
          (Band("hole", 0.0, 19.0, "px"),), STRUCTURED_LIGHT),
)  # fmt: skip
def isolated_faces(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 24 and 30, and anti-check A3: no sharp shadow on a face."""
    invalid = inside = kept = surface = grown = rim = 0
    angles, holes = [], []
    for capture in captures.cached("portraits", lambda: portraits(captures)):
        clean = np.isfinite(capture.clean_mm)
        valid = np.isfinite(capture.frames_mm)
        interior = measure.eroded(clean, 3) & (measure.steps_mm(capture.clean_mm) <= 100)
        invalid += int((~valid & interior).sum())
        inside += int(interior.sum()) * len(valid)
        kept += int((valid & clean).sum())
        surface += int(clean.sum()) * len(valid)
        grown += int((valid & ~clean).sum())
        rim += int((clean & ~measure.eroded(clean, 1)).sum()) * len(valid)
        clean_normals = measure.normals(capture.clean_mm, capture.rays)
        # On slanted surfaces and at steps the error of normals is not due to noise alone.
        clean_normals[~interior | (clean_normals[..., 2] > -0.5)] = np.nan
        angles += [
            measure.angular_error_deg(measure.normals(frame, capture.rays), clean_normals)
            for frame in capture.frames_mm
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
