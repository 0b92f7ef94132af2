"""The stage ``speckle``."""

from __future__ import annotations

from typing import Any

import numpy as np

import glsim


@glsim.array_stage(period_px=("int", 4, 2, 100, "px", "distance of the lost rows"))
def speckle(view: Any, layers: Any, p: Any) -> dict[str, Any]:
    """Lose every n-th row."""
    depth = layers["depth"].copy()
    depth[:: int(p["period_px"])] = 0
    return {"depth": depth, "reason": np.where(depth > 0, layers["reason"], 1)}
