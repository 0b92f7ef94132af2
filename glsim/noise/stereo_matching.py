"""Match two infrared images, or one image and the projected pattern, to compute depth.

The matcher is OpenCV's semi-global one (Hirschmueller, "Stereo Processing by Semiglobal Matching
and Mutual Information", PAMI 30(2), 2008), in integers: the same bytes on every machine. Its
windows and paths reach far: the depth of a crop differs a little from that of the whole frame.

    infrared, infrared_right (or reference) --semi-global--> disparity, 1/16 px
    --smallest region, texture, left-right, border--> holes
    --mean of the support region, least squares between the images--> disparity, 1/32 px
    --f B / n--> depth
    --view of another camera (TrueDepth)--> depth
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Floats, Mask
from glsim.core.camera import Point
from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.noise.frame_context import FrameContext, Layers
from glsim.noise.layer_names import DISPARITY_LAYER
from glsim.noise.semi_global import NO_MATCH, STEPS_PER_PX, match, reject_unlit
from glsim.noise.stage import array_stage
from glsim.noise.twins.layers import normal_pair, pixels, random_bits

__all__ = ["match_stereo"]


#: Largest depth in units of the camera, which delivers 16 bits.
_LARGEST_UNITS = 65535
#: Separates the random words of the device's error from the words of other stages.
_DEVICE_DRAW = 2


def _reach_px(p: Mapping[str, float]) -> int:
    """Return the reach of the matching windows, pixels; paths reach farther, but weakly."""
    windows = (int(p[name]) // 2 for name in ("window_px", "support_px", "refine_px"))
    return sum(windows) + 16


@array_stage(
    _reach_px,
    ("infrared", "infrared_right", "reference", "right_clean"),
    disparities=(
        "int", 128, 16, 512, "px", "disparities that are searched, a multiple of 16; a D4xx has 126"
    ),
    largest_px=("float", 126, 1, 1024, "px", "largest disparity that is kept: nearest = f B / it"),
    disparity_shift=("int", 0, 0, 512, "px", "smallest disparity that is searched"),
    window_px=("int", 9, 3, 21, "px", "side of the window that is compared, odd", "step 2"),
    p1=("int", 8, 0, 200, "1", "P1, per pixel of the window: cost of a step of 1 px"),
    p2=("int", 32, 1, 800, "1", "P2, per pixel of the window: cost of a larger step"),
    contrast_px=(
        "int", 15, 0, 63, "px", "images are evened to one contrast in windows of this side, odd, "
        "since the cameras' census does not see brightness; 0 takes them as they are",
        "3, 63 step 2",
    ),
    contrast_floor_counts=("float", 4.0, 0.1, 100, "counts", "lowest contrast that is evened"),
    prefilter_counts=("int", 63, 1, 127, "counts", "horizontal gradients are cut here"),
    uniqueness_percent=("int", 5, 0, 100, "1", "reject matches not this much better than others"),
    left_right_px=("int", 1, 0, 100, "px", "reject matches that differ more from right to left"),
    texture_counts=("float", 1.0, 0, 1000, "counts", "reject windows of a smaller deviation"),
    texture_px=("int", 0, 0, 63, "px", "side of these windows, odd; 0: those that are compared"),
    smallest_region_px=("int", 100, 0, 100000, "px", "reject smaller connected regions"),
    region_step_px=("float", 1.0, 0.1, 16, "px", "step that still connects neighbours"),
    rim_px=(
        "int", 3, 0, 31, "px", "reject a farther surface this near a nearer one: the gap that real "
        "cameras leave on the side without a shadow, and add on the other",
    ),
    rim_step_px=("float", 2.0, 0.25, 64, "px", "step from which a surface is another"),
    border_px=("int", 9, 0, 64, "px", "reject matches this near the second image's border"),
    support_px=(
        "int", 9, 1, 31, "px", "side of the region whose disparities are averaged, along the "
        "baseline, odd", "step 2",
    ),
    support_across_px=("int", 0, 0, 31, "px", "its side across the baseline, odd; 0: the same"),
    support_step_px=("float", 1.0, 0.1, 16, "px", "step that ends this region"),
    refine_px=(
        "int", 0, 0, 31, "px", "side of the window, along the baseline, odd, in which the images "
        "are aligned by least squares after the match; 0: the match alone, which prefers whole "
        "pixels by up to 0.2 px",
    ),
    refine_across_px=("int", 0, 0, 31, "px", "its side across the baseline, odd; 0: the same"),
    refine_rounds=("int", 2, 1, 4, "1", "how often: once leaves 0.03 px of that preference"),
    refine_mean=("int", 1, 0, 1, "1", "1: the support region is averaged after each round too"),
    unlike_medians=(
        "float", 0.0, 0, 100, "1", "reject single pixels whose two images differ by more than this "
        "many times the median after the alignment, as D4xx cameras judge by a median; 0: none",
    ),
    subpixel_steps=("int", 32, 1, 256, "1", "steps of the disparity per pixel"),
    amplitude_px=(
        "float", 0.0, -0.5, 0.5, "px", "sine over a disparity's fraction that is added, against "
        "the preference of whole pixels",
    ),
    device_sigma_px=("float", 0.0, 0, 1, "px", "error of the device's own, standard deviation"),
    device_grain_px=("float", 4.0, 0.5, 64, "px", "sigma of the Gaussian that smooths it"),
    device_fine=("float", 0.0, 0, 1, "1", "share of its variance in bricks of a finer grain"),
    device_fine_px=("float", 1.0, 0.3, 16, "px", "their sigma along the baseline"),
    device_fine_across_px=(
        "float", 0.0, 0, 48, "px", "their sigma across the baseline; 0: three times that along it",
    ),
    device_patches=(
        "float", 0.0, 0, 2, "1", "standard deviation of the log of its strength, over places 12 px "
        "apart",
    ),
    depth_unit_mm=("float", 1.0, 0.01, 100, "mm", "the camera's own step of depth"),
    half_floats=("int", 0, 0, 1, "1", "1: depths are 16-bit floats of metres, as Apple's are"),
    earlier_frames=(
        "int", 8, 1, 32, "1", "frames before this one that are exposed and matched too if "
        "temporal_filter runs, each for two thirds of a frame's time; it looks back at 8",
    ),
)  # fmt: skip
def match_stereo(view: FrameContext, layers: Layers, p: Mapping[str, float]) -> dict[str, Floats]:
    """Matches two infrared images (or an image and a pattern) into depth: f B / disparity."""
    second = "infrared_right" if "infrared_right" in layers else "reference"
    turn = _Turn(view.second_view_m)
    left, right = (turn.forth(layers[name]) for name in ("infrared", second))
    found = match(left, right, p)
    if second == "infrared_right":
        column = np.arange(found.shape[1], dtype=np.int32) + turn.first_px(view)
        found[column * STEPS_PER_PX - found < int(p["border_px"]) * STEPS_PER_PX] = NO_MATCH
    else:
        reject_unlit(found, right, int(p["window_px"]) | 1)
    disparity = turn.back(found)
    # Matchers prefer whole pixels; D4xx cameras subtract a sine of this amplitude ("A-factor").
    exact = disparity / np.float64(STEPS_PER_PX)
    exact += p["amplitude_px"] * np.sin(2 * np.pi * exact)
    if p["device_sigma_px"] > 0:
        names = ("device_grain_px", "device_fine", "device_fine_px", "device_patches")
        across_px = p["device_fine_across_px"] or 3 * p["device_fine_px"]
        own = _device_error(
            view.device_seed, view.window, turn.upright, *(p[n] for n in names), across_px
        )
        exact += p["device_sigma_px"] * own
    steps = np.rint(exact * p["subpixel_steps"])
    kept = (disparity >= 0) & (steps > 0) & (steps <= p["largest_px"] * p["subpixel_steps"])
    scale = 1000.0 * view.focal_baseline_px_m * p["subpixel_steps"] / p["depth_unit_mm"]
    units = np.rint(scale / np.where(kept, steps, 1))
    kept &= units <= _LARGEST_UNITS
    depth = np.where(kept, units * p["depth_unit_mm"] / 1000.0, 0).astype(np.float32)
    if any(imager := view.imagers_m[0]):
        depth = warp_to_camera(depth, imager, view.focal_px)
    if p["half_floats"] > 0:
        depth = depth.astype(np.float16).astype(np.float32)
    shown = np.where(kept, steps / p["subpixel_steps"], 0)
    reason = match_reasons(view, layers, depth, p)
    return {"depth": depth, "reason": reason, DISPARITY_LAYER: shown.astype(np.float32)}


class _Turn:
    """The rotation or mirroring after which the second view is to the right of the first."""

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

    def first_px(self, view: FrameContext) -> int:
        """Return the number of pixels of the turned image to the left of the turned window."""
        window = view.window
        first, size = window.left, window.width
        whole = view.width
        if self.upright:
            first, size, whole = window.top, window.height, view.height
        return whole - first - size if self.mirrored else first


#: Sigma of the Gaussian of that error's strength, px. Chosen: real boards differ by tiles of 24 px.
_PATCH_PX = 16.0


@lru_cache(maxsize=4)
def _device_error(
    device_seed: int, window: Rect, upright: bool, grain_px: float, fine: float, fine_px: float,
    patches: float, fine_across_px: float,
) -> Floats:  # fmt: skip
    """Sample an (h, w) float32 smooth standard normal field, the same in every frame of a device.

    Args:
        device_seed, window: seed of the device, and the part of the frame that is sampled.
        upright: whether the baseline lies along columns.
        grain_px: sigma of the field's Gaussian.
        fine: share of its variance in fine grains.
        fine_px: sigma of the fine grains' Gaussian along the baseline.
        patches: standard deviation of the logarithm of the local strength.
        fine_across_px: sigma of the fine grains' Gaussian across the baseline.
    """
    bricks = (fine_across_px, fine_px) if upright else (fine_px, fine_across_px)
    reach = int(np.ceil(3 * max(grain_px, *(bricks if fine else ()), _PATCH_PX if patches else 0)))
    around = Rect(
        window.left - reach, window.top - reach, window.width + 2 * reach, window.height + 2 * reach
    )
    first, second, *others = random_bits(*pixels(around), device_seed, _DEVICE_DRAW)
    white, strength = normal_pair(first, second)
    field = _smooth(white, (grain_px, grain_px), reach)
    if fine:
        dots = _smooth(normal_pair(*others)[0], bricks, reach)
        field = np.sqrt(1.0 - fine) * field + np.sqrt(fine) * dots
    if patches:
        strength = _smooth(strength, (_PATCH_PX, _PATCH_PX), reach)
        field = field * np.exp(patches * strength - patches**2)  # of mean square 1
    field = field.astype(np.float32)
    field.flags.writeable = False
    return field


def _smooth(white: Floats, grain_px: tuple[float, float], reach: int) -> Floats:
    """Smooth white noise by a Gaussian that keeps its variance; cut ``reach`` px of border off."""
    import cv2

    side = np.arange(-reach, reach + 1, dtype=np.float64)
    x, y = (np.exp(-0.5 * (side / grain) ** 2) for grain in grain_px)
    size = np.sqrt((x**2).sum() * (y**2).sum())
    smooth = cv2.sepFilter2D(white.astype(np.float64), -1, x / size, y)
    return np.asarray(smooth[reach:-reach, reach:-reach], np.float32)


#: A match whose disparity is wrong by more than this, px, has found another surface. Chosen: ten
#: times the noise.
_OTHER_SURFACE_PX = 1.0
#: A surface is hidden if the view's depth is smaller by this share. Chosen: mostly a step of 1 px.
_HIDDEN_SHARE = 0.02


def match_reasons(
    view: FrameContext, layers: Layers, depth_m: Floats, p: Mapping[str, float]
) -> Floats:
    """Return reason codes after matching; depth and layers (clean, right_clean) are (h, w) m."""
    clean = layers["clean"]
    surface, found = clean > 0, depth_m > 0
    fb = np.float32(view.focal_baseline_px_m)
    true_px = np.where(surface, fb / np.where(surface, clean, 1), 0)
    reason = layers["reason"].copy()
    lost = surface & ~found
    reason[lost] = float(Reason.WINDOW)
    reason[lost & (true_px > p["largest_px"])] = float(Reason.OUT_OF_RANGE)
    if "right_clean" in layers:
        reason[lost & _hidden(view, layers, true_px)] = float(Reason.SHADOW)
    reason[is_other_surface(view, clean, depth_m)] = float(Reason.MOVED)
    return reason


def is_other_surface(view: FrameContext, clean_m: Floats, depth_m: Floats) -> Mask:
    """Mark pixels where two (h, w) depth maps, m, have depth and disparities over 1 px apart."""
    fb = np.float32(view.focal_baseline_px_m)
    both = (clean_m > 0) & (depth_m > 0)
    found_px, true_px = (fb / np.where(both, d, 1) for d in (depth_m, clean_m))
    return both & (np.abs(found_px - true_px) > _OTHER_SURFACE_PX)


def _hidden(view: FrameContext, layers: Layers, true_px: Floats) -> Mask:
    """Mark pixels whose surface the second imager does not see, hidden or outside its image."""
    right, clean = layers["right_clean"], layers["clean"]
    height, width = clean.shape
    axis_px = np.array(view.second_view_m[:2]) / np.hypot(*view.second_view_m[:2])
    row, column = np.mgrid[:height, :width]
    column = np.rint(column - axis_px[0] * true_px).astype(np.int64)
    row = np.rint(row - axis_px[1] * true_px).astype(np.int64)
    beside = (column < 0) | (column >= width) | (row < 0) | (row >= height)
    there = right[row.clip(0, height - 1), column.clip(0, width - 1)]
    return np.asarray(beside | ((there > 0) & (there < (1 - _HIDDEN_SHARE) * clean)))


def warp_to_camera(depth_m: Floats, imager_m: Point, focal_px: float) -> Floats:
    """Project an imager's depth map to a camera at the origin, on the same pixel grid.

    Pixels shift by focal length times offset over depth; a nearer one covers farther ones. Each
    pixel is drawn into both pixels between which it falls, so that a slanted surface has no gaps.
    Maps are (H, W) metres, 0 = none. The imager is in the plane z = 0; hidden surfaces stay empty.
    """
    height, width = depth_m.shape
    row, column = np.nonzero(depth_m)
    depth = depth_m[row, column]
    # Draw the farthest first: of several values for one pixel NumPy keeps the last.
    order = np.argsort(-depth, kind="stable")
    row, column, depth = row[order], column[order], depth[order]
    shift = np.float64(focal_px) / depth
    x, y = column + shift * imager_m[0], row + shift * imager_m[1]
    seen = np.zeros_like(depth_m)
    upright = abs(imager_m[1]) > abs(imager_m[0])
    along = np.floor(y if upright else x).astype(np.int64)
    across = np.rint(x if upright else y).astype(np.int64)
    # Both neighbours of a pixel are written before any nearer pixel.
    along = np.stack([along, along + 1], axis=1).ravel()
    across, depth = np.repeat(across, 2), np.repeat(depth, 2)
    rows, columns = (along, across) if upright else (across, along)
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    seen[rows[inside], columns[inside]] = depth[inside]
    return seen
