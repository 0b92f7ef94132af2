"""Shipped stages that no fragment shader can compute; they run on arrays, after the shaders."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from glsim.core.reason import Reason
from glsim.noise.frame_context import Layers, StageView
from glsim.noise.stage import array_stage

__all__ = ["despeckle"]


def _largest_island_px(p: Mapping[str, float]) -> int:
    """Return the largest extent of an island that ``despeckle`` removes, pixels."""
    return int(p["min_area_px"]) - 1


@array_stage(
    _largest_island_px,
    min_area_px=("int", 20, 1, 100000, "px", "smallest connected island that is kept"),
    max_step_mm=("float", 20, 0.1, 5000, "mm", "depth difference that still connects neighbours"),
)
def despeckle(
    view: StageView, layers: Layers, p: Mapping[str, float]
) -> dict[str, NDArray[np.float32]]:
    """Removes small islands of depth, as structured-light drivers do."""
    import cv2

    # filterSpeckles takes signed 16-bit numbers: steps of 1/4 of max_step_mm separate 20 mm from
    # 25 mm and reach 8191 times max_step_mm.
    unit_m = p["max_step_mm"] / 4000.0
    steps = np.rint(np.clip(layers["depth"] / unit_m, 0, 32767)).astype(np.int16)
    kept = steps.copy()
    cv2.filterSpeckles(kept, 0, int(p["min_area_px"]) - 1, 4)
    removed = (kept == 0) & (steps > 0)
    depth, reason = layers["depth"].copy(), layers["reason"].copy()
    depth[removed] = 0.0
    reason[removed] = float(Reason.DROPPED)
    return {"depth": depth, "reason": reason}
