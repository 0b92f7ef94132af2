"""Quantities of a depth frame that several measures use: surfaces, light, radii."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from glsim.core.array_types import Floats, Mask
from glsim.core.depth_frame import DepthFrame, FrameKey, Frames
from glsim.measures.quadrics import Surfaces, fit_surfaces
from glsim.measures.stacks import moments

#: Smallest infrared counts that are saturated (files end at 65,535).
SATURATED = 65_000.0
#: Focal length of a Kinect V2, px; radii of other cameras are scaled to it.
_FOCAL_PX = 365.0


#: A result takes 3.5 MB for a Kinect V2; 200 frames would take most of a gigabyte.
@lru_cache(maxsize=64)
def surfaces(frame: DepthFrame) -> Surfaces:
    """Fit a quadric in a 7 x 7 window around every pixel."""
    return fit_surfaces(frame.measured_mm, frame.rays, 7)


def surface_mm(frame: DepthFrame) -> Floats:
    """Compute the depth of the fitted quadric at its centre pixel, (H, W) mm."""
    # Bins of this depth do not select noise of one sign at their bounds; bins of noisy depth do.
    return np.asarray(frame.measured_mm - surfaces(frame).residual_mm)


def radius_px(frame: DepthFrame) -> Floats:
    """Compute the distance from the principal point, (H, W), scaled to pixels of a Kinect V2."""
    return np.asarray(_FOCAL_PX * np.hypot(frame.rays[..., 0], frame.rays[..., 1]), np.float32)


def lit(frame: DepthFrame) -> Mask:
    """Mark the (H, W) pixels whose infrared is neither 0 nor saturated; all without infrared."""
    if frame.infrared is None:
        return np.ones(frame.noisy_mm.shape, np.bool_)
    return (frame.infrared > 0) & (frame.infrared < SATURATED)


def mean_frame(frames: Frames) -> DepthFrame:
    """Average frames of one view over time; a pixel that never has depth gets no depth."""
    lights = [frame.infrared for frame in frames if frame.infrared is not None]
    count, mean, _ = moments([frame.measured_mm for frame in frames])
    layers = {"noisy_mm": np.where(count > 0, mean, 0).astype(np.float32)}
    if lights:
        layers["infrared"] = np.asarray(np.mean(lights, axis=0, dtype=np.float64), np.float32)
    step_mm = frames[0].step_mm / len(frames) ** 0.5
    return DepthFrame(FrameKey("", "mean", 0), frames.intrinsics, layers, step_mm=step_mm)
