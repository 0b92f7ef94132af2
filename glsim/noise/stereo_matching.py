"""Match two infrared images, or an image and its projector's pattern, into depth.

The matcher is OpenCV's semi-global one (Hirschmueller, "Stereo Processing by Semiglobal Matching
and Mutual Information", PAMI 30(2), 2008), in integers: the same bytes on every machine. Its
windows and paths reach far, so that a crop's depth differs a little from the same pixels of a
whole frame.

    infrared, infrared_right (or reference) --semi-global--> disparity, 1/16 px
    --smallest region, texture, left-right, border--> holes
    --mean of the support region--> disparity, 1/32 px --f B / n--> depth
    --view of another camera (TrueDepth)--> depth
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.geometry.rect import Rect
from glsim.noise.frame_context import Layers, StageView
from glsim.noise.match_reasons import match_reasons
from glsim.noise.numpy_twins.layers import pixels
from glsim.noise.numpy_twins.random import normal_pair, random_bits
from glsim.noise.stage import array_stage
from glsim.noise.view_warp import warp_to_camera

__all__ = ["match_stereo"]

Disparities = NDArray[np.int32]
Counts = NDArray[np.float32]

#: Steps per pixel of the matcher's own disparities (OpenCV), and of those after the support region.
_MATCHED_STEPS, _SUPPORT_STEPS = 16, 256
#: Tells the random words of the device's error from those of other stages' draws.
_DEVICE_DRAW = 2
#: Standard deviation of an image of even contrast, counts: its dots then just fit 8 bits. Chosen.
_EVEN_COUNTS = 40
#: A disparity that is none.
_NONE = -1


def _reach_px(p: Mapping[str, float]) -> int:
    """Return how far windows reach around a pixel; the paths reach farther, ever more weakly."""
    return int(p["window_px"]) // 2 + int(p["support_px"]) // 2 + 16


@array_stage(
    _reach_px,
    ("infrared", "infrared_right", "reference", "left_clean", "right_clean"),
    disparities=("int", 128, 16, 512, "px", "disparities that are searched, a multiple of 16; a D4xx searches 126"),
    largest_px=("float", 126, 1, 1024, "px", "largest disparity that is kept; nearest depth = f B / (largest_px + disparity_shift)"),
    disparity_shift=("int", 0, 0, 512, "px", "smallest disparity that is searched: farthest depth = f B / disparity_shift"),
    window_px=("int", 9, 3, 21, "px", "side of the window that is compared, odd"),
    p1=("int", 8, 0, 200, "1", "P1 of semi-global matching per pixel of the window: cost of a step of 1 px between neighbours"),
    p2=("int", 32, 1, 800, "1", "P2 per pixel of the window: cost of a larger step; greater than p1"),
    contrast_px=("int", 15, 0, 63, "px", "images are divided by the standard deviation of a window of this side, odd, so that dim dots match like bright ones (the cameras' census does not see brightness at all); 0 matches them as they are"),
    contrast_floor_counts=("float", 4.0, 0.1, 100, "counts", "no window is taken for less contrasty than this"),
    prefilter_counts=("int", 63, 1, 127, "counts", "horizontal gradients are cut here before they are compared"),
    uniqueness_percent=("int", 5, 0, 100, "1", "reject a match whose cost is not this much below the second best, per cent"),
    left_right_px=("int", 1, 0, 100, "px", "reject a match if the one from right to left differs by more"),
    texture_counts=("float", 1.0, 0, 1000, "counts", "reject windows whose standard deviation is smaller"),
    smallest_region_px=("int", 100, 0, 100000, "px", "reject connected regions that are smaller"),
    region_step_px=("float", 1.0, 0.1, 16, "px", "step of disparity that still connects neighbours"),
    rim_px=("int", 3, 0, 31, "px", "reject the farther surface this close to a nearer one: the gap that real cameras leave on the side without a shadow, and the excess of the other"),
    rim_step_px=("float", 2.0, 0.25, 64, "px", "step of disparity from which a surface is another"),
    border_px=("int", 9, 0, 64, "px", "reject a match nearer than this to the second image's border"),
    support_px=("int", 9, 1, 31, "px", "side of the support region whose disparities are averaged, odd"),
    support_step_px=("float", 1.0, 0.1, 16, "px", "step of disparity that ends the support region"),
    subpixel_steps=("int", 32, 1, 256, "1", "steps of the disparity per pixel"),
    amplitude_px=(
        "float",
        0.0,
        -0.5,
        0.5,
        "px",
        "sine over the fraction of a disparity that is added, against the preference of whole "
        "pixels",
    ),
    device_sigma_px=("float", 0.0, 0, 1, "px", "error of the device's own that stays from frame to frame, standard deviation"),
    device_grain_px=("float", 4.0, 0.5, 64, "px", "its correlation: sigma of the Gaussian that smooths it"),
    depth_unit_mm=("float", 1.0, 0.01, 100, "mm", "the camera's own step of depth"),
)  # fmt: skip
def match_stereo(
    view: StageView, layers: Layers, p: Mapping[str, float]
) -> dict[str, NDArray[np.float32]]:
    """Matches two infrared images (or an image and a pattern) into depth: f B / disparity."""
    second = "infrared_right" if "infrared_right" in layers else "reference"
    turn = _Turn(view.optics.second_view_m)
    left, right = (turn.forth(layers[name]) for name in ("infrared", second))
    found = match(left, right, p)
    if second == "infrared_right":
        first_px = turn.first_px(view)
        column = np.arange(found.shape[1], dtype=np.int32) + first_px
        found[column * _SUPPORT_STEPS - found < int(p["border_px"]) * _SUPPORT_STEPS] = _NONE
    disparity = turn.back(found)
    # Matchers prefer whole pixels; D4xx cameras take a sine of this amplitude off ("A-factor").
    exact = disparity / np.float64(_SUPPORT_STEPS)
    exact += p["amplitude_px"] * np.sin(2 * np.pi * exact)
    if p["device_sigma_px"] > 0:
        own = _device_error(view.device_seed, view.window, p["device_grain_px"])
        exact += p["device_sigma_px"] * own
    steps = np.rint(exact * p["subpixel_steps"])
    kept = (disparity >= 0) & (steps > 0) & (steps <= p["largest_px"] * p["subpixel_steps"])
    scale = 1000.0 * view.focal_baseline_px_m * p["subpixel_steps"] / p["depth_unit_mm"]
    units = np.rint(scale / np.where(kept, steps, 1))
    depth = np.where(kept, units * p["depth_unit_mm"] / 1000.0, 0).astype(np.float32)
    if any(imager := view.optics.imagers_m[0]):
        depth = warp_to_camera(depth, imager, view.optics.focal_px)
    shown = np.where(kept, steps / p["subpixel_steps"], 0)
    reason = match_reasons(view, layers, depth, p)
    return {"depth": depth, "reason": reason, "disparity": shown.astype(np.float32)}


def match(left: Counts, right: Counts, p: Mapping[str, float]) -> Disparities:
    """Match rectified images whose second camera stands to the right of the first.

    Args:
        left, right: (H, W) whole counts.
        p: parameters of the stage ``match_stereo``.

    Returns:
        (H, W) int32 disparities of ``left`` in 1/256 px, -1 without a match.
    """
    import cv2

    searched, shift = int(p["disparities"]) // 16 * 16, int(p["disparity_shift"])
    window = int(p["window_px"]) | 1
    p1, p2 = int(p["p1"]) * window**2, int(p["p2"]) * window**2
    matcher = cv2.StereoSGBM.create(
        minDisparity=shift,
        numDisparities=searched,
        blockSize=window,
        P1=p1,
        P2=max(p2, p1 + 1),
        disp12MaxDiff=int(p["left_right_px"]),
        preFilterCap=int(p["prefilter_counts"]),
        uniquenessRatio=int(p["uniqueness_percent"]),
        mode=cv2.StereoSGBM_MODE_SGBM_3WAY,
    )
    # OpenCV leaves out the columns whose search would leave the second image: a border holds it.
    border = searched + shift
    if p["contrast_px"] > 0:
        side, floor = int(p["contrast_px"]) | 1, p["contrast_floor_counts"]
        views = [_even_contrast(image, side, floor) for image in (left, right)]
    else:
        views = [_bytes(image) for image in (left, right)]
    padded = [cv2.copyMakeBorder(i, 0, 0, border, 0, cv2.BORDER_REPLICATE) for i in views]
    matched = matcher.compute(*padded)[:, border:].copy()
    matched[matched <= shift * _MATCHED_STEPS] = _NONE
    _reject_flat(matched, left, window, p["texture_counts"])
    if p["smallest_region_px"] > 0:
        step = max(int(p["region_step_px"] * _MATCHED_STEPS), 1)
        cv2.filterSpeckles(matched, _NONE, int(p["smallest_region_px"]) - 1, step)
    _reject_rims(matched, int(p["rim_px"]), int(p["rim_step_px"] * _MATCHED_STEPS))
    return _support_mean(matched, int(p["support_px"]), p["support_step_px"])


def _even_contrast(image: Counts, side_px: int, floor_counts: float) -> NDArray[np.uint8]:
    """Return an image with its local mean at 128 and its local standard deviation at most 40."""
    mean, variance = _local_moments(image, side_px)
    even = 128 + _EVEN_COUNTS * (image - mean) / np.maximum(np.sqrt(variance), floor_counts)
    return np.rint(even.clip(0, 255)).astype(np.uint8)


def _local_moments(image: Counts, side_px: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean and variance of the window around each pixel, counts."""
    import cv2

    size, count = (side_px, side_px), side_px**2
    # Sums of counts and of their squares are whole numbers, exact in float64.
    counts = image.astype(np.float64)
    total = cv2.boxFilter(counts, cv2.CV_64F, size, normalize=False)
    squares = cv2.boxFilter(counts * counts, cv2.CV_64F, size, normalize=False)
    return total / count, (count * squares - total * total) / count**2


