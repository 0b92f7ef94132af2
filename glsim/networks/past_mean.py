"""The mean of past frames where nothing moves, for networks and the filter ``adaptive``."""

from __future__ import annotations

import numpy as np

from glsim.core.array_types import Depth


def past_mean(depths_mm: Depth, threshold_mm: float) -> Depth:
    """Average the last frame with earlier ones, as far back as the depth of a pixel stays the same.

    Args:
        depths_mm: (T, H, W) millimetres, 0 = no return.
        threshold_mm: a larger change of depth counts as motion.

    Returns:
        (H, W) millimetres.
    """
    here = depths_mm[-1]
    total, count, still = here.copy(), np.ones_like(here), here > 0
    for past in depths_mm[-2::-1]:
        still &= (past > 0) & (np.abs(past - here) <= threshold_mm)
        total[still] += past[still]
        count[still] += 1
    return np.asarray(total / count)
