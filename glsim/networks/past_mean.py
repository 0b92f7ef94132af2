"""The mean of past frames where nothing moves, for networks and the filter ``adaptive``."""

from __future__ import annotations

import numpy as np

from glsim.core.array_types import Depth


def past_mean(depths_mm: Depth, threshold_mm: float) -> Depth:
    """Average the last of (T, H, W) frames, mm, with earlier ones until a pixel's depth changes."""
    here = depths_mm[-1]
    total, count, still = here.copy(), np.ones_like(here), here > 0
    for past in depths_mm[-2::-1]:
        still &= (past > 0) & (np.abs(past - here) <= threshold_mm)
        total[still] += past[still]
        count[still] += 1
    return np.asarray(total / count)
