"""Find frames that show one static view, between which only noise changes depth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from glsim.core.array_types import Array, Floats
from glsim.core.depth_frame import DepthFrame
from glsim.measures.correlation import lagged_sums
from glsim.measures.stacks import ratio

#: Two frames show different views if one of two tests holds. First: their median absolute
#: difference is above _MOST_MEDIAN_MM, and changes correlate by more than _MOST_ALIKE between
#: pixels _APART_PX apart. Second: the difference is above _MOST_SHARE of the depth. Noise of any
#: size is uncorrelated at this distance. Measured correlations: a D435 before a wall 0.44 at 8 px,
#: 0.08 at 16 px; another at rest 0.41, 0.12. After motion: 0.29 (slow robot with a D435) to 0.84;
#: a Kinect V2 0.47 to 0.84 (docs/results/real_frames.md).
_MOST_MEDIAN_MM, _MOST_ALIKE, _MOST_SHARE = 3.0, 0.2, 0.05
_APART_PX = 16
#: A part of the view moved if many of the blocks of _BLOCK x _BLOCK compared pixels changed: a
#: share above _MOST_MOVED has a median change above _MOST_MEDIAN_MM and above _MOST_SPREADS times
#: the spread within the block. Measured shares: static pairs of two D435 and a Kinect V2 0; a part
#: of a wall that moved by 30 mm 3 %.
_BLOCK, _MOST_SPREADS, _MOST_MOVED = 4, 3.0, 0.005
#: Smallest number of pixels with depth in both frames, and as a share of those with depth in one.
_LEAST_PIXELS, _LEAST_SHARED = 100, 0.5
#: Images of more pixels are subsampled: every eighth pixel along both axes is compared.
_THINNED_FROM, _EVERY_PX = 50_000, 8
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


def view_change(first: DepthFrame, second: DepthFrame) -> str:
    """Return the evidence that the view changed between two frames; "" for a static pair."""
    return _change(*_thinned(first.measured_mm), _thinned(second.measured_mm)[0])


def _thinned(depth_mm: Floats) -> tuple[Floats, int]:
    """Subsample a large depth map; also return the distance _APART_PX in the new pixels."""
    step = _EVERY_PX if depth_mm.size > _THINNED_FROM else 1
    return depth_mm[::step, ::step], _APART_PX // step


def _change(first: Floats, lag: int, second: Floats) -> str:
    change = second.astype(np.float64) - first
    known = change[np.isfinite(change)]
    seen = min(int(np.isfinite(first).sum()), int(np.isfinite(second).sum()))
    if known.size < max(_LEAST_PIXELS, _LEAST_SHARED * seen):
        return f"only {100 * known.size / max(seen, 1):.0f} % of the depths are in both"
    median_mm = float(np.median(np.abs(known)))
    moved = median_mm > _MOST_SHARE * float(np.median(first[np.isfinite(change)]))
    if not moved and median_mm > _MOST_MEDIAN_MM:
        limit = 5.0 * median_mm
        products, squares = lagged_sums(np.clip(change, -limit, limit), ((lag, 0), (0, lag))).T
        moved = ratio(float(products.sum()), float(squares.sum())) > _MOST_ALIKE
    if moved:
        return f"half of the pixels change by more than {median_mm:.0f} mm"
    share = _moved_share(change)
    return f"{100 * share:.1f} % of the view moved" if share > _MOST_MOVED else ""


def _moved_share(change_mm: Array) -> float:
    """Compute the share of blocks with depth whose pixels moved together, e.g. with a person."""
    height, width = (size - size % _BLOCK for size in change_mm.shape)
    shape = height // _BLOCK, _BLOCK, width // _BLOCK, _BLOCK
    blocks = change_mm[:height, :width].reshape(shape).swapaxes(1, 2).reshape(-1, _BLOCK**2)
    blocks = blocks[np.isfinite(blocks).mean(axis=1) >= _LEAST_SHARED]
    if not blocks.size:
        return 0.0
    middle = np.nanmedian(blocks, axis=1)
    spread = 1.4826 * np.nanmedian(np.abs(blocks - middle[:, None]), axis=1)
    drift = np.abs(middle - np.median(middle))
    return float((drift > np.maximum(_MOST_MEDIAN_MM, _MOST_SPREADS * spread)).mean())
