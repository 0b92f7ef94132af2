"""Say why matching left a pixel without depth, or gave it that of another surface."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from glsim.noise.frame_context import Layers, StageView
from glsim.reason import Reason

#: A match that is farther from the true disparity has found another surface, px: ten times the
#: noise. Chosen.
_OTHER_SURFACE_PX = 1.0
#: A view sees another surface if its depth is smaller by this share. Chosen: a step of 1 px at
#: most distances.
_HIDDEN_SHARE = 0.02


def match_reasons(
    view: StageView, layers: Layers, depth_m: NDArray[np.float32], p: Mapping[str, float]
) -> NDArray[np.float32]:
    """Return the reason codes of matched depth.

    Args:
        layers: clean; for two imagers also right_clean. All of the window, metres.
        depth_m: (h, w) after matching, 0 = none.
        p: parameters of the stage ``match_stereo``.
    """
    clean = layers["clean"]
    surface, found = clean > 0, depth_m > 0
    fb = np.float32(view.focal_baseline_px_m)
    true_px = np.where(surface, fb / np.where(surface, clean, 1), 0)
    reason = layers["reason"].copy()
    lost = surface & ~found
    reason[lost] = float(Reason.WINDOW)
    nearest_px = p["largest_px"]
    reason[lost & (true_px > nearest_px)] = float(Reason.OUT_OF_RANGE)
    if "right_clean" in layers:
        reason[lost & _hidden(view, layers, true_px)] = float(Reason.SHADOW)
    reason[is_other_surface(view, clean, depth_m)] = float(Reason.MOVED)
    return reason


def is_other_surface(
    view: StageView, clean_m: NDArray[np.float32], depth_m: NDArray[np.float32]
) -> NDArray[np.bool_]:
    """Return where a depth's disparity is not that of the clean surface.

    Args:
        clean_m, depth_m: (h, w) metres, 0 = none; where either is, the answer is no.
    """
    fb = np.float32(view.focal_baseline_px_m)
    both = (clean_m > 0) & (depth_m > 0)
    found_px, true_px = (fb / np.where(both, d, 1) for d in (depth_m, clean_m))
    other: NDArray[np.bool_] = both & (np.abs(found_px - true_px) > _OTHER_SURFACE_PX)
    return other


def _hidden(view: StageView, layers: Layers, true_px: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return where the second imager sees another surface, or nothing of the scene."""
    right, clean = layers["right_clean"], layers["clean"]
    height, width = clean.shape
    axis_px = np.array(view.optics.second_view_m[:2]) / np.hypot(*view.optics.second_view_m[:2])
    row, column = np.mgrid[:height, :width]
    column = np.rint(column - axis_px[0] * true_px).astype(np.int64)
    row = np.rint(row - axis_px[1] * true_px).astype(np.int64)
    beside = (column < 0) | (column >= width) | (row < 0) | (row >= height)
    there = right[row.clip(0, height - 1), column.clip(0, width - 1)]
    hidden: NDArray[np.bool_] = beside | ((there > 0) & (there < (1 - _HIDDEN_SHARE) * clean))
    return hidden