def _reject_flat(
    matched: NDArray[np.int16], image: Counts, window: int, least_counts: float
) -> None:
    """Reject, in place, pixels in whose window the image's standard deviation is too small."""
    if least_counts > 0:
        matched[_local_moments(image, window)[1] < least_counts**2] = _NONE


def _reject_rims(matched: NDArray[np.int16], reach_px: int, step: int) -> None:
    """Reject, in place, pixels within ``reach_px`` of one whose disparity is larger by ``step``."""
    import cv2

    if reach_px > 0:
        around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach_px + 1,) * 2)
        matched[cv2.dilate(matched, around) - matched > step] = _NONE


def _support_mean(matched: NDArray[np.int16], side_px: int, step_px: float) -> Disparities:
    """Average disparities over the neighbours that continue the surface, first rows, then columns.

    Args:
        matched: (H, W) in 1/16 px.
        step_px: a neighbour that differs by more does not count.

    Returns:
        (H, W) in 1/256 px, in integers.
    """
    fine = _SUPPORT_STEPS // _MATCHED_STEPS
    values = matched.astype(np.int32) * fine
    values[matched < 0] = _NONE
    step = int(step_px * _SUPPORT_STEPS)
    for axis in (1, 0):
        values = _mean_along(values, axis, side_px // 2, step)
    return values


def _mean_along(values: Disparities, axis: int, reach: int, step: int) -> Disparities:
    """Average along one axis over ``reach`` neighbours on both sides that differ by less."""
    total, count = values.copy(), np.ones(values.shape, np.int32)
    for shift in range(1, reach + 1):
        ahead = (slice(None),) * axis + (slice(shift, None),)
        behind = (slice(None),) * axis + (slice(None, -shift),)
        if shift >= values.shape[axis]:
            break
        one, other = values[ahead], values[behind]
        alike = (np.abs(one - other) < step) & (one >= 0) & (other >= 0)
        total[ahead] += np.where(alike, other, 0)
        total[behind] += np.where(alike, one, 0)
        count[ahead] += alike
        count[behind] += alike
    mean = (total + (count >> 1)) // count
    return np.where(values >= 0, mean, _NONE)


def _bytes(counts: Counts) -> NDArray[np.uint8]:
    """Return an image of counts as 8 bits; brighter images lose their lowest bits."""
    largest = int(counts.max(initial=0.0))
    shift = max(largest.bit_length() - 8, 0)
    return (counts.astype(np.int32) >> shift).astype(np.uint8)


class _Turn:
    """Turns images so that the second view stands to the right of the first, and back."""

    def __init__(self, second_view_m: tuple[float, float, float]) -> None:
        x, y, _ = second_view_m
        self.upright = abs(x) < abs(y)
        self.mirrored = (y if self.upright else x) < 0

    def forth(self, image: NDArray[Any]) -> NDArray[Any]:
        turned = image.T if self.upright else image
        return np.ascontiguousarray(turned[:, ::-1] if self.mirrored else turned)

    def back(self, image: NDArray[Any]) -> NDArray[Any]:
        turned = image[:, ::-1] if self.mirrored else image
        return np.ascontiguousarray(turned.T if self.upright else turned)

    def first_px(self, view: StageView) -> int:
        """Return how far the turned window's first column is from the image's first."""
        window = view.window
        first, size = window.left, window.width
        whole = view.width
        if self.upright:
            first, size, whole = window.top, window.height, view.height
        return whole - first - size if self.mirrored else first


@lru_cache(maxsize=4)
def _device_error(device_seed: int, window: Rect, grain_px: float) -> NDArray[np.float32]:
    """(h, w) float32 smooth field of a window: standard normal, the same in every frame."""
    import cv2

    reach = int(np.ceil(3 * grain_px))
    around = Rect(
        window.left - reach, window.top - reach, window.width + 2 * reach, window.height + 2 * reach
    )
    first, second, _, _ = random_bits(*pixels(around), device_seed, _DEVICE_DRAW)
    white, _ = normal_pair(first, second)
    side = np.arange(-reach, reach + 1, dtype=np.float64)
    kernel = np.exp(-0.5 * (side / grain_px) ** 2)
    kernel /= np.sqrt((kernel**2).sum())  # keeps the variance of white noise
    smooth = cv2.sepFilter2D(white.astype(np.float64), -1, kernel, kernel)
    field: NDArray[np.float32] = smooth[reach:-reach, reach:-reach].astype(np.float32)
    field.flags.writeable = False
    return field
