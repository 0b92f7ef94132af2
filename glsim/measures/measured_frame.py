"""Quantities of a depth frame that measures use: surfaces, light, radii; each computed once."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from glsim.core.array_types import Floats, Mask
from glsim.core.depth_frame import DepthFrame, FrameKey, Frames
from glsim.measures.quadrics import Surfaces, fit_surfaces
from glsim.measures.stacks import moments

#: Infrared counts from here on are saturated (the files end at 65,535).
SATURATED = 65_000.0
#: Focal length of a Kinect V2, px, to which radii are scaled.
_FOCAL_PX = 365.0


#: Each takes 3.5 MB for a Kinect V2; all of a set of 200 frames would take most of a gigabyte.
@lru_cache(maxsize=64)
def surfaces(frame: DepthFrame) -> Surfaces:
    """Fit quadrics in 7 x 7 windows around every pixel."""
    return fit_surfaces(frame.measured_mm, frame.rays, 7)


def surface_mm(frame: DepthFrame) -> Floats:
    """Compute the (H, W) depth of the fitted quadric at its centre pixel, mm."""
    # Bins by it do not select noise of one sign at their bounds, as bins by noisy depth do.
    return np.asarray(frame.measured_mm - surfaces(frame).residual_mm)


def radius_px(frame: DepthFrame) -> Floats:
    """Compute the (H, W) distance from the principal point, rescaled to pixels of a Kinect V2."""
    return np.asarray(_FOCAL_PX * np.hypot(frame.rays[..., 0], frame.rays[..., 1]), np.float32)


def lit(frame: DepthFrame) -> Mask:
    """Mark the (H, W) pixels whose infrared is neither 0 nor saturated; all without infrared."""
    if frame.infrared is None:
        return np.ones(frame.noisy_mm.shape, np.bool_)
    return (frame.infrared > 0) & (frame.infrared < SATURATED)


def mean_frame(frames: Frames) -> DepthFrame:
    """Average frames of one view over time; no depth where no frame has depth."""
    lights = [frame.infrared for frame in frames if frame.infrared is not None]
    count, mean, _ = moments([frame.measured_mm for frame in frames])
    layers = {"noisy_mm": np.where(count > 0, mean, 0).astype(np.float32)}
    if lights:
        layers["infrared"] = np.asarray(np.mean(lights, axis=0, dtype=np.float64), np.float32)
    step_mm = frames[0].step_mm / len(frames) ** 0.5
    return DepthFrame(FrameKey("", "mean", 0), frames.intrinsics, layers, step_mm=step_mm)
