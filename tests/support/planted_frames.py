"""Depth frames of arrays, and with known noise, patterns and shadows, for tests of measures."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import DEFAULT_INTRINSICS, Intrinsics
from glsim.core.depth_frame import DepthFrame, FrameKey, Frames

Array = NDArray[np.float64]

SHAPE = (424, 512)
CAMERA = DEFAULT_INTRINSICS


def frames_of(
    title: str,
    depth_mm: Iterable[NDArray[np.generic]],
    infrared: Iterable[NDArray[np.generic]] | None = None,
    camera: Intrinsics | None = None,
    step_mm: float = 1.0,
) -> Frames:
    """Create a set of frames from depth arrays.

    Args:
        title: name of the set.
        depth_mm: (H, W) depths, mm; 0 or NaN marks pixels without depth.
        infrared: (H, W) counts of each frame.
        camera: default: a Kinect V2, its principal point in the image centre if the size is not
            its own.
        step_mm: step of the depths.
    """
    depths = [np.nan_to_num(np.asarray(depth, np.float32)) for depth in depth_mm]
    height, width = depths[0].shape
    own = camera or DEFAULT_INTRINSICS.for_map((height, width))
    lights = (
        [{}] * len(depths)
        if infrared is None
        else [{"infrared": np.asarray(image, np.float32)} for image in infrared]
    )
    return Frames.of(
        [
            DepthFrame(FrameKey("", title, n), own, {"noisy_mm": depth, **light}, step_mm=step_mm)
            for n, (depth, light) in enumerate(zip(depths, lights, strict=True))
        ],
        title,
    )


def plane(z_mm: float, slope_x: float = 0.0, slope_y: float = 0.0) -> Array:
    """Compute a plane of given depth on the axis and slopes dz/dx, dz/dy, (H, W) mm."""
    rays = CAMERA.rays().astype(np.float64)
    depth: Array = z_mm / (1.0 - slope_x * rays[..., 0] - slope_y * rays[..., 1])
    return depth


def noisy(clean: Array, sigma_mm: float | Array, seed: int, smooth: int = 1) -> NDArray[np.uint16]:
    """Add Gaussian noise, a mean over smooth x smooth white pixels, and round to mm; 0 stays 0."""
    noise = np.random.default_rng(seed).standard_normal(SHAPE)
    if smooth > 1:
        shifts = [(r, c) for r in range(smooth) for c in range(smooth)]
        noise = sum(np.roll(noise, s, (0, 1)) for s in shifts) / smooth  # type: ignore[assignment]
    depth = np.rint(clean + sigma_mm * noise)
    return np.where(clean > 0, depth, 0).astype(np.uint16)


def shadowed(
    front_mm: float, back_mm: float, left_px: int, right_px: int, flying_px: int = 0
) -> Array:
    """Make a panel of 160 columns before a wall, with gaps of given widths; (H, W) mm, 0 = none.

    flying_px: pixels of the right gap, next to the panel, that have depth halfway instead of none.
    """
    depth = np.full(SHAPE, back_mm)
    depth[60:360, 180:340] = front_mm
    depth[60:360, 180 - left_px : 180] = 0.0
    depth[60:360, 340 : 340 + right_px] = 0.0
    depth[60:360, 340 : 340 + flying_px] = 0.5 * (front_mm + back_mm)
    return depth


def encoded(frames: Frames) -> NDArray[np.uint16]:
    """Return frames as 16-bit files hold them, (T, H, W) whole mm, 0 = no return."""
    return np.nan_to_num(frames.whole_mm).astype(np.uint16)
