"""Find frames that show one static view, between which only noise changes depth.

In a recording where something moves, such as a person before a still room, ``mask_moving`` finds
the still periods of each pixel.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np

from glsim.core.array_types import Array, Floats, Mask
from glsim.core.depth_frame import DepthFrame
from glsim.measures.correlation import lagged_sums
from glsim.measures.stacks import moments, ratio

#: Two frames show different views if one of two tests holds. First: their median absolute
#: difference is above _MOST_MEDIAN_MM, and changes correlate by more than _MOST_ALIKE between
#: pixels _APART_PX apart. Second: the difference is above _MOST_SHARE of the depth. Noise of any
#: size is uncorrelated at this distance. Measured correlations: a D435 before a wall 0.44 at 8 px,
#: 0.08 at 16 px; another at rest 0.41, 0.12. After motion: 0.29 (slow robot with a D435) to 0.84;
#: a Kinect V2 0.47 to 0.84 (docs/results/real_frames.md).
_MOST_MEDIAN_MM, _MOST_ALIKE, _MOST_SHARE = 3.0, 0.2, 0.05
_APART_PX = 16
#: A part of the view moved if many of the blocks of _BLOCK_PX x _BLOCK_PX changed: a share above
#: _MOST_MOVED has a median change above _MOST_MEDIAN_MM and above _MOST_SPREADS times the spread
#: within the block, which is wider than the noise of a stereo camera (13 px). Measured shares:
#: static pairs of two D435 and a Kinect V2 0; a part of a wall that moved by 30 mm 3 %.
_BLOCK_PX, _MOST_SPREADS, _MOST_MOVED = 32, 3.0, 0.005
#: Smallest number of pixels with depth in both frames, and as a share of those with depth in one.
_LEAST_PIXELS, _LEAST_SHARED = 100, 0.5
#: Images of more pixels are subsampled: every eighth pixel along both axes is compared.
_THINNED_FROM, _EVERY_PX = 50_000, 8
#: A pixel moved if it is farther from its median than this many deviations, on this share of 5 x 5
#: pixels; pixels up to _AROUND_PX beside it are masked, too: half of a stereo camera's window and
#: the shadow's rim. A pixel drifts if its variance over time is above _MOST_DRIFT times that of
#: successive frames, in _LEAST_DRIFTING frames or more. All chosen, not measured.
_MOST_SIGMAS, _MOVING_AREA, _AROUND_PX = 8.0, 0.4, 8
_MOST_DRIFT, _LEAST_DRIFTING = 2.5, 6
#: Layer of depths before the mask, mm.
UNMASKED_LAYER = "unmasked_mm"
_NOISE_CLASSES_MM = np.geomspace(200.0, 8000.0, 25)
#: From this number of frames on only neighbours in time are compared.
_ALL_PAIRS_BELOW = 80


def static_pairs(frames: Sequence[DepthFrame]) -> list[tuple[int, int]]:
    """Find static pairs (first, second) of frame numbers: each frame with its next static frame."""
    thin = [_thinned(frame.measured_mm) for frame in frames]
    pairs = []
    for first in range(len(frames)):
        last = len(frames) if len(frames) <= _ALL_PAIRS_BELOW else min(first + 2, len(frames))
        for second in range(first + 1, last):
            if not _change(*thin[first], thin[second][0]):
                pairs.append((first, second))
                break
    return pairs


def view_numbers(frames: Sequence[DepthFrame]) -> list[int]:
    """Assign a view number to each frame; frames of one static view have equal numbers."""
    views = list(range(len(frames)))
    for first, second in static_pairs(frames):
        views[second] = views[first]
    return views


def mask_moving(frames: Sequence[DepthFrame]) -> tuple[list[DepthFrame], float]:
    """Remove the depth of what moves, and of its surroundings, from frames of one camera at rest.

    A pixel is still while it keeps to its median depth over time, within noise. A pixel that drifts
    more slowly than noise, as on a person who sits, is never still. Also returns the share kept.
    """
    depth = np.stack([frame.measured_mm for frame in frames])
    known = np.isfinite(depth)
    with np.errstate(invalid="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # pixels that never have depth
        steps = np.nanmedian(np.abs(np.diff(depth, axis=0)), axis=0) / np.sqrt(2.0) * 1.4826
        middle = np.nanmedian(depth, axis=0)
    step_mm = max(frames[0].step_mm, 0.1)
    sigma = cv2.medianBlur(np.nan_to_num(steps).astype(np.float32), 5)
    usual = _usual_noise(middle, steps)
    limit = _MOST_SIGMAS * np.clip(sigma, 0.5 * usual, 2.0 * usual) + step_mm
    moving = known & (np.abs(depth - middle) > limit)
    # Noise reaches the limit in single pixels; what moves has an area.
    areas = np.stack([cv2.blur(image.astype(np.float32), (5, 5)) for image in moving])
    moving = areas > _MOVING_AREA
    moving |= _drifts(np.where(moving, np.nan, depth))
    side = np.ones((2 * _AROUND_PX + 1,) * 2, np.uint8)
    moving = np.stack([cv2.dilate(image.astype(np.uint8), side) > 0 for image in moving])
    kept = [
        f.changed({"noisy_mm": np.where(m, np.float32(0), f.noisy_mm), UNMASKED_LAYER: f.noisy_mm})
        for f, m in zip(frames, moving, strict=True)
    ]
    return kept, float((known & ~moving).sum() / max(int(known.sum()), 1))


def _usual_noise(depth_mm: Floats, steps_mm: Array) -> Array:
    """Compute the median noise over time at each pixel's distance, (H, W) mm."""
    classes = np.digitize(np.nan_to_num(depth_mm), _NOISE_CLASSES_MM)
    usual = np.zeros(depth_mm.shape)
    for number in np.unique(classes):
        chosen = classes == number
        own = steps_mm[chosen & np.isfinite(steps_mm)]
        # A quarter of the pixels at any distance is at rest; the rest may be people.
        usual[chosen] = 1.5 * np.quantile(own, 0.25) if own.size else 0.0
    return usual


