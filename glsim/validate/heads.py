"""Checks on isolated faces: their masks, normals and holes (24, 30)."""

from __future__ import annotations

import numpy as np

from glsim.validate import measure, scenes
from glsim.validate.bench import Shots
from glsim.validate.lab import Lab
from glsim.validate.report import Measured

_PEOPLE = 6
_FRAMES_EACH = 4


def portraits(lab: Lab) -> list[Shots]:
    """A few frames of each of some people at 0.9 m before nothing, of the albedo of skin."""
    return [
        lab.bench.shoot(mesh, _FRAMES_EACH, 160, at_mm=(0, 0, 900), scene=f"face {number}")
        for number, mesh in enumerate(scenes.faces(_PEOPLE, 900, lab.bench.seed))
    ]


def heads(lab: Lab) -> dict[str, Measured]:
    """Checks 24 and 30 and the anti-check of shadows."""
    invalid = inside = kept = surface = grown = rim = 0
    angles, holes = [], []
    for shots in lab.once("portraits", lambda: portraits(lab)):
        clean = np.isfinite(shots.clean_mm)
        valid = np.isfinite(shots.frames_mm)
        interior = measure.eroded(clean, 3) & (measure.steps_mm(shots.clean_mm) <= 100)
        invalid += int((~valid & interior).sum())
        inside += int(interior.sum()) * len(valid)
        kept += int((valid & clean).sum())
        surface += int(clean.sum()) * len(valid)
        grown += int((valid & ~clean).sum())
        rim += int((clean & ~measure.eroded(clean, 1)).sum()) * len(valid)
        before = measure.normals(shots.clean_mm, shots.rays)
        # Where the surface turns away or a step begins, normals say nothing about noise.
        before[~interior | (before[..., 2] > -0.5)] = np.nan
        angles += [
            measure.angular_error_deg(measure.normals(frame, shots.rays), before)
            for frame in shots.frames_mm
        ]
        holes += [measure.longest_run(~v & measure.eroded(clean, 1)) for v in valid]
    note = f"{_PEOPLE} procedural heads, {inside // (_PEOPLE * _FRAMES_EACH)} px inside each"
    return {
        "24": Measured(
            {
                "invalid": 100.0 * invalid / max(inside, 1),
                "kept": 100.0 * kept / max(surface, 1),
                "growth": grown / max(rim, 1),
            },
            note,
        ),
        "30": Measured({"angle": float(np.mean(angles))}, "within 60 deg of the axis"),
        "A3": Measured({"hole": float(max(holes))}),
    }
