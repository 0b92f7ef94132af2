"""Find the nearest head of a frame, which needs no detector: for live streams.

The nearest piece of surface that is large enough is taken for a person, and what is within a
head's height of its top for the head.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from glsim.denoise.filters.windows import pieces
from glsim.denoise.interface import Depth, Mask
from glsim.denoise.tiles import Box, box_around

#: Height and width of the part that is denoised, mm: a head of the 99th percentile is 255 mm high
#: (ANSUR II, stature less chin height) and 165 mm wide; the rest is for hair and a turned head.
HEAD_MM: Final = (280.0, 220.0)
#: Focal length over the width of the image: Kinect V2 0.71, Azure Kinect 0.79, D435 0.60 to 0.67,
#: TrueDepth 0.68. A wrong one makes the box a little too large or too small.
FOCAL_SHARE: Final = 0.7
#: Least area of a person, of a box of HEAD_MM at its distance, and in coarse pixels: smaller pieces
#: are hands and noise. Chosen: a face is larger up to 5 m.
_LEAST_SHARE, _LEAST_PX = 0.15, 20
#: Frames are divided by this for the search, px.
_COARSE_PX: Final = 4
#: Surface around the head that is denoised too, px. Chosen: with it, cutting the frame there moves
#: no depth of the head by more than 0.1 mm.
_MARGIN_PX: Final = 32


def head_box(depth_mm: Depth) -> Box | None:
    """Return the box of the nearest head and some of its surroundings; None without any.

    Args:
        depth_mm: (H, W) millimetres, 0 = no depth.
    """
    coarse = np.ascontiguousarray(depth_mm[::_COARSE_PX, ::_COARSE_PX])
    labels = pieces(coarse, coarse > 0)
    focal_px = FOCAL_SHARE * depth_mm.shape[1]
    nearest_mm, head = np.inf, None
    areas = np.bincount(labels.ravel())
    areas[0] = 0
    for label in np.flatnonzero(areas >= _LEAST_PX):
        piece = labels == label
        distance_mm = float(np.percentile(coarse[piece], 10))
        height, width = (focal_px / distance_mm / _COARSE_PX * size for size in HEAD_MM)
        if areas[label] >= _LEAST_SHARE * height * width and distance_mm < nearest_mm:
            nearest_mm, head = distance_mm, _head(piece, height, width)
    if head is None:
        return None
    whole = cv2.resize(head.astype(np.uint8), depth_mm.shape[::-1], interpolation=cv2.INTER_NEAREST)
    return box_around(whole > 0, _MARGIN_PX)


def _head(piece: Mask, height: float, width: float) -> Mask:
    """Mark the box of a head's size, pixels, at the top of a piece."""
    rows = np.flatnonzero(piece.sum(axis=1) >= max(1.0, 0.15 * width))
    top = int(rows[0]) if rows.size else int(np.flatnonzero(piece.any(axis=1))[0])
    upper = piece[top : top + max(1, round(0.6 * height))]
    middle = int(np.median(np.nonzero(upper)[1]))
    head = np.zeros_like(piece)
    left = max(0, middle - round(width / 2))
    head[top : top + round(height), left : middle + round(width / 2) + 1] = True
    return head
