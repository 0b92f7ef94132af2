"""Inference safeguards: rules that reject the output of a network.

Without them the shipped network moved noiseless frames by 1.7 mm, guessed the surface of pixels
between a head and a wall, and gave depth to regions far from any measured pixel.
"""

from __future__ import annotations

import math
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

Depth = NDArray[np.float32]
Mask = NDArray[np.bool_]

#: Frames whose noise is below both bounds, mm, are returned unchanged: the noise at pixels side by
#: side, and at every other pixel. Rounding to whole millimetres gives 0.289, the features of a head
#: raise it to at most 0.312 and 0.551 (656 frames without noise of embedded heads and ICT-FaceKit,
#: 0.52 to 1.45 m). The least noisy of 500 frames of sensors with white noise has 0.354, with half
#: the floor of a real one. Smooth noise shows in the second bound alone: that of `azure-kinect`,
#: 1.4 mm, gives at least 0.29 and 0.559 (96 frames); below 0.33 is every third of these frames.
CLEAN_MM: Final = (0.33, 0.56)
#: Largest risk (expected error of the chosen surface, as the network predicts it) that is accepted
#: at measured pixels, and in holes, where a wrong guess does more harm than the hole. Chosen by
#: experiment (the shipped network on 24 heads under each sensor, with and without a wall): with 100
#: and 10 mm the RMSE under `led3d` exceeds the input's; with 40 and 25 mm so does the RMSE before
#: walls under `kinect-v2-paper`. A bound on the probability would drop ears 50 mm in front of a
#: neck as it drops walls at 1 m.
MEASURED_RISK_MM, HOLE_RISK_MM = 40.0, 10.0
#: Largest distance from a measured pixel at which training asks for depth (loss.reach_px).
REACH_PX: Final = 12

#: Second differences of rows and columns: 0 on planes, standard deviation 6 for white noise of 1
#: (Immerkaer, "Fast Noise Variance Estimation", CVIU 1996).
_KERNEL: Final = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
_GAIN: Final = 6.0
#: Mean of the square root of |x| for a standard normal x, 2^(1/4) Gamma(3/4) / sqrt(pi). Roots are
#: averaged because the few large values at facial features would dominate a mean of the values.
_MEAN_ROOT: Final = 2**0.25 * math.gamma(0.75) / math.sqrt(math.pi)
#: A window whose depths span more than this, mm a pixel of step, has an edge; least number of
#: other windows.
_EDGE_MM, _LEAST_WINDOWS = 30.0, 50


def clean_noise_mm(depth_mm: Depth) -> float | None:
    """Return the noise of a depth map, mm, if it is no more than rounding gives; else None.

    depth_mm: (H, W) millimetres, 0 = no return.
    """
    noises_mm = [estimate_noise_mm(depth_mm, step) for step in (1, 2)]
    below = [n is not None and n < most for n, most in zip(noises_mm, CLEAN_MM, strict=True)]
    return noises_mm[0] if all(below) else None


def estimate_noise_mm(depth_mm: Depth, step_px: int = 1) -> float | None:
    """Estimate the standard deviation of the noise on the surfaces of a depth map, mm.

    Noise whose neighbours are alike counts in full only from pixels ``step_px`` apart, between
    which the surface bends more. depth_mm: (H, W) millimetres, 0 = no return. Returns None if too
    few pixels have depth.
    """
    side = 2 * step_px + 1
    square = np.ones((side, side), np.uint8)
    # Holes are 0 and so make edges.
    span = cv2.dilate(depth_mm, square) - cv2.erode(depth_mm, square)
    inner = (depth_mm > 0) & (span < _EDGE_MM * step_px)
    inner[:step_px] = inner[-step_px:] = False
    inner[:, :step_px] = inner[:, -step_px:] = False
    if np.count_nonzero(inner) < _LEAST_WINDOWS:
        return None
    kernel = np.zeros((side, side), np.float32)
    kernel[::step_px, ::step_px] = _KERNEL
    size = np.abs(cv2.filter2D(depth_mm, cv2.CV_32F, kernel)[inner])
    return float((np.sqrt(size).mean() / _MEAN_ROOT) ** 2 / _GAIN)


def trusted_mask(depth_mm: Depth, risk_mm: Depth | None) -> Mask:
    """Return the (H, W) pixels to trust: near measured depth, and with a low risk.

    depth_mm: (H, W) the measured map, 0 = no return. risk_mm: (H, W) expected error of the chosen
    surface, for networks that choose between surfaces.
    """
    side = 2 * REACH_PX + 1
    measured = depth_mm > 0
    near: Mask = cv2.dilate(measured.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
    if risk_mm is None:
        return near
    return near & (risk_mm < np.where(measured, MEASURED_RISK_MM, HOLE_RISK_MM))
