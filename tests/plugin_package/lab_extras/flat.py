"""A check of the sensor ``lab-cam``."""

from __future__ import annotations

from typing import Any

import numpy as np

import glsim


@glsim.validation_check(
    "lab-cam",
    glsim.Check("1", "ripple on a wall", (glsim.Band("step", 39.0, 41.0, "mm"),), "its maker"),
)
def flat(captures: Any) -> dict[str, glsim.Measurement]:
    """Measure the step between columns."""
    frame = np.nanmean(captures.wall(900).whole_mm, axis=(0, 1))
    step = float(np.abs(np.diff(frame)).mean())
    return {"1": glsim.Measurement({"step": step})}
