"""Share of pixels without depth, over the radius from the principal point."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from glsim.measures.frame import DepthFrame

#: Bounds of the rings, px of a Kinect V2 (its corners are at 330).
RINGS_PX = (0.0, 50.0, 100.0, 150.0, 200.0, 225.0, 250.0, 275.0, 300.0, 340.0)


def measure_invalid(frames: Sequence[DepthFrame]) -> tuple[tuple[float, float, float], ...]:
    """Return (inner px, outer px, share without depth) of each ring; NaN outside the image."""
    missing = np.zeros(len(RINGS_PX) - 1)
    pixels = np.zeros(len(RINGS_PX) - 1)
    for frame in frames:
        invalid = ~np.isfinite(frame.depth_mm)
        for k, (inner, outer) in enumerate(pairwise(RINGS_PX)):
            ring = (frame.radius_px >= inner) & (frame.radius_px < outer)
            missing[k] += invalid[ring].sum()
            pixels[k] += ring.sum()
    share = np.where(pixels > 0, missing / np.maximum(pixels, 1), np.nan)
    return tuple(
        (inner, outer, float(s))
        for (inner, outer), s in zip(pairwise(RINGS_PX), share, strict=True)
    )