def _drifts(depth_mm: Array) -> Mask:
    """Mark pixels whose spread over time exceeds that of successive frames, (H, W)."""
    if len(depth_mm) < _LEAST_DRIFTING:
        return np.zeros(depth_mm.shape[1:], np.bool_)
    _, _, variance = moments(list(depth_mm))
    squares = np.diff(depth_mm, axis=0).astype(np.float64) ** 2
    count = np.isfinite(squares).sum(axis=0)
    successive = 0.5 * np.nansum(squares, axis=0) / np.maximum(count, 1)
    spread, near = (
        cv2.blur(np.where(count > 1, image, 0.0), (9, 9)) for image in (variance, successive)
    )
    return np.asarray(spread > _MOST_DRIFT * near)


def longest_still(frames: Sequence[DepthFrame]) -> tuple[int, int]:
    """Find the longest run of frames (first, after the last) whose views do not change."""
    thin = [_thinned(frame.measured_mm) for frame in frames]
    ends = [k + 1 for k in range(len(thin) - 1) if _change(*thin[k], thin[k + 1][0])]
    bounds = [0, *ends, len(thin)]
    return max(pairwise(bounds), key=lambda run: run[1] - run[0])


def view_change(first: DepthFrame, second: DepthFrame, *, parts: bool = True) -> str:
    """Return the evidence that the view changed between two frames; "" for a static pair.

    ``parts``: whether a part of the view that moves is a change.
    """
    return _change(*_thinned(first.measured_mm), _thinned(second.measured_mm)[0], parts)


def _thinned(depth_mm: Floats) -> tuple[Floats, int]:
    """Subsample a large depth map; also return the distance _APART_PX in the new pixels."""
    step = _EVERY_PX if depth_mm.size > _THINNED_FROM else 1
    return depth_mm[::step, ::step], _APART_PX // step


def _change(first: Floats, lag: int, second: Floats, parts: bool = True) -> str:
    change = second.astype(np.float64) - first
    known = change[np.isfinite(change)]
    seen = min(int(np.isfinite(first).sum()), int(np.isfinite(second).sum()))
    if known.size < (least := max(_LEAST_PIXELS, _LEAST_SHARED * seen)):
        return f"{known.size} of the compared pixels have depth in both, fewer than {least:.0f}"
    median_mm = float(np.median(np.abs(known)))
    moved = median_mm > _MOST_SHARE * float(np.median(first[np.isfinite(change)]))
    if not moved and median_mm > _MOST_MEDIAN_MM:
        limit = 5.0 * median_mm
        products, squares = lagged_sums(np.clip(change, -limit, limit), ((lag, 0), (0, lag))).T
        moved = ratio(float(products.sum()), float(squares.sum())) > _MOST_ALIKE
    if moved:
        return f"half of the pixels change by more than {median_mm:.0f} mm"
    share = _moved_share(change, _BLOCK_PX // _APART_PX * lag) if parts else 0.0
    return f"{100 * share:.1f} % of the view moved" if share > _MOST_MOVED else ""


def _moved_share(change_mm: Array, side: int) -> float:
    """Compute the share of blocks with depth whose pixels moved together, e.g. with a person."""
    height, width = (size - size % side for size in change_mm.shape)
    shape = height // side, side, width // side, side
    blocks = change_mm[:height, :width].reshape(shape).swapaxes(1, 2).reshape(-1, side**2)
    blocks = blocks[np.isfinite(blocks).mean(axis=1) >= _LEAST_SHARED]
    if not blocks.size:
        return 0.0
    middle = np.nanmedian(blocks, axis=1)
    spread = 1.4826 * np.nanmedian(np.abs(blocks - middle[:, None]), axis=1)
    drift = np.abs(middle - np.median(middle))
    return float((drift > np.maximum(_MOST_MEDIAN_MM, _MOST_SPREADS * spread)).mean())
