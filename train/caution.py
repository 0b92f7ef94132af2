"""Where a network's word is not taken: what it has not learned must do no harm.

Without this the shipped network moved noiseless frames by 1.7 mm, put pixels between a head and a
wall on either at a guess, and gave depth to regions that nothing was measured near.
"""

from __future__ import annotations

import math
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

Depth = NDArray[np.float32]
Mask = NDArray[np.bool_]

#: Frames with less noise than this are left alone. Rounding to whole millimetres alone is 0.289,
#: what a head's features add brings it to at most 0.312 (160 frames without noise); the least noisy
#: of 500 frames of the other sensors, with half the floor of a real one, has 0.354.
CLEAN_MM: Final = 0.33
#: A choice of surface with a larger mean error, by the network's own word, is no depth: at pixels
#: that were measured, and in holes, where a wrong guess does more harm than the hole. By experiment
#: (the shipped network on 24 heads under each sensor, with and without a wall): with 100 and 10 mm
#: the RMSE under `led3d` is above the input's, with 40 and 25 mm that before walls under
#: `kinect-v2-paper`. A bound on the probability instead leaves out ears 50 mm before a neck like
#: walls at 1 m.
MEASURED_RISK_MM, HOLE_RISK_MM = 40.0, 10.0
#: So far from what was measured a network is asked for depth in training (loss.reach_px).
REACH_PX: Final = 12

#: Second differences of rows and columns: 0 on planes, standard deviation 6 on white noise of 1
#: (Immerkaer, "Fast Noise Variance Estimation", CVIU 1996).
_KERNEL: Final = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
_GAIN: Final = 6.0
#: Mean of the square root of |x| for a standard normal x, 2^(1/4) Gamma(3/4) / sqrt(pi). Roots: the
#: few large values at features of a face would dominate a mean of the values themselves.
_ROOT: Final = 2**0.25 * math.gamma(0.75) / math.sqrt(math.pi)
#: 3x3 windows that span more than this, mm, hold an edge; fewer than so many windows say nothing.
_EDGE_MM, _LEAST_WINDOWS = 30.0, 50


def noise_mm(depth_mm: Depth) -> float | None:
    """Standard deviation of white noise on the surfaces of (H, W) millimetres, 0 = no return.

    None where there is too little depth to tell.
    """
    square = np.ones((3, 3), np.uint8)
    span = cv2.dilate(depth_mm, square) - cv2.erode(depth_mm, square)  # holes are 0: an edge
    inner = (depth_mm > 0) & (span < _EDGE_MM)
    inner[[0, -1]] = inner[:, [0, -1]] = False
    if np.count_nonzero(inner) < _LEAST_WINDOWS:
        return None
    size = np.abs(cv2.filter2D(depth_mm, cv2.CV_32F, _KERNEL)[inner])
    return float((np.sqrt(size).mean() / _ROOT) ** 2 / _GAIN)


def believed(depth_mm: Depth, risk_mm: Depth | None) -> Mask:
    """Where a prediction counts, (H, W): near measured depth, and where it is sure of its surface.

    depth_mm: as measured, 0 = no return. risk_mm: how far off the surface that was chosen is, on
    average over the others and their probabilities, for networks that choose.
    """
    side = 2 * REACH_PX + 1
    measured = depth_mm > 0
    near: Mask = cv2.dilate(measured.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
    if risk_mm is None:
        return near
    return near & (risk_mm < np.where(measured, MEASURED_RISK_MM, HOLE_RISK_MM))
