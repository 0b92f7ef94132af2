"""Loss of form: how much relief of a surface a denoiser keeps, and its systematic error.

The error of a denoised map is remaining noise plus lost form. Noise differs from frame to frame and
does not depend on the surface. Lost form is the same in each frame.
"""

from __future__ import annotations

import math
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Depth, Mask
from glsim.core.depth_map import BAND_PX, dilated
from glsim.core.units import MM_PER_M
from glsim.eval.metrics.scored_map import ScoredMap
from glsim.measures.stacks import eroded

#: Standard deviations of two Gaussians, px. Their difference passes relief of 4 to 8 px: 0.29, 0.51
#: and 0.51 of waves of 4, 6 and 8 px, and 0.24 of waves of 16 px.
FINE_PX: Final = (1.0, 2.2)
#: The same for relief twice as wide.
WIDE_PX: Final = (2.0, 4.4)
#: Smallest standard deviation of scored relief, mm. Chosen: below it, remaining noise would decide.
_LEAST_MM: Final = 0.1
#: Distance from a hole, px. Chosen: twice the band at edges.
_NEAR_PX: Final = 2 * BAND_PX
#: Two frames show one view up to this share of different clean pixels. Chosen: 0.0001 after 1 ms.
_OTHER_SHARE: Final = 0.001


def relief_kept_pct(prediction: ScoredMap, band_px: tuple[float, float] = FINE_PX) -> float:
    """Compute the share of the clean relief in a band of sizes that a prediction keeps, %.

    The share is the slope of a regression over interior pixels, which noise does not change on
    average. NaN for a clean map without relief.
    """
    truth = prediction.truth
    inside = prediction.valid & truth.parts["interior"]
    clean, error = (_relief(depth, inside, band_px) for depth in (truth.clean, prediction.error))
    size = float((clean * clean).sum())
    if size <= _LEAST_MM**2 * np.count_nonzero(inside):
        return math.nan
    return 100.0 * (1.0 + float((clean * error).sum()) / size)


def hole_curvature_per_m(prediction: ScoredMap) -> float:
    """Compute the curvature that a prediction adds near holes of the clean map, 1/m.

    It is the median over surfaces within 6 px of a hole of half the Laplacian of the error.
    Negative: the surface bends towards the camera at its rim, as where zeros pull depth down. NaN
    without such pixels or without a known distance.
    """
    truth = prediction.truth
    at = truth.smooth & eroded(prediction.valid, 1) & dilated(~truth.valid, _NEAR_PX)
    if not at.any() or not math.isfinite(truth.offset_mm):
        return math.nan
    pitch_mm = (truth.clean + truth.offset_mm)[at] * (truth.rays[0, 1, 0] - truth.rays[0, 0, 0])
    bend = cv2.Laplacian(prediction.error, cv2.CV_64F)[at]
    return MM_PER_M * float(np.median(bend / pitch_mm**2)) / 2


def systematic_mm2(
    prediction: ScoredMap, earlier_mm: Depth | None, earlier_clean_mm: Depth | None
) -> float:
    """Compute the mean square of the error that two frames of one view share, mm2.

    It is the mean product of both errors. Noise of two frames is independent, so that its product
    is 0 on average. NaN if the frames show different views (clean maps differ in more than 0.1 % of
    the pixels), or if no pixel is interior in both.

    Args:
        earlier_mm: (H, W) prediction of the previous frame, by the same method.
        earlier_clean_mm: (H, W) clean map of the previous frame.
    """
    truth = prediction.truth
    if earlier_mm is None or earlier_clean_mm is None or earlier_mm.shape != truth.clean.shape:
        return math.nan
    if np.mean(truth.clean != earlier_clean_mm) > _OTHER_SHARE:
        return math.nan
    pixels = prediction.valid & truth.parts["interior"] & (earlier_mm > 0)
    if not pixels.any():
        return math.nan
    before = earlier_mm[pixels].astype(np.float64) - truth.clean[pixels]
    return float((prediction.error[pixels] * before).mean())


def _relief(
    depth: NDArray[np.float64], inside: Mask, band_px: tuple[float, float]
) -> NDArray[np.float64]:
    """Return (H, W) relief in a band of a depth image, mm; 0 outside the mask."""
    share = inside.astype(np.float64)
    fine, coarse = (
        cv2.GaussianBlur(depth * share, (0, 0), sigma)
        / np.maximum(cv2.GaussianBlur(share, (0, 0), sigma), 1e-6)
        for sigma in band_px
    )
    return np.where(inside, fine - coarse, 0.0)
